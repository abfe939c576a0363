"""``python -m trunnion`` and ``trunnion``."""

import atexit
import contextlib
import os
import signal
import sys

from trunnion.base.interrupts import answer_interrupts_between_imports

INTERRUPTED = 130


def main() -> None:
    """Run the command line: text that the terminal cannot show is written in escapes."""
    try:
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")
        from trunnion.cli import app

        app(prog_name="trunnion")
    except KeyboardInterrupt:  # while modules are imported
        sys.exit(INTERRUPTED)


def run() -> None:
    """Run the command line as a process of its own.

    After Ctrl-C it ends without taking down every module, which takes longer than all else.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        answer_interrupts_between_imports()
    try:
        main()
    except SystemExit as end:
        if end.code != INTERRUPTED:
            raise
    else:
        return
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # a closed pipe
            stream.flush()
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    run()

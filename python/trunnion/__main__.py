"""``python -m trunnion`` and ``trunnion``."""

import sys


def main() -> None:
    """Run the command line: text that the terminal cannot show is written in escapes."""
    try:
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")
        from trunnion.cli import app

        app(prog_name="trunnion")
    except KeyboardInterrupt:  # while modules are imported
        sys.exit(130)


if __name__ == "__main__":
    main()

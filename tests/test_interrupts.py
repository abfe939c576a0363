"""Ctrl-C while modules are imported, processes are started, and results are under way."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from trunnion.base.interrupts import held_interrupts

# The interrupt comes while large results are being sent: a worker that is killed then leaves the
# pool's own thread in the middle of one, for which Python waits as it ends.
LARGE = """
import os, signal, threading, time
from trunnion.base.workers import map_processes

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer({delay}, os.kill, [os.getpid(), signal.SIGINT])
    def stop(_):
        if not timer.ident:
            timer.start()
    map_processes(bytes, [0, *[60_000_000] * 400], 2, stop)
"""
# A terminal sends Ctrl-C to the workers as well, which are being started.
STARTING = """
import os, signal, threading, time
from trunnion.base import workers

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Timer({delay}, os.killpg, [0, signal.SIGINT]).start()
        workers.map_processes(time.sleep, [1000.0] * 3, 3, lambda _: None)
    except KeyboardInterrupt:
        print("stopped")
"""
# Its modules take long, and one of them loses what is raised in it, as callbacks of imports do.
SLOW = "import time\ntime.sleep(0.02)\n"
LOSING = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass
except KeyboardInterrupt:
    pass
"""
IMPORTING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from trunnion.base.interrupts import {way}
with {way}() or open({folder!r} + "/one.py"):
    import losing
    import one
    import two
print("went on")
"""


def run(tmp_path: Path, text: str) -> subprocess.CompletedProcess[str]:
    script = tmp_path / "script.py"
    script.write_text(text)
    return subprocess.run(
        [sys.executable, script],
        capture_output=True,
        text=True,
        timeout=30,
        start_new_session=True,
        check=False,
    )


@pytest.mark.parametrize("delay", [0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45])
def test_an_interrupt_while_large_results_are_sent_does_not_hang(
    tmp_path: Path, delay: float
) -> None:
    done = run(tmp_path, LARGE.format(delay=delay))
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.1, 0.3, 1.0])
def test_an_interrupt_while_processes_start_ends_them_without_a_word(
    tmp_path: Path, delay: float
) -> None:
    done = run(tmp_path, STARTING.format(delay=delay))
    assert (done.stdout, done.stderr) == ("stopped\n", "")


@pytest.mark.parametrize("way", ["held_interrupts", "answer_interrupts_between_imports"])
def test_an_interrupt_while_modules_are_imported_is_not_lost(tmp_path: Path, way: str) -> None:
    (tmp_path / "losing.py").write_text(LOSING)
    for name in ("one", "two"):
        (tmp_path / f"{name}.py").write_text(f"print({name!r}, flush=True)\n{SLOW}")
    done = run(tmp_path, IMPORTING.format(way=way, folder=str(tmp_path)))
    assert done.stdout == ""
    assert done.stderr.count("Traceback") == 1
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")


def test_a_program_with_its_own_answer_keeps_it() -> None:
    came = []
    before = signal.signal(signal.SIGINT, lambda *_: came.append(True))
    try:
        with held_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
            assert came
    finally:
        signal.signal(signal.SIGINT, before)

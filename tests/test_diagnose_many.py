"""`diagnose_many`: order, failures in their place, the same numbers on any number of processes."""

import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from result_examples import turned_axis
from trunnion.base.workers import map_processes

FILES = [
    tn.sample_path("plate/first.csv"),
    Path("no-such-file.csv"),
    tn.sample_path("positioning/axis.csv"),
    turned_axis(4.0),
]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of other packages, as the pool starts
@pytest.mark.parametrize("workers", [1, 2, 3])
def test_numbers_do_not_depend_on_the_number_of_workers(workers: int) -> None:
    batch = tn.diagnose_many(FILES, workers=workers)
    alone = [tn.diagnose(tn.read(one)) for one in (FILES[0], FILES[2])]
    assert [batch[0], batch[2], batch[3]] == [*alone, tn.diagnose(FILES[3])]
    assert batch[1].verdict == "failed"
    assert list(batch.failed) == ["no-such-file.csv"]
    assert batch.names[3] == "measurement 4"
    assert len(batch) == len(batch.to_dataframe()) == len(FILES)


def test_each_measurement_can_have_its_own_set_up(tmp_path: Path) -> None:
    hidden, cross = tn.sample_path("hidden/touches.csv"), tn.sample_path("cross/touches.csv")
    setups = [tn.sample_path("hidden/setup.toml"), tmp_path / "none.toml"]
    batch = tn.diagnose_many([hidden, cross], setups, workers=1)
    assert [one.verdict == "failed" for one in batch] == [False, True]
    with pytest.raises(tn.InputError, match="got 2 set-ups, expected 1"):
        tn.diagnose_many([hidden], setups)
    with pytest.raises(tn.InputError, match="expected a list"):
        tn.diagnose_many("touches.csv")
    with pytest.raises(tn.InputError, match="workers"):
        tn.diagnose_many([hidden], setups[0], workers=0)


def test_what_cannot_be_sent_to_a_process_is_named() -> None:
    class Own:
        id = "own"
        parameters = ("k_um",)

        def change(self, data: tn.Points, values: Mapping[str, float]) -> NDArray[np.float64]:
            return values["k_um"] * np.ones(2 * len(data))

    with pytest.raises(tn.InputError, match="expected effects of your own defined at the top"):
        tn.diagnose_many(FILES[:1] * 2, effects=[Own()], workers=2)


def negative(value: Any) -> Any:
    return -value


def test_what_fails_in_a_process_is_not_taken_for_what_cannot_be_sent() -> None:
    with pytest.raises(TypeError, match="bad operand type"):
        map_processes(negative, ["text", 1.0], 2, lambda _: None)


WAITING = """
import multiprocessing, os, signal, sys, threading, time
import trunnion as tn
from trunnion.base.workers import map_processes

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    stop = lambda _: os.kill(os.getpid(), signal.SIGINT)  # after the first item
    try:
        map_processes(time.sleep, [0.0, 1000.0, 1000.0], 3, stop)
    except KeyboardInterrupt:
        for child in multiprocessing.active_children():
            child.join()
        print("stopped")
"""


def test_an_interrupt_ends_the_workers(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(WAITING)
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert run.stdout == "stopped\n", run.stderr
    assert run.returncode in (0, -signal.SIGINT)

"""Past one machine: a real cluster of two worker processes, one of them killed in mid-sweep."""

import contextlib
import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn


def slow(rng: np.random.Generator, scale: float) -> dict[str, float]:
    time.sleep(0.05)
    return {"value": scale * rng.normal(), "pid": float(os.getpid())}


def kill_once_all_have_worked(path: Path, pids: list[int]) -> None:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        with contextlib.suppress(tn.DataError):  # not begun yet
            if {int(pid) for pid in np.unique(tn.open_sweep(path)["pid"]) if pid > 0} >= set(pids):
                break
        time.sleep(0.02)
    os.kill(pids[0], signal.SIGKILL)


@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_loses_nothing(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    grid = {"scale": [1.0, 2.0]}
    here = tn.sweep(slow, grid, samples=40, seed=6, progress=False)
    cluster = distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        silence_logs="CRITICAL",
    )
    with cluster, distributed.Client(cluster) as client:
        pids = list(client.run(os.getpid).values())
        path = tmp_path / "cluster.nc"
        killer = threading.Thread(target=kill_once_all_have_worked, args=(path, pids))
        killer.start()
        there = tn.sweep(
            slow, grid, 40, 6, client.get_executor(), chunk=2, path=path, progress=False
        )
        killer.join()
    assert there.attrs["samples_done"] == 80
    assert np.array_equal(there["value"], here["value"])
    worked = {int(pid) for pid in np.unique(there["pid"])}
    assert len(worked) >= 2
    assert os.getpid() not in worked

"""Sweeps that are stopped, killed, disturbed, or given files that are not theirs."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import trunnion as tn

SCRIPT = Path(__file__)
GRID: dict[str, list[float]] = {"scale": [1.0, 2.0]}
SAMPLES = 400


def slow(rng: np.random.Generator, scale: float) -> dict[str, float]:
    time.sleep(0.004)
    return {"value": scale * rng.normal(), "uniform": rng.random()}


def quick(rng: np.random.Generator, scale: float) -> dict[str, float]:
    return {"value": scale * rng.normal(), "uniform": rng.random()}


quick.__name__ = slow.__name__


def run(path: Path | None = None, **how: Any) -> xr.Dataset:
    return tn.sweep(slow, GRID, SAMPLES, 7, path=path, progress=False, **how)


def start(path: Path) -> subprocess.Popen[str]:
    """A process that runs the sweep, once it has something on the disk."""
    before = max(done(path), 0)
    process = subprocess.Popen(
        [sys.executable, str(SCRIPT), str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + 60
    while time.monotonic() < end and process.poll() is None and done(path) <= before:
        time.sleep(0.01)
    return process


def done(path: Path) -> int:
    try:
        return int(tn.open_sweep(path).attrs["samples_done"])
    except tn.DataError:
        return -1


def test_a_sweep_that_is_killed_again_and_again_ends_with_the_same_numbers(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    kept = []
    for _ in range(3):
        process = start(path)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        kept.append(done(path))
    assert not path.exists()
    assert 0 < kept[0] < kept[1] < kept[2] < 2 * SAMPLES
    part = tn.open_sweep(path)
    whole = run()
    there = np.isfinite(part["value"].values)
    assert there.sum() == kept[2]
    np.testing.assert_array_equal(part["value"].values[there], whole["value"].values[there])
    found = run(path, chunk=7)
    assert found.identical(whole)
    assert tn.open_sweep(path).identical(whole)
    assert [entry.name for entry in tmp_path.iterdir()] == ["s.nc"]


def test_one_process_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    process = start(path)
    with pytest.raises(tn.DataError, match="another process is running this sweep"):
        run(path)
    out, error = process.communicate(timeout=120)
    assert out == "finished\n", error
    assert tn.open_sweep(path).identical(run(path))


def test_an_interrupt_keeps_what_is_done(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    process = start(path)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert "KeyboardInterrupt" in error
    assert 0 < done(path) < 2 * SAMPLES
    assert run(path).identical(run())


def test_the_command_says_how_to_go_on(tmp_path: Path) -> None:
    study = tmp_path / "s.toml"
    study.write_text('study = "calibration"\nsamples = 2000000\n[fixed]\nidentify = false\n')
    process = subprocess.Popen(
        [sys.executable, "-m", "trunnion", "sweep", str(study)], stderr=subprocess.PIPE, text=True
    )
    end = time.monotonic() + 60
    while done(tmp_path / "s.nc") < 1 and time.monotonic() < end:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "the same command goes on" in error
    assert 0 < done(tmp_path / "s.nc") < 2_000_000


def interrupted(path: Path, study: Callable[..., Any] = quick) -> None:
    calls = 0

    def stopping(executed: Callable[..., Any]) -> Any:
        class Stops:
            def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
                nonlocal calls
                calls += 1
                if calls > 100:
                    raise KeyboardInterrupt
                return executed(function, *arguments)

        return Stops()

    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        tn.sweep(study, GRID, SAMPLES, 7, stopping(pool.submit), path=path, progress=False)
    assert 0 < done(path) < 2 * SAMPLES


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid": {"scale": [1.0, 3.0]}}, "holds another sweep: grid is"),
        ({"samples": SAMPLES + 1}, "holds another sweep: samples is 400 there, 401 here"),
        ({"seed": 8}, "holds another sweep: seed is 7 there, 8 here"),
        ({"study": slow}, "holds another sweep: the code of slow was another"),
        ({"study": "calibration", "grid": {}}, "holds another sweep: .* wanted the same sweep"),
    ],
)
@pytest.mark.parametrize("finished", [False, True])
def test_another_sweep_does_not_go_on_with_the_file(
    tmp_path: Path, change: dict[str, Any], message: str, finished: bool
) -> None:
    path = tmp_path / "s.nc"
    same: dict[str, Any] = {"study": quick, "grid": GRID, "samples": SAMPLES, "seed": 7}
    if finished:
        tn.sweep(**same, path=path, progress=False)
    else:
        interrupted(path)
    before = done(path)
    with pytest.raises(tn.DataError, match=message):
        tn.sweep(**{**same, **change}, path=path, progress=False)
    assert done(path) == before


@pytest.mark.parametrize("size", [0, 100, 3000, 5000, None])
@pytest.mark.parametrize("ending", ["", ".part"])
def test_damaged_and_foreign_files_are_told(tmp_path: Path, ending: str, size: int | None) -> None:
    path = tmp_path / "s.nc"
    if ending:
        interrupted(path)
    else:
        tn.sweep(quick, GRID, SAMPLES, 7, path=path, progress=False)
    file = path.with_name(path.name + ending)
    whole = file.read_bytes()
    assert len(whole) > 5000
    file.write_bytes(b"angle_deg, target\n" * 400 if size is None else whole[:size])
    if ending and size == 0:
        # An empty database is what a sweep begins with.
        assert (
            tn.sweep(quick, GRID, SAMPLES, 7, path=path, progress=False).samples_done == 2 * SAMPLES
        )
        return
    with pytest.raises(tn.DataError, match=r"s\.nc"):
        tn.open_sweep(path)
    with pytest.raises(tn.DataError, match=r"s\.nc"):
        tn.sweep(quick, GRID, SAMPLES, 7, path=path, progress=False)


def test_a_netcdf_file_of_something_else_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(path, engine="scipy")
    before = path.read_bytes()
    with pytest.raises(tn.DataError, match="holds no sweep"):
        run(path)
    assert path.read_bytes() == before


def test_places_that_cannot_be_written_to(tmp_path: Path) -> None:
    with pytest.raises(tn.InputError, match="a folder, wanted a file"):
        run(tmp_path)
    with pytest.raises(tn.InputError, match="wanted a file in a folder that is there"):
        run(tmp_path / "no" / "s.nc")
    (tmp_path / "s.nc.lock").mkdir()
    with pytest.raises(tn.DataError, match="wanted a folder that can be written to"):
        run(tmp_path / "s.nc")
    if os.geteuid() != 0:
        tmp_path.chmod(0o500)
        with pytest.raises(tn.DataError, match="wanted a folder that can be written to"):
            run(tmp_path / "t.nc")


if __name__ == "__main__":
    run(Path(sys.argv[1]))
    print("finished")

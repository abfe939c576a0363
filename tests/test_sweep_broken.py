"""Sweeps that are stopped, killed, disturbed, or given files that are not theirs."""

import contextlib
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app
from trunnion.studies import Output
from trunnion.studies.description import Description
from trunnion.studies.grid import Grid

SCRIPT = Path(__file__)
GRID: dict[str, list[float]] = {"scale": [1.0, 2.0]}
SAMPLES = 400


STARTED: list[subprocess.Popen[str]] = []


@pytest.fixture(autouse=True)
def _no_process_stays() -> Iterator[None]:
    yield
    while STARTED:
        process = STARTED.pop()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def slow(rng: np.random.Generator, scale: float) -> dict[str, float]:
    time.sleep(0.004)
    return {"value": scale * rng.normal(), "uniform": rng.random()}


def quick(rng: np.random.Generator, scale: float) -> dict[str, float]:
    return {"value": scale * rng.normal(), "uniform": rng.random()}


quick.__name__ = slow.__name__


def run(path: Path | None = None, **how: Any) -> xr.Dataset:
    return tn.sweep(slow, GRID, SAMPLES, 7, path=path, progress=False, **how)


def popen(*arguments: str, interrupt: Any = signal.SIG_DFL) -> subprocess.Popen[str]:
    """A Python process with this answer to SIGINT: the one that the tests were started with may be
    to ignore it (`make test &`)."""
    process = subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, interrupt),
    )
    STARTED.append(process)
    return process


def start(path: Path, *how: str) -> subprocess.Popen[str]:
    """A process that runs the sweep, once it has something on the disk."""
    before = max(done(path), 0)
    process = popen(str(SCRIPT), str(path), *how)
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


def test_workers_that_outlive_a_killed_sweep_do_not_keep_it(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    process = start(path, "fork")
    process.send_signal(signal.SIGKILL)
    process.wait(timeout=60)
    os.killpg(process.pid, 0)  # its workers are still there
    assert run(path).identical(run())


def test_an_interrupt_keeps_what_is_done(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    process = start(path)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert "KeyboardInterrupt" in error
    assert 0 < done(path) < 2 * SAMPLES
    assert run(path).identical(run())


@pytest.mark.parametrize("started", [signal.SIG_DFL, signal.SIG_IGN])
def test_the_command_says_how_to_go_on(tmp_path: Path, started: signal.Handlers) -> None:
    # A shell without job control starts what ends in & with SIGINT ignored.
    study = tmp_path / "s.toml"
    study.write_text('study = "calibration"\nsamples = 2000000\n[fixed]\nidentify = false\n')
    process = popen("-m", "trunnion", "sweep", str(study), interrupt=started)
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
        ({"study": "calibration", "grid": {}}, "holds another sweep: .* expected the same sweep"),
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


def entries(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every place in nested lists and tables: what holds it, and its key there."""
    for key in list(value) if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from entries(value[key])


def places() -> int:
    """Number of entries in the description of the sweep of these tests."""
    outputs = tuple(Output(name) for name in ("value", "uniform"))
    grid = Grid({"scale": (1.0, 2.0)}, {})
    return len(list(entries(Description("slow", grid, {"scale": ""}, 400, 7, outputs).to_dict())))


JUNK: list[Any] = [None, True, -1, 1.5, "sample", [], {}, [[1]], {"a": 1}, 10**400, float("nan")]


@pytest.mark.parametrize("place", range(places()))
def test_a_running_sweep_with_another_description_is_refused_or_read(
    tmp_path: Path, place: int
) -> None:
    path = tmp_path / "s.nc"
    interrupted(path)
    with contextlib.closing(sqlite3.connect(tmp_path / "s.nc.part")) as base:
        (text,) = base.execute("SELECT described FROM sweep").fetchone()
        for junk in (*JUNK, "gone"):
            described = json.loads(text)
            holder, key = list(entries(described))[place]
            if junk == "gone":
                del holder[key]
            else:
                holder[key] = junk
            if described == json.loads(text):
                continue
            base.execute("UPDATE sweep SET described = ?", (json.dumps(described),))
            base.commit()
            with contextlib.suppress(tn.DataError):
                tn.open_sweep(path)
            with pytest.raises(tn.DataError, match=r"s\.nc\.part: (damaged|holds another sweep)"):
                tn.sweep(quick, GRID, SAMPLES, 7, path=path, progress=False)


@pytest.mark.parametrize("text", [None, "", "{", "[" * 100_000, "[]", b"\xff", 3, "1" * 5000])
def test_a_running_sweep_without_a_description_is_refused(tmp_path: Path, text: Any) -> None:
    path = tmp_path / "s.nc"
    interrupted(path)
    with contextlib.closing(sqlite3.connect(tmp_path / "s.nc.part")) as base:
        base.execute("UPDATE sweep SET described = ?", (text,))
        base.commit()
    with pytest.raises(tn.DataError, match=r"s\.nc\.part: damaged"):
        tn.open_sweep(path)


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("node", 2), ("node", -1), ("node", "x"), ("node", 2**62), ("node", 0.5),
        ("first", 400), ("first", None), ("count", 0), ("count", -1), ("count", 2),
        ("columns", None), ("columns", b"abc"), ("columns", "x"), ("width", -1), ("width", 5),
        ("failures", None), ("failures", "{"), ("failures", "[1]"), ("failures", '[[7, "a"]]'),
        ("failures", '[[-1, "a"]]'), ("failures", "[" * 100_000),
    ],
)  # fmt: skip
def test_a_damaged_block_is_refused(tmp_path: Path, column: str, value: Any) -> None:
    path = tmp_path / "s.nc"
    interrupted(path)
    with contextlib.closing(sqlite3.connect(tmp_path / "s.nc.part")) as base:
        last = "(SELECT max(rowid) FROM block)"
        base.execute(f"UPDATE block SET {column} = ? WHERE rowid = {last}", (value,))
        base.commit()
    for read in (tn.open_sweep, lambda path: tn.sweep(quick, GRID, SAMPLES, 7, path=path)):
        with pytest.raises(tn.DataError, match=r"s\.nc\.part: the block of node .* is damaged"):
            read(path)


HUGE = "0x" + "f" * 900  # beyond the range of floating-point numbers


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("study = 'calibration'\nsample = 3", "2:1: got key 'sample', \\w+ some of study"),
        ("samples = 3", "1:1: study: got None, \\w+ one of calibration"),
        ("study = 3", "1:9: study: got 3, \\w+ one of calibration"),
        ("study = 'calibraton'", "1:9: study: got 'calibraton', \\w+ one of calibration"),
        ("study = 'calibration'\nsamples = 0", "2:11: samples: got 0, \\w+ a whole number"),
        ("study = 'calibration'\nsamples = 1.5", "2:11: samples: got 1.5, \\w+ a whole"),
        (f"study = 'calibration'\nsamples = {HUGE}", "2:11: samples: got 5104866514"),
        (f"study = 'calibration'\nseed = -{HUGE[2:]}", "2:8: got"),
        ("study = 'calibration'\nseed = -1", "2:8: seed: got -1, \\w+ a whole number from 0"),
        ("study = 'calibration'\n[grid]\nnois_um = [1]", "3:1: .*got 'nois_um', \\w+ one of"),
        ("study = 'calibration'\n[grid]\nnoise_um = 1", "3:12: axis noise_um: got 1, \\w+ a"),
        (
            "study = 'calibration'\n[grid]\nnoise_um = [0.1, 'x']",
            "3:18: noise_um: got 'x', \\w+ a number",
        ),
        (
            f"study = 'calibration'\n[grid]\nnoise_um = [0.1, {HUGE}]",
            "3:18: noise_um: got a whole number beyond 2.53",
        ),
        (
            "study = 'calibration'\ngrid = 3",
            "2:8: grid: got 3, expected names with values, as in",
        ),
        (f"study = 'calibration'\ngrid = {HUGE}", "2:8: grid: got [0-9]+\\.\\.\\."),
        (f"study = {HUGE}", "1:9: study: got 0xf+, \\w+ one of"),
        ("study = 'calibration'\n[fixed]\nlayout = 1979-05-27", "3:10: layout: got date"),
        ("study = 'calibration'\n[fixed]\nlayout = [[1]]", "3:10: layout: got"),
        ("study = 'calibration'\n[fixed]\nlength_mm = 1.0", "2:1: .*\\w+ less than"),
        (
            "study = 'calibration'\ngrid = " + "[" * 5000,
            "2:48: got tables or arrays nested",
        ),
        ("study = 'calibration'\nseed = " + "1" * 5000, "2:8: got 5000 characters"),
        ("study = ", "1:9: got 'study =', \\w+ TOML"),
    ],
)
def test_a_study_file_that_cannot_be_is_refused_with_its_place(
    tmp_path: Path, text: str, message: str
) -> None:
    study = tmp_path / "s.toml"
    study.write_text(text + "\n", encoding="utf-8")
    result = CliRunner().invoke(app, ["sweep", str(study)], terminal_width=1000)
    assert result.exit_code == 2, result.exception
    assert re.search(rf"s\.toml:{message}", result.output), result.output


def test_a_netcdf_file_of_something_else_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(path, engine="scipy")
    before = path.read_bytes()
    for read in (tn.open_sweep, run):
        with pytest.raises(tn.DataError, match="holds no sweep"):
            read(path)
    assert path.read_bytes() == before


def test_places_that_cannot_be_written_to(tmp_path: Path) -> None:
    with pytest.raises(tn.InputError, match="got a folder, expected the name of a file"):
        run(tmp_path)
    with pytest.raises(tn.InputError, match=r"there is no folder .* to write it to"):
        run(tmp_path / "no" / "s.nc")
    (tmp_path / "s.nc.lock").mkdir()
    with pytest.raises(tn.DataError, match="expected a folder that can be written to"):
        run(tmp_path / "s.nc")
    if os.geteuid() != 0:
        tmp_path.chmod(0o500)
        with pytest.raises(tn.DataError, match="expected a folder that can be written to"):
            run(tmp_path / "t.nc")


if __name__ == "__main__":
    if "fork" in sys.argv:
        with ProcessPoolExecutor(2, mp_context=get_context("fork")) as pool:
            run(Path(sys.argv[1]), executor=pool)
    else:
        run(Path(sys.argv[1]))
    print("finished")

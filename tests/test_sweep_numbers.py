"""Sweeps: random numbers by sample, the same whatever runs them, wherever they stop."""

import sqlite3
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.models.rotary.motions import harmonics
from trunnion.studies import FunctionStudy, Seeds

GRID = {"noise_um": [0.1, 0.5], "length_mm": [80.0, 120.0]}


def noisy(rng: np.random.Generator, scale: float, shift: float = 0.0) -> dict[str, float]:
    return {"value": shift + scale * rng.normal(), "uniform": rng.random()}


def calibrations(**how: Any) -> Any:
    return tn.sweep("calibration", GRID, samples=7, seed=5, progress=False, **how)


def test_calibrations_are_the_same_in_any_pieces_and_threads() -> None:
    whole = calibrations(threads=1)
    for how in ({"chunk": 1}, {"chunk": 3, "threads": 2}, {"chunk": 100}):
        assert whole.identical(calibrations(**how)), how


def test_functions_are_the_same_on_any_executor() -> None:
    grid = {"scale": [1.0, 2.0, 3.0]}
    here = tn.sweep(noisy, grid, samples=9, seed=2, progress=False)
    with ThreadPoolExecutor(3) as threads:
        there = tn.sweep(noisy, grid, 9, 2, threads, chunk=2, progress=False)
    assert here.identical(there)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        there = tn.sweep("calibration", GRID, 7, 5, processes, chunk=4, progress=False)
    assert there.identical(calibrations())


class Backwards:
    """An executor that runs what it was given in the opposite order, once it has enough."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = []
        self.timer: threading.Timer | None = None

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        if self.timer is not None:
            self.timer.cancel()
        future: Future[Any] = Future()
        self.waiting.append((future, function, arguments))
        self.timer = threading.Timer(0.05, self.run)
        self.timer.start()
        return future

    def run(self) -> None:
        while self.waiting:
            future, function, arguments = self.waiting.pop()
            future.set_result(function(*arguments))


def test_order_does_not_matter() -> None:
    there = tn.sweep(noisy, {"scale": [1.0, 2.0]}, 8, 3, Backwards(), chunk=2, progress=False)
    assert there.identical(tn.sweep(noisy, {"scale": [1.0, 2.0]}, 8, 3, progress=False))


def test_uniform_numbers_are_a_table_that_can_be_entered_anywhere() -> None:
    seeds = Seeds(3, 1)
    whole = seeds.uniform(0, 50, 14)
    assert np.array_equal(whole[17:23], seeds.uniform(17, 6, 14))
    assert not np.array_equal(whole[:6], Seeds(3, 2).uniform(0, 6, 14))
    assert not np.array_equal(whole[:6], Seeds(4, 1).uniform(0, 6, 14))
    big = seeds.uniform(0, 20_000, 14)
    assert abs(big.mean() - 0.5) < 4 / np.sqrt(12 * big.size)
    assert np.abs(np.corrcoef(big.T) - np.eye(14)).max() < 5 / np.sqrt(len(big))


def test_an_interrupted_sweep_goes_on_and_ends_with_the_same_numbers(tmp_path: Path) -> None:
    path = tmp_path / "s.nc"
    calls: list[float] = []

    def study(rng: np.random.Generator, scale: float) -> float:
        calls.append(scale)
        if len(calls) == 12:
            raise KeyboardInterrupt
        return float(scale * rng.normal())

    grid = {"scale": [1.0, 2.0, 3.0]}
    how: dict[str, Any] = {"samples": 5, "seed": 9, "progress": False, "chunk": 2}
    with pytest.raises(KeyboardInterrupt):
        tn.sweep(study, grid, path=path, **how)
    part = tn.open_sweep(path)
    done = int(part.attrs["samples_done"])
    assert 0 < done < 15
    assert int(np.isfinite(part["study"]).sum()) == done
    before = len(calls)
    found = tn.sweep(study, grid, path=path, **how)
    # The trial that asks for the names, and what was not there yet.
    assert len(calls) - before == 1 + 15 - done
    assert found.identical(tn.sweep(study, grid, **how))
    assert not path.with_name("s.nc.part").exists()
    again = tn.sweep(study, grid, path=path, **how)
    np.testing.assert_array_equal(again["study"], found["study"])
    assert again.attrs["seed"] == 9
    with pytest.raises(tn.DataError, match="another sweep: seed is 9 there, 10 here"):
        tn.sweep(study, grid, path=path, **{**how, "seed": 10})


def test_the_journal_holds_each_block_once(tmp_path: Path) -> None:
    from trunnion.studies.description import Description
    from trunnion.studies.grid import Grid
    from trunnion.studies.store import Journal
    from trunnion.studies.study import Block, Output

    journal = Journal(tmp_path / "j.part")
    outputs = (Output("value"),)
    journal.start(Description("study", Grid({}, {}), {}, 2, 1, outputs))
    with journal.writing() as write:
        write((0, 0, 2), Block(np.ones((2, 1))))
        write((0, 0, 2), Block(np.zeros((2, 1))))
    assert [block.columns.tolist() for _, block in journal.read()] == [[[1.0], [1.0]]]
    with sqlite3.connect(journal.path) as base:
        assert base.execute("SELECT count(*) FROM block").fetchone() == (1,)


def test_failing_samples_are_recorded_and_a_limit_ends_it() -> None:
    def study(rng: np.random.Generator, limit: float) -> float:
        value = float(rng.random())
        if value < limit:
            raise ValueError(f"{value:.3f} is too small")
        return value

    found = tn.sweep(study, {"limit": [0.0, 0.3]}, samples=50, seed=4, progress=False)
    failed = int(found.attrs["samples_failed"])
    assert failed == int(np.isnan(found["study"]).sum()) > 3
    assert found["failure_parameters"].values[0] == '{"limit": 0.3}'
    assert "is too small" in str(found["failure_error"].values[0])
    with pytest.raises(tn.DataError, match="samples failed, expected at most 10%"):
        tn.sweep(study, {"limit": [0.9]}, 100, 4, most_failures=0.1, progress=False)


@pytest.mark.parametrize(
    ("study", "grid", "how", "message"),
    [
        ("calibration", {"nois_um": [1.0]}, {}, "got 'nois_um', expected one of length_mm"),
        ("calibration", {"noise_um": []}, {}, "axis noise_um: got no values"),
        ("calibration", {"noise_um": ["0.1"]}, {}, "noise_um: got '0.1', expected a number"),
        ("calibration", {"noise_um": "0.1"}, {}, "expected a list"),
        ("calibration", {"noise_um": [float("nan")]}, {}, "expected a number"),
        ("calibration", {"noise_um": [-1.0]}, {}, "expected a finite number, 0 or above"),
        ("calibration", {"noise_um": [1.0, 1.0]}, {}, "a value twice"),
        ("calibration", {"repeats": [1.5]}, {}, "expected a whole number"),
        ("calibration", {"layout": ["under"]}, {}, "expected one of side, top"),
        ("calibration", {"noise_um": [1.0]}, {"fixed": {"noise_um": 1.0}}, "in one"),
        ("calibration", {}, {"samples": 10**9}, "expected at most"),
        ("calibration", {}, {"samples": 0}, "samples: got 0"),
        ("calibration", {}, {"seed": -1}, "seed: got -1"),
        ("calibraton", {}, {}, "got 'calibraton', expected one of calibration"),
        ("calibration", {"noise_um": range(10**12)}, {}, "got 1e.12 nodes, expected at most"),
        ("calibration", {"noise_um": range(10**30)}, {}, "nodes, expected at most"),
        ("calibration", {"noise_um": [10**400]}, {}, "expected a smaller one"),
        ("calibration", {"repeats": [10**9]}, {}, "expected a number from 1 to 1000"),
        ("calibration", {"identify": [True, False]}, {}, "expected it in fixed"),
        ("calibration", {"length_mm": [1.0, 2.0]}, {}, "expected less than artefact.length_mm"),
        ("calibration", {}, {"threads": 0}, "threads: got 0"),
        ("calibration", {}, {"threads": 10**6}, "threads: got 1000000"),
        ("calibration", {}, {"threads": "2"}, "threads: got '2'"),
        ("calibration", {}, {"executor": 3}, "executor: got 3, expected an object with submit"),
        ("calibration", {}, {"path": 3}, "path: got 3"),
        ("calibration", {}, {"most_failures": "a"}, "most_failures: got 'a'"),
        ("calibration", {}, {"units": {"a": "mm"}}, "units: got some"),
        ("diagnosis-power", {"effect": ["drfit_z"]}, {}, "effect: got 'drfit_z', expected one of"),
        (noisy, {}, {}, "scale: got nothing"),
        (noisy, {"scale": [1.0, "a"]}, {}, "values of several kinds"),
        (noisy, {"scale": [1.0]}, {"units": {"a": "mm"}}, "units: got 'a', expected one of value"),
        (lambda _, value: {"value": value}, {"value": [1.0]}, {}, "output named 'value'"),
        (lambda _: {"sample": 1.0}, {}, {}, "output named 'sample'"),
        (lambda _: {1: 1.0}, {}, {}, "name of an output: got 1"),
        (lambda _: {}, {}, {}, "no outputs"),
        (lambda _: 1j, {}, {}, "got 1j, expected a number"),
    ],
)
def test_bad_grids_are_refused_at_once(
    study: Any, grid: dict[str, Any], how: dict[str, Any], message: str
) -> None:
    with pytest.raises(tn.TrunnionError, match=message):
        tn.sweep(study, grid, progress=False, **how)


def test_outputs_go_by_name() -> None:
    def study(rng: np.random.Generator) -> dict[str, float]:
        draw = rng.random()
        found = {"one": 1.0, "two": 2.0} if draw < 0.5 else {"two": 2.0, "one": 1.0}
        return {"one": 1.0, "three": 3.0} if draw < 0.2 else found

    found = tn.sweep(study, samples=60, seed=1, progress=False)
    good = np.isfinite(found["one"].values)
    assert 30 < good.sum() < 60
    assert set(found["one"].values[good]) == {1.0}
    assert set(found["two"].values[good]) == {2.0}
    assert found.attrs["samples_failed"] == (~good).sum()
    assert "outputs: got one, three, expected" in str(found["failure_error"].values[0])


def test_the_first_node_may_fail() -> None:
    found = tn.sweep(lambda _, a: 1 / a, {"a": [0, 2]}, 3, progress=False)
    assert found["<lambda>"].sel(a=2).values.tolist() == [0.5] * 3
    assert "ZeroDivisionError" in str(found["failure_error"].values[0])


def test_files_keep_what_memory_has(tmp_path: Path) -> None:
    def study(rng: np.random.Generator, n: float, text: str = "µ", big: int = 10**12) -> float:
        return float(rng.random()) + len(f"{n}{text}{big}")

    axes: tuple[list[Any], ...] = ([10**10, 3], [1, 2], ["a b", "", "ü"], [True, False], [1.5])
    for number, axis in enumerate(axes):
        path = tmp_path / f"{number}.nc"
        found = tn.sweep(study, {"n": axis}, 2, path=path, progress=False)
        assert found["n"].values.tolist() == axis
        assert tn.open_sweep(path).identical(found)


def test_results_are_labelled() -> None:
    found = calibrations()
    assert dict(found.sizes) == {
        "noise_um": 2, "length_mm": 2, "sample": 7, "parameter": 14, "error": 8
    }  # fmt: skip
    assert found["noise_um"].attrs["units"] == "µm"
    error = found["identified_error"].sel(noise_um=0.1, length_mm=120.0, parameter="EX0C")
    assert error.shape == (7,)
    assert str(found["parameter_unit"].sel(parameter="EA0A").values) == "arcsec"
    assert found.attrs["seed"] == 5
    assert found.attrs["tick_um"] == 0.1
    units = FunctionStudy(noisy, {"value": "µm"}).outputs({"scale": 1.0})
    assert [(output.name, output.unit) for output in units] == [("value", "µm"), ("uniform", "")]


def test_a_node_that_cannot_be_fails_alone() -> None:
    # At 40 mm the sides of the arms are out of the probe's reach.
    found = tn.sweep(
        "calibration", {"length_mm": [100.0, 40.0]}, 3, 1, progress=False, most_failures=1.0
    )
    assert np.isfinite(found["identified_error"].sel(length_mm=100.0)).all()
    assert np.isnan(found["identified_error"].sel(length_mm=40.0)).all()
    assert "no touch 2" in str(found["failure_error"].values[0])


@pytest.mark.parametrize(("step_deg", "last"), [(10, 8), (20, 6), (30, 4), (45, 2)])
def test_no_order_is_offered_that_positions_do_not_tell_from_a_lower_one(
    step_deg: int, last: int
) -> None:
    turn = np.arange(0.0, 360.0, step_deg)
    encoder = np.concatenate([turn - 0.003, turn, turn + 0.002])  # three targets, read anew
    for positions in (turn, np.arange(0.0, 721.0, step_deg), np.unique(encoder)):
        assert list(harmonics(positions)) == list(range(1, last + 1))

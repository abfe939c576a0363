"""Hostile arguments to everything public: a result without nan, or an error of the package.

A short run; ``make fuzz`` is the long one (`tests/fuzz.py`).
"""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
import trunnion._core as core
from hostile import attack, calls, holds_nan, servo
from hostile_core import REFUSALS, core_calls, moves, touch_model
from mutated_files import diagnoses, formats, measurements, mutations
from result_examples import cross, finishing, profile, short
from trunnion import contouring, hybrid, nc, turning

PUBLIC_ROUNDS, CORE_ROUNDS, MUTATED, DIAGNOSED = 6, 20, 500, 195


@pytest.mark.parametrize("name", calls())
def test_the_good_call_is_good(name: str) -> None:
    function, good = calls()[name]
    assert not holds_nan(function(**good))


@pytest.mark.parametrize("name", core_calls())
def test_the_good_call_of_the_core_is_good(name: str) -> None:
    function, good = core_calls()[name]
    assert not holds_nan(function(**good))


def test_hostile_arguments_to_public_functions(capfd: pytest.CaptureFixture[str]) -> None:
    slow = ("compare_methods", "error_map", "diagnose", "catalogue")
    table = {name: call for name, call in calls().items() if name not in slow}
    assert list(attack(table, PUBLIC_ROUNDS, seed=1)) == []
    assert capfd.readouterr() == ("", "")


def test_hostile_arguments_to_the_core(capfd: pytest.CaptureFixture[str]) -> None:
    assert list(attack(core_calls(), CORE_ROUNDS, seed=2, allowed=REFUSALS)) == []
    assert capfd.readouterr() == ("", "")


def test_the_fuzzer_sees_what_is_wrong() -> None:
    def careless(x: Any) -> Any:
        return x[5] if isinstance(x, list) else math.nan

    found = " ".join(attack({"careless": (careless, {"x": 1.0})}, 100, seed=3))
    assert "nan" in found
    assert "IndexError" in found


# --- rows of the review


def correct(**options: Any) -> turning.Correction:
    z = np.arange(5.0, 45.0, 1.0)
    return turning.correct(finishing().program, (z, 12.0 * np.sin(z / 9.0)), **options)


def axis(**options: float) -> contouring.Servo:
    return contouring.Servo({**servo().axes, "X": contouring.LinearAxis(80.0, 5.0, **options)})


AXIS = np.array([80.0, 5.0, *[0.0] * 10, math.inf])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: correct(bound_um=1e100), "bound"),
        (lambda: correct(bound_um=1e12), "bound"),
        (lambda: correct(bound_um=2147483648), "bound"),
        (lambda: correct(bound_um=1e6), "bound"),
        (lambda: correct(unit_um=1e-6, window=4), "unit"),
        (lambda: touch_model().separate(moves(), [1] * 72, np.zeros(15)), "values: got 15"),
        (
            lambda: core.contour_axis_response("X", AXIS, math.nan, "motor", np.zeros(9)),
            "finite number",
        ),
        (
            lambda: contouring.simulate(short(), contouring.Feed(1.0, 2147483648)),
            "reference samples",
        ),
        (
            lambda: contouring.margins(axis(delay_ms=60.0), path=short()),
            "delay.* at most 20 control periods",
        ),
        (
            lambda: core.Machine("[w C' A' b X Y Z t]", 1.0, []).inverse_exact(
                np.full((1, 6), math.nan), np.zeros((1, 5))
            ),
            "finite",
        ),
        (
            lambda: touch_model().fit(
                moves(), np.zeros(14), huber=None, sigma_um=math.nan, priors=[], max_steps=9
            ),
            "finite",
        ),
        (lambda: short().points_mm(None), "u: got None"),  # type: ignore[arg-type]
        (lambda: short().at_length(math.nan), "s_mm: got nan"),
        (lambda: tn.printed_zeros({}, setup_yaw_arcsec=math.inf), "setup_yaw_arcsec: got inf"),
        (
            lambda: turning.probe_path(profile(), chuck_radius_mm=10.0).stations_mm(math.inf),
            "pitch_mm: got inf",
        ),
        (
            lambda: turning.probe_path(profile(), chuck_radius_mm=10.0).contact_z_mm(0, [math.nan]),
            "z_mm: got",
        ),
        (
            lambda: tn.residual_interval(
                cross()[1], tn.identify(*cross()), degrees_of_freedom=5e-324
            ),
            "residual_interval: got numbers too large or too small",
        ),
        (lambda: tn.compare_methods(*cross(), truth={"EX0C": math.nan}), "truth.EX0C: got nan"),
        (
            lambda: nc.follow(finishing().program, start=(0, 0, 0, math.nan, 0, 0)),
            r"start\[3\]: got nan",
        ),
        (lambda: hybrid.Mechanism().ballbar([1.0] * 5, [math.inf, 0, 0]), "centres_mm"),
        (lambda: tn.sample_path("x" * 5000), "sample: got"),
        (lambda: tn.forward_kinematics(cross()[1], [[1j, 0, 0, 0, 0]]), "axes: got .*, expected"),
        (lambda: contouring.Coupling(gains=np.full((5, 3), 1j)), "gains: got"),
        (lambda: tn.Probe(repeatability_um=1e300), "repeatability_um: got 1e\\+300"),
        (lambda: tn.Artefact("cuboid", length_mm=5e48), "length_mm: got 5e\\+48"),
        (
            lambda: cross()[0].with_columns(c_deg=cross()[0]["c_deg"] + 360e9),
            r"c_deg \(row 0\).*±1e\+06",
        ),
    ],
)
def test_what_used_to_panic_hang_or_give_nan_is_refused(
    call: Callable[[], object], message: str
) -> None:
    with pytest.raises(tn.TrunnionError, match=message):
        call()


@pytest.mark.parametrize(
    "options",
    [
        {"breakaway_um": 1e300},
        {"breakaway_um": 1e30, "coulomb_um": 1.0, "stribeck_mm_min": 1e-300},
        {"cyclic_um": 1e300, "pitch_mm": 1e-300},
        {"resonance_hz": 1e300, "damping": 0.1},
        {"resonance_hz": 1e-300, "damping": 0.1, "backlash_um": 1e300},
    ],
)
def test_extreme_axes_run_diverge_or_are_refused(options: dict[str, float]) -> None:
    try:
        run = contouring.simulate(short(), 1000.0, servo=axis(**options))
    except tn.TrunnionError:
        return
    assert not holds_nan(run)


def test_mutated_files() -> None:
    assert list(mutations(MUTATED, seed=4)) == []


def test_mutated_data_are_diagnosed() -> None:
    """Every kind as often; a result that is text and JSON, or an error that names the file."""
    assert list(diagnoses(DIAGNOSED, seed=5)) == []


def test_the_fuzzer_sees_what_is_wrong_with_a_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    good = tn.diagnose

    def says(error: Exception | None, **fields: Any) -> str:
        def careless(data: Any, setup: Any) -> Any:
            if error is not None:
                raise error
            return replace(good(data, setup), **fields)

        monkeypatch.setattr(tn, "diagnose", careless)
        return " ".join(diagnoses(len(measurements()), seed=5))

    assert "KeyError" in says(KeyError("x"))
    assert "without a place: no file" in says(tn.DataError("no file"))
    assert says(tn.DataError("line 3 of mutated.csv: no")) == ""
    assert ": nan" in says(None, notes=(math.nan,))


@pytest.mark.parametrize("name", formats())
def test_the_good_file_is_good(name: str, tmp_path: Path) -> None:
    reader, raw = formats()[name]
    path = tmp_path / "file"
    path.write_bytes(raw)
    reader(path)

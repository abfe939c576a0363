"""Unexplained structure widens the errors that it stands for."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import positioning_twin
import trunnion as tn
from power.study import ground
from trunnion.diagnosis import structure
from trunnion.diagnosis.fit import fit
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Floats = NDArray[np.float64]
CURVES: dict[str, Callable[[Floats], Floats]] = {
    "square root": np.sqrt,
    "hump": lambda t: np.asarray(np.sin(np.pi * t) * np.exp(-2.0 * t)),
    "sigmoid": lambda t: np.asarray(1.0 / (1.0 + np.exp(-12.0 * (t - 0.4)))),
}


def drifting(curve: str, plan: str, seed: int) -> tuple[tn.Touches, tn.Setup, Truth]:
    """Touches of a machine that moves along X by 20 µm as a curve of time that begins at 0."""
    rng = np.random.default_rng(seed)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
    made, setup, _, read = ground(plan)
    measured = measure(made, setup, truth, noise_um=0.3, tick_um=0.1, seed=seed)
    columns = {k: np.array(v) for k, v in measured.columns.items()}
    moved_um = 20.0 * CURVES[curve](columns["time_s"] / columns["time_s"].max())
    along = columns["dir_x"] * moved_um * 1e-3  # what of it a touch reads
    for axis in "xyz":
        columns[f"{axis}_mm"] -= along * columns[f"dir_{axis}"]
    return tn.Touches(columns), read, truth


@pytest.mark.parametrize("plan", ["paper", "rich"])
@pytest.mark.parametrize("curve", CURVES)
def test_a_curve_of_time_without_a_cause_is_in_the_standard_errors(curve: str, plan: str) -> None:
    """EX0C is that of the mean of the curve, up to 13 µm off at the start."""
    data, setup, truth = drifting(curve, plan, seed=11)
    d = tn.diagnose(data, setup)
    assert d.verdict == "unexplained"
    for name, true in truth.errors.items():
        assert abs(d.errors_after[name] - true) < 3.5 * d.errors_std[name], name
    # what the curve does not touch is as well known as without it
    assert d.errors_std["EY0C"] < 0.3
    if np.isinf(d.errors_std["EX0C"]):
        assert "EX0C" in d.not_identifiable
        return
    assert 1.0 < d.errors_std["EX0C"] < 20.0
    assert d.model.std_errors["EX0C"] == d.errors_std["EX0C"]
    # of the structure, or of a drift that is named beside it
    assert any("leaves open: EX0C ± " in note for note in d.notes)
    assert "model selection" in d.budget(("EX0C",)).to_json()


def with_a_wave(wave: Callable[[Floats, Floats], Floats], seed: int) -> tn.Ballbar:
    """Two turns of a circle, of which the length is off by a function of the angle and Y, in mm."""
    turn = np.radians(np.arange(0.0, 720.0, 2.0))
    x, y = 100.0 * np.cos(turn), 100.0 * np.sin(turn)
    noise = 3e-4 * np.random.default_rng(seed).standard_normal(len(turn))
    return tn.Ballbar(
        setup=np.ones(len(turn), dtype=int),
        x_mm=x,
        y_mm=y,
        length_mm=100.0 + wave(turn, y) + noise,
        sense=np.ones(len(turn), dtype=int),
        feed_mm_min=np.full(len(turn), 1000.0),
        time_s=6.0 * turn,
    )


def test_structure_of_one_measurement_leaves_nothing_open_of_another() -> None:
    """A wave in the ball-bar's readings only, which say nothing of EX0C."""
    made, twin, _, setup = ground("rich")
    truth = Truth(errors={}, placement=random_placement(np.random.default_rng(4)), effects={})
    still = tn.Touches(measure(made, twin, truth, noise_um=0.3, seed=4).columns)
    circle = with_a_wave(lambda turn, y: 3e-3 * np.sin(2 * np.pi * y / 47.0) * np.cos(turn), 5)
    alone, together = tn.diagnose(still, setup), tn.diagnose([still, circle], setup)
    assert together.structure is not None
    assert together.structure.effect.covariate.endswith(" of ballbar")
    assert together.errors_std["EX0C"] == pytest.approx(alone.errors_std["EX0C"], rel=0.2)


def test_structure_is_fitted_beside_causes_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """When idle causes are sought; the report takes that fit."""
    fitted: list[tuple[str, ...]] = []

    def counted(*given: Any) -> Any:
        fitted.append(tuple(sorted(effect.id for effect in given[2])))
        return fit(*given)

    monkeypatch.setattr(structure, "fit", counted)
    rng = np.random.default_rng(13)
    effects = {"scale_x": {"ppm": 400.0}}
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    made, twin, _, setup = ground("rich")
    columns = measure(made, twin, truth, noise_um=0.3, seed=13).columns
    turn = np.radians(columns["c_deg"])
    for axis in "xyz":
        along = columns[f"dir_{axis}"] * np.sin(5 * turn)
        columns[f"{axis}_mm"] = columns[f"{axis}_mm"] + 4e-3 * along
    d = tn.diagnose(tn.Touches(columns), setup)
    assert d.structure is not None
    assert d.causes
    assert len(fitted) == len(set(fitted)) > 0


PLACED: dict[str, Callable[[Floats], Floats]] = {
    "dent": lambda t: np.asarray(np.exp(-(((t - 0.35) / 0.2) ** 2))),
    "kink": lambda t: np.asarray(np.abs(2.0 * t - 1.1)),
    "wave": lambda t: np.asarray(np.sin(2 * np.pi * t / 0.8) ** 2),
}


@pytest.mark.parametrize("seed", [3, 14])
@pytest.mark.parametrize("shape", PLACED)
def test_a_curve_of_a_place_without_a_cause_is_in_the_standard_errors(
    shape: str, seed: int
) -> None:
    """EX0C is that of its mean over the places: of a guide that is straight elsewhere it is off."""
    rng = np.random.default_rng(seed)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
    made, twin, _, setup = ground("rich")
    measured = measure(made, twin, truth, noise_um=0.3, tick_um=0.1, seed=seed)
    columns = {k: np.array(v) for k, v in measured.columns.items()}
    place = columns["y_mm"]
    moved_um = 6.0 * PLACED[shape]((place - place.min()) / np.ptp(place))
    along = columns["dir_x"] * moved_um * 1e-3  # what of it a touch reads
    for axis in "xyz":
        columns[f"{axis}_mm"] -= along * columns[f"dir_{axis}"]
    d = tn.diagnose(tn.Touches(columns), setup)
    assert d.verdict == "unexplained"
    assert d.structure is not None
    assert "Y place" in d.structure.effect.covariate
    for name, true in truth.errors.items():
        assert abs(d.errors_after[name] - true) < 3.5 * d.errors_std[name], name
    assert 1.0 < d.errors_std["EX0C"] < 6.0
    assert d.errors_std["EY0C"] < 0.3  # in which the curve does not enter
    assert any("leaves open: EX0C ± " in note for note in d.notes)


def test_structure_of_each_of_two_measurements_is_in_the_standard_errors() -> None:
    """A wave in time of a circle is stated; one along Y of the touches leaves EX0C open, too."""
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
        made, twin, _, setup = ground("rich")
        measured = measure(made, twin, truth, noise_um=0.3, seed=seed)
        columns = {k: np.array(v) for k, v in measured.columns.items()}
        place = columns["y_mm"]
        moved_um = 4.0 * np.sin(2 * np.pi * (place / 44.0 + rng.uniform()))
        along = columns["dir_x"] * moved_um * 1e-3
        for axis in "xyz":
            columns[f"{axis}_mm"] -= along * columns[f"dir_{axis}"]
        circle = with_a_wave(lambda turn, _: 3e-3 * np.sin(12.3 * turn), seed)
        d = tn.diagnose([tn.Touches(columns), circle], setup)
        assert abs(d.errors_after["EX0C"] - truth.errors["EX0C"]) < 2 * d.errors_std["EX0C"]
        assert d.errors_std["EX0C"] > 1.0
        assert d.errors_std["EY0C"] < 0.3


@pytest.mark.parametrize("longer_um", [0.0, 30.0])
def test_the_mean_of_a_drift_may_be_all_of_a_length(longer_um: float) -> None:
    """A drift that begins at 0 has a mean; a bar that is off by far more than the drift is off."""

    def drift(turn: Floats, _: Floats) -> Floats:
        return np.asarray(1e-3 * (5.0 * (turn / turn.max()) ** 3 + longer_um))

    d = tn.diagnose(with_a_wave(drift, 3))
    assert d.unexplained is not None
    (length,) = (cause for cause in d.causes if cause.id == "ballbar_length")
    off = abs(length.parameters["dl_um"] - longer_um)
    assert off < 2.0 * length.std_errors["dl_um"]
    if longer_um:
        assert length.probability > 0.99
        assert d.none_probability < 0.01
    else:
        assert length.probability < 0.2
        assert length.p_value > 0.1
        assert d.none_probability > 0.5


def test_structure_that_is_small_beside_large_causes_is_stated() -> None:
    """A wave of 1 µm beside a bar that is 40 µm too long, which explains nearly all there is."""

    def wave(turn: Floats, _: Floats) -> Floats:
        return np.asarray(1e-3 * (np.sin(5.0 * turn) + 40.0))

    d = tn.diagnose(with_a_wave(wave, 4))
    assert d.named == {"ballbar_length"}
    assert d.verdict == "explained"
    assert "Left unexplained: the residual depends on" in d.summary()
    assert d.structure is not None


@pytest.mark.parametrize("seed", [4, 6, 10])
def test_a_wave_at_three_places_leaves_one_error_open(seed: int) -> None:
    """Touches along X are at three places of Y: they do not distinguish a wave from a curve."""
    setup = tn.Setup(tn.Artefact("cross"))
    data = tn.simulate(tn.plan(setup), setup, {"EX0C": 12.0}, noise_um=0.4, seed=seed)
    wave = 3e-3 * np.cos(2 * np.pi * np.round(data["y_mm"], 1) / 31.0 + 0.4)
    d = tn.diagnose(data.with_columns(x_mm=data["x_mm"] + wave), setup)
    assert d.structure is not None
    assert d.structure.effect.shape == "polynomial"
    assert np.all(np.isfinite(list(d.structure.std_errors.values())))
    assert max(map(abs, d.structure.parameters.values())) < 10.0
    assert np.isfinite(d.errors_std["EX0C"])
    assert max(std for name, std in d.errors_std.items() if name != "EX0C") < 1.5


def test_a_squareness_beside_a_wave_that_comes_back_is_known() -> None:
    """The slope of 3.5 periods of a wave is that of a sine."""

    def off(turn: Floats, y: Floats) -> Floats:
        x = 100.0 * np.cos(turn)
        along_y = 2e-3 * np.cos(3.5 * np.pi * x / 100.0 + 0.7) - 6.0 / 206265.0 * x
        return np.asarray(along_y * y / 100.0)

    d = tn.diagnose(with_a_wave(off, 3))
    assert d.structure is not None
    assert (d.structure.effect.shape, d.structure.effect.covariate) == ("wave", "X position")
    (squareness,) = (cause for cause in d.causes if cause.id == "squareness_xy")
    (value,), (std,) = squareness.parameters.values(), squareness.std_errors.values()
    assert std < 0.5
    assert abs(abs(value) - 6.0) < 3.0 * std


def test_a_long_bar_explains_nothing_of_touches() -> None:
    """What a fifth of the rms is, of which causes may leave structure, is of the same readings."""
    setup = tn.Setup(tn.Artefact("cross"))
    data = tn.simulate(tn.plan(setup), setup, {"EX0C": 12.0}, noise_um=0.4, seed=4)
    wave = 3e-3 * np.cos(2 * np.pi * np.round(data["y_mm"], 1) / 31.0 + 0.4)
    touched = data.with_columns(x_mm=data["x_mm"] + wave)
    circle = with_a_wave(lambda turn, _: np.full(len(turn), 20e-3), 4)
    d = tn.diagnose([touched, circle], setup)
    assert d.verdict == tn.diagnose(touched, setup).verdict == "unexplained"
    assert "ballbar:ballbar_length" in d.named


@pytest.mark.parametrize("seed", range(4))
def test_a_drift_that_begins_slowly_is_a_curve_of_time(seed: int) -> None:
    """It was a steady drift less a warm-up, each many times as large, both > 99 %."""
    data = positioning_twin.axis(np.random.default_rng([7, seed]), noise=0.4)
    at = np.linspace(0.0, 1.0, len(data))
    d = tn.diagnose(data.with_columns(measured_mm=data.measured + 8e-3 * at**2))
    assert d.verdict == "unexplained"
    assert "time (quadratic)" in (d.unexplained or "")
    assert "warmup" not in d.named
    steady = tn.diagnose(data.with_columns(measured_mm=data.measured + 8e-3 * at))
    assert steady.named == {"drift"}
    assert not any("tell what both make together" in note for note in steady.notes)

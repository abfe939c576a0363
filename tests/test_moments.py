"""The moment of a slip and the place of a kink come with an uncertainty that is true."""

from __future__ import annotations

import numpy as np

import trunnion as tn
from power.study import draw_effects, ground
from promise import kept, needed_runs
from trunnion.diagnosis.effect import Effect, Parameter
from trunnion.diagnosis.moments import determined
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

COVERED = 0.95


def moments(rms_um: float) -> tuple[np.ndarray, np.ndarray]:
    """Deviation of the named moment of a slip and its standard error, of many measurements, s."""
    made, setup, _, read = ground("paper")
    found: list[tuple[float, float]] = []
    for seed in range(2 * needed_runs(COVERED)):
        if len(found) == needed_runs(COVERED):
            break
        rng = np.random.default_rng([seed, 17])
        hidden = draw_effects(rng, "paper", 1, rms_um, ("setup_shift",))
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
        measured = measure(made, setup, truth, noise_um=0.5, tick_um=0.1, seed=seed)
        for cause in tn.diagnose(tn.Touches(measured.columns), read).causes:
            if cause.id == "setup_shift":
                off = cause.parameters["t0_s"] - hidden["setup_shift"]["t0_s"]
                found.append((off, cause.std_errors["t0_s"]))
    off, std = np.array(found).T
    return off, std


def test_the_moment_of_a_slip_lies_within_its_uncertainty() -> None:
    off, std = moments(0.7)
    assert np.isfinite(std).all()
    assert kept(int(np.sum(np.abs(off) < 2 * std)), len(off), COVERED)
    # Not by saying nothing: a moment known within a tenth of the measurement.
    assert np.median(std) < 15.0


def kinked(size_um_m: float, seed: int) -> tn.Levels:
    """Levels at uneven places of a line, with a kink between 300 and 325 mm."""
    place = np.arange(0.0, 1000.0, 25.0)
    place[20:] += 10.0
    noise = np.random.default_rng(seed).normal(0.0, 2.0, len(place))
    slope = np.where(place > 312.5, size_um_m, 0.0)
    return tn.Levels({"position_mm": place, "along_um_m": slope + noise})


def test_the_place_of_a_kink_is_between_two_readings() -> None:
    """Where nothing else is near, a place is uniform between readings: 25 mm / √12."""
    (cause,) = (c for c in tn.diagnose(kinked(60.0, 1)).causes if c.id == "kink")
    assert abs(cause.parameters["at_mm"] - 312.5) < 12.5
    np.testing.assert_allclose(cause.std_errors["at_mm"], 25 / np.sqrt(12), rtol=0.1)
    assert "not identifiable" not in cause.size()


def test_the_place_of_a_kink_below_a_level_lies_within_its_uncertainty() -> None:
    """A level that stands astride it reads a part of it: as a chain, its feet are 50 mm apart."""
    runs, inside, std = needed_runs(COVERED), 0, []
    for seed in range(runs):
        rng = np.random.default_rng([seed, 3])
        middle = np.tile(25.0 + 50.0 * np.arange(20), 2)
        sense = np.repeat([1.0, -1.0], 20)
        joint, angle = rng.uniform(200.0, 800.0), rng.uniform(10.0, 60.0)
        front, back = (np.maximum(middle + d - joint, 0.0) for d in (25.0, -25.0))
        read = sense * (30.0 + angle * (front - back) / 50.0) + rng.standard_normal(40)
        turn = np.where(sense > 0, 0, 180)
        d = tn.diagnose(tn.Levels(position_mm=middle, along_um_m=read, turn_deg=turn))
        (kink,) = (c for c in d.causes if c.id == "kink")
        std.append(kink.std_errors["at_mm"])
        inside += abs(kink.parameters["at_mm"] - joint) < 2 * std[-1]
    assert kept(inside, runs, COVERED)
    assert np.median(std) < 5.0


def test_standard_errors_of_a_pitch_cover_another_one_that_fits_about_as_well() -> None:
    """The one said was up to 25 standard errors off."""
    off: list[float] = []
    for seed in range(100):
        rng = np.random.default_rng([seed, 53])
        a, b = rng.uniform(0.3, 0.6, 2) * rng.choice([-1, 1], 2)
        pitch, sense = rng.uniform(8.0, 16.0), np.repeat([1, -1], 90)
        turn = np.radians(1.0 + 4.0 * np.concatenate([np.arange(90), np.arange(90)[::-1]]))
        x, y = 100.0 * np.cos(turn), 100.0 * np.sin(turn)
        wave = a * np.cos(2 * np.pi * x / pitch) + b * np.sin(2 * np.pi * x / pitch)
        length = 100.0 + 1e-3 * (np.cos(turn) * wave + rng.normal(0.0, 0.6, 180))
        columns = {"x_mm": x, "y_mm": y, "z_mm": 0.0 * x, "length_mm": length, "sense": sense}
        setup = np.ones(180, dtype=int)
        found = tn.diagnose(tn.Ballbar({"setup": setup, **columns})).causes
        off += [
            (c.parameters["pitch_mm"] - pitch) / c.std_errors["pitch_mm"]
            for c in found
            if c.id == "cyclic_x"
        ]
    assert len(off) > 80
    assert np.max(np.abs(off)) < 5.0


def test_a_parameter_that_may_have_any_value_is_not_determined() -> None:
    """It was stated as 0 ± 16000 min."""
    tau = Parameter("tau_min", "min", (1.0, 3.0, 9.0))
    effect = Effect("warmup", (Parameter("amplitude_um"), tau), lambda _: np.zeros(3))
    known = {"amplitude_um": 2.4, "tau_min": 7.9}
    assert determined(effect, known) == known
    assert determined(effect, {**known, "tau_min": 16000.0}) == {**known, "tau_min": np.inf}

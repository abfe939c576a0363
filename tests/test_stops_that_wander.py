"""Stops and levels that wander in time, as no cause does: what is named, and how uncertain it is.

Random walks and slow autoregressions, made with numpy alone.
"""

import numpy as np
import pytest

import trunnion as tn

SCALE_PPM, REVERSAL_UM, NOISE_UM = 12.0, 2.0, 0.25
SAID = "in turn are off alike"
SURE = 0.9


def walk(rng: np.random.Generator, count: int, step: float) -> np.ndarray:
    """A random walk."""
    return np.cumsum(rng.normal(0.0, step, count))


def slow(rng: np.random.Generator, count: int, size: float, length: float) -> np.ndarray:
    """An autoregression of first order, of this rms, correlated over so many readings."""
    share = np.exp(-1.0 / length)
    out = rng.normal(0.0, size, count)
    for i in range(1, count):
        out[i] = share * out[i - 1] + (1.0 - share**2) ** 0.5 * out[i]
    return out


def stops(
    rng: np.random.Generator, wanders: np.ndarray, causes: float, *, times: bool = True
) -> tn.Positioning:
    """Five cycles over 11 targets; ``causes``: times a scale and a reversal."""
    target = np.round(5.0 + 49.0 * np.arange(11) + rng.uniform(-5.0, 5.0, 11), 2)
    where = np.tile(np.concatenate([target, target[::-1]]), 5)
    sense = np.tile(np.repeat([1, -1], 11), 5)
    error = causes * (1e-3 * SCALE_PPM * (where - target.mean()) + REVERSAL_UM * sense / 2)
    error = error + wanders + rng.normal(0.0, NOISE_UM, 110)
    columns = {
        "target_mm": where,
        "measured_mm": where + 1e-3 * np.round(error, 2),
        "direction": sense,
        "cycle": np.repeat(np.arange(1, 6), 22),
        "axis": ["X"] * 110,
    }
    if times:
        columns["time_s"] = 9.0 * np.arange(110)
    return tn.Positioning(columns)


def said(d: tn.Diagnosis) -> bool:
    return any(SAID in note for note in d.notes)


def surely_named(d: tn.Diagnosis) -> set[str]:
    return {c.id for c in d.causes if c.probability > SURE}


WANDERS = {
    "small steps": lambda rng: walk(rng, 110, 0.1),
    "large steps": lambda rng: walk(rng, 110, 0.25),
    "slow": lambda rng: slow(rng, 110, 0.7, 25.0),
}


@pytest.mark.parametrize("times", [True, False])
@pytest.mark.parametrize("kind", WANDERS)
def test_stops_that_wander_have_no_cause(kind: str, *, times: bool) -> None:
    """White noise gave one in five a warm-up, a drift or a scale, a third without times."""
    named = 0
    for seed in range(30):
        rng = np.random.default_rng([seed, 71])
        named += bool(surely_named(tn.diagnose(stops(rng, WANDERS[kind](rng), 0.0, times=times))))
    assert named <= 3


@pytest.mark.parametrize("kind", WANDERS)
def test_causes_beside_a_wander_are_found_and_as_uncertain_as_it_makes_them(kind: str) -> None:
    """Where it is stated; by white noise deviations were 1.6 to 2 standard errors rms."""
    deviations, found, others = [], 0, 0
    true = {"scale": ("ppm", SCALE_PPM), "reversal": ("b_um", REVERSAL_UM)}
    for seed in range(30):
        rng = np.random.default_rng([seed, 72])
        d = tn.diagnose(stops(rng, WANDERS[kind](rng), 1.0))
        for c in d.causes:
            if c.id in true:
                name, value = true[c.id]
                off = (c.parameters[name] - value) / c.std_errors[name]
                deviations += [off] if said(d) else []
                found += c.probability > SURE
        others += bool(surely_named(d) - true.keys())
    assert found >= 0.9 * 2 * 30
    assert others <= 3
    assert len(deviations) >= 30
    assert np.sqrt(np.mean(np.square(deviations))) < 1.3


def test_a_wander_is_stated() -> None:
    count = [0, 0]
    for seed in range(20):
        rng = np.random.default_rng([seed, 73])
        for i, step in enumerate((0.0, 0.25)):
            d = tn.diagnose(stops(rng, walk(rng, 110, step), 1.0))
            count[i] += said(d)
    assert count[0] == 0
    assert count[1] >= 14


def test_a_warm_up_is_no_wander() -> None:
    for seed in range(10):
        rng = np.random.default_rng([seed, 74])
        warmer = 5.0 * (1.0 - np.exp(-np.arange(110) / 40.0))
        d = tn.diagnose(stops(rng, warmer, 1.0))
        assert {"scale", "reversal"} <= surely_named(d)
        assert "warmup" in {c.id for c in d.causes}
        assert not said(d)


def test_a_stop_set_aside_acts_on_no_other() -> None:
    compared = 0
    for seed in range(8):
        rng = np.random.default_rng([seed, 75])
        made = stops(rng, walk(rng, 110, 0.25), 1.0)
        off = np.array(made.measured)
        off[57] += 0.02  # a chip
        d, clean = tn.diagnose(made.with_columns(measured_mm=off)), tn.diagnose(made)
        assert d.outliers == (57,)
        if not (said(d) and said(clean)):
            continue
        compared += 1
        a, b = (next(c for c in x.causes if c.id == "reversal") for x in (d, clean))
        sigma = b.std_errors["b_um"]
        assert a.parameters["b_um"] == pytest.approx(b.parameters["b_um"], abs=0.5 * sigma)
        assert a.std_errors["b_um"] == pytest.approx(sigma, rel=0.3)
    assert compared >= 4


def test_a_level_that_wanders_drifts_less_often() -> None:
    """By white noise 35 of 60 such levels drifted."""
    place = 100.0 + 200.0 * np.arange(15)
    named = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 76])
        along = 20.0 + walk(rng, 60, 0.2) + rng.normal(0.0, 1.0, 60)
        across = -7.0 + walk(rng, 60, 0.2) + rng.normal(0.0, 1.0, 60)
        where = np.tile(np.concatenate([place, place[::-1]]), 2)
        columns = {
            "position_mm": where,
            "along_um_m": np.round(along, 2),
            "across_um_m": np.round(across, 2),
            "time_s": 20.0 * np.arange(60),
        }
        named += bool(surely_named(tn.diagnose(tn.Levels(columns))))
    assert named <= 14

"""One bad touch among those of a plan is named and left out; heavy tails are not.

A touch that the others miss by a large t value (its deleted residual over the noise of the others)
is an outlier, unless the others show tails that make such readings. Which touches the others check
at all is worked out here from differences of simulated readings, not from the diagnosis.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import trunnion as tn
from promise import kept, needed_runs
from trunnion import Artefact, Setup
from trunnion.base.units import Floats
from trunnion.diagnosis import outliers

SETUP = Setup(artefact=Artefact("cross"))
ERRORS = ("EX0C", "EY0C", "EB0C", "EY0A", "EZ0A", "EA0A", "EB0A", "EC0A")
PLACES = ("dx_um", "dy_um", "dz_um", "ra_arcsec", "rb_arcsec", "rc_arcsec")
PAPER = tn.plan(SETUP)
NAMED = 0.95
NAMED_AT_TEN = 0.75
CONSISTENT = 0.95
LEVEL = 0.01  # of sound data in which readings are set aside
CHECKED = 0.5  # of a touch that the others check


@cache
def leverages() -> Floats:
    """Leverage of each touch of the plan under the plain model."""
    columns = [along(tn.simulate(PAPER, SETUP, {name: 1.0})) for name in ERRORS]
    columns += [along(tn.simulate(PAPER, SETUP, {}, {name: 1.0})) for name in PLACES]
    jacobian = np.stack(columns, axis=1) - along(tn.simulate(PAPER, SETUP))[:, None]
    left, size, _ = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=0), full_matrices=False)
    return np.asarray(np.sum(left[:, size > 1e-6 * size[0]] ** 2, axis=1))


def along(data: tn.Touches) -> Floats:
    """Readings along their approaches, µm."""
    return np.asarray(sum(1e3 * data[f"{a}_mm"] * data[f"dir_{a}"] for a in "xyz"))


def off(data: tn.Touches, shift_um: Floats) -> tn.Touches:
    """Touches that trip later along their approaches."""
    moved = {f"{a}_mm": data[f"{a}_mm"] + 1e-3 * shift_um * data[f"dir_{a}"] for a in "xyz"}
    return data.with_columns(**moved)


def sound(rng: np.random.Generator, noise_um: float, seed: int) -> tn.Touches:
    """Touches of a random machine."""
    errors = {name: float(rng.uniform(-25, 25)) for name in ERRORS}
    places = {name: float(rng.uniform(-50, 50)) for name in PLACES}
    return tn.simulate(PAPER, SETUP, errors, places, noise_um=noise_um, seed=seed)


def run(sigmas: float, seed: int, count: int = 1) -> tuple[tn.Diagnosis, tuple[int, ...], float]:
    """Diagnose with some touches, which the others check, off by so many times the noise."""
    rng = np.random.default_rng([seed, count])
    noise = rng.uniform(0.5, 1.0)
    data = sound(rng, noise, seed)
    bad = rng.choice(np.flatnonzero(leverages() < CHECKED), count, replace=False)
    shift = np.zeros(len(data))
    shift[bad] = sigmas * noise * rng.choice([-1, 1], count)
    return tn.diagnose(off(data, shift), SETUP), tuple(np.sort(bad).tolist()), noise


def test_the_plan_checks_most_touches() -> None:
    assert leverages().sum() == pytest.approx(14.0)
    assert np.mean(leverages() < CHECKED) > 0.9


def test_one_to_three_bad_touches_are_named_and_left_out() -> None:
    runs = needed_runs(NAMED)
    seen = [run(20.0, seed, 1 + seed % 3) for seed in range(runs)]
    assert kept(sum(set(bad) <= set(d.outliers) for d, bad, _ in seen), runs, NAMED)
    assert kept(sum(not d.causes for d, *_ in seen), runs, NAMED)
    assert 0.95 < np.median([d.sigma / noise for d, _, noise in seen]) < 1.05


@pytest.mark.power
def test_a_touch_at_ten_sigma_is_mostly_named() -> None:
    """Not always: 71 touches cannot tell noise without tails from noise that has some."""
    runs = needed_runs(NAMED_AT_TEN)
    seen = [run(10.0, seed) for seed in range(runs)]
    assert kept(sum(bad[0] in d.outliers for d, bad, _ in seen), runs, NAMED_AT_TEN)


def test_sound_touches_are_kept() -> None:
    runs = needed_runs(CONSISTENT)
    seen = [run(0.0, seed)[0] for seed in range(runs)]
    assert kept(sum(d.verdict == "consistent" for d in seen), runs, CONSISTENT)
    assert kept(sum(not d.outliers for d in seen), runs, 1.0 - LEVEL)


@pytest.mark.parametrize("count", [72, 500])
def test_readings_are_set_aside_at_the_level_whatever_the_tails(count: int) -> None:
    """Of noise from normal to one whose third moment is infinite, on average."""
    rng, runs, tails = np.random.default_rng(count), 250, (3, 4, 6, 10, 30, 1000)
    drawn = (np.abs(rng.standard_t(nu, (runs, count))) for nu in tails)
    kept_all = [len(outliers.far_out(one, float(count))) == 0 for some in drawn for one in some]
    assert kept(sum(kept_all), len(kept_all), 1.0 - LEVEL)


def test_a_residual_is_judged_by_the_spread_that_its_fit_gives_it() -> None:
    """Noise alone: no size is larger for a reading that the fit uses much, or not at all."""
    rng = np.random.default_rng(3)
    basis = np.linalg.qr(np.column_stack([np.ones(30), np.r_[12.0, rng.standard_normal(29)]]))[0]
    bad = np.arange(30) == 5
    sizes = [
        outliers.robust_sizes(basis, rng.standard_normal(30) + 50.0 * bad) for _ in range(2000)
    ]
    far = np.quantile(np.array(sizes)[:, ~bad], 0.99, axis=0)
    assert np.max(far) < 1.5 * np.median(far)


@pytest.mark.parametrize("seed", range(12))
def test_readings_are_set_aside_one_by_one_as_fits_without_them_say(seed: int) -> None:
    """Every residual is taken from a fit to the readings that are left, made anew."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(30, 90))
    far = np.where(rng.random((n, 1)) < 0.1, 15.0, 1.0)  # some places weigh much
    design = np.linalg.qr(far * rng.standard_normal((n, 4)))[0]
    values = rng.standard_normal(n)
    values[: n // 12] += 30.0 * rng.choice([-1.0, 1.0], n // 12)
    values -= design @ (design.T @ values)
    assert outliers.one_by_one(design, values).tolist() == _snooped(design, values)


def _snooped(design: Floats, values: Floats) -> list[int]:
    """Set aside the largest residual per spread while it is four times the typical; then back."""
    n, p = design.shape
    aside: list[int] = []
    while len(aside) < min(int(0.2 * n), n - p - 5):
        left = np.setdiff1d(np.arange(n), aside)
        size = np.zeros(n)
        size[left] = _per_spread(design[left], values[left])
        worst = int(np.argmax(size))
        if size[worst] < 4.0 * np.median(size[left]) / 0.6745:
            break
        aside.append(worst)
    left = np.setdiff1d(np.arange(n), aside)
    fitted = np.linalg.lstsq(design[left], values[left])[0]
    sigma = np.linalg.norm(values[left] - design[left] @ fitted) / np.sqrt(len(left) - p)
    while aside:
        # each that was set aside is a reading of its own unknown
        joined = np.column_stack([design, np.eye(n)[:, aside]])
        found = np.linalg.lstsq(joined, values)[0][p:]
        spread = np.sqrt(np.diag(np.linalg.inv(joined.T @ joined)))[p:]
        least = int(np.argmin(np.abs(found) / spread))
        if np.abs(found[least]) > 4.0 * sigma * spread[least]:
            break
        del aside[least]
    return sorted(aside)


def _per_spread(design: Floats, values: Floats) -> Floats:
    """Residuals of a fit, each over the share of its own noise that the fit leaves in it."""
    hat = design @ np.linalg.pinv(design)
    return np.asarray(np.abs(values - hat @ values) / np.sqrt(1.0 - np.diag(hat)))


@pytest.mark.parametrize("seed", range(12))
def test_a_touch_far_out_in_heavy_tails_is_no_shift_before_the_last(seed: int) -> None:
    """Of the touches after a shift one alone reads in its direction: that is a bad touch, or none.

    The noise is Student's, of four degrees of freedom, whose tails reach so far.
    """
    rng = np.random.default_rng([seed, 4])
    plan = tn.plan(SETUP, c_deg=range(0, 360, 30), a_deg=(30, -30, 60, -60, 90, -90))
    noise = rng.standard_t(4, len(plan)) / np.sqrt(2)
    ends = [*range(4), *range(len(plan) - 4, len(plan))]
    noise[rng.choice(ends)] = 7.0 * rng.choice([-1, 1])
    errors = {name: float(rng.uniform(-25, 25)) for name in ERRORS}
    d = tn.diagnose(off(tn.simulate(plan, SETUP, errors), noise), SETUP)
    assert "setup_shift" not in d.named

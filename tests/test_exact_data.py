"""Data without any noise get the set that made them, in whatever number and size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn
from ballbar_twin import cartesian_lengths, record
from positioning_twin import HIDDEN, axis
from power.measured_twin import make_points, make_sweep
from power.study import draw_effects, ground
from trunnion.files.table import Table
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement


def exact(plan: str, seed: int) -> tuple[tn.Diagnosis, frozenset[str]]:
    """Diagnose touches of the independent generator without noise or ticks; what is hidden."""
    rng = np.random.default_rng([5, seed, *plan.encode()])
    made, twin, _, read = ground(plan)
    while True:
        hidden = draw_effects(rng, plan, 1 + seed % 3, 1.0)
        # What is always fitted absorbs a part of a sag, which comes back in second order.
        if "a_sag" not in hidden:
            break
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
    m = measure(made, twin, truth, noise_um=0.0, tick_um=0.0, seed=seed)
    setup = replace(read, probe=replace(read.probe, tick_um=0.0))
    return tn.diagnose(tn.Touches(m.columns), setup), frozenset(hidden)


@pytest.mark.parametrize("seed", range(9))
def test_a_rich_plan_gets_the_right_set(seed: int) -> None:
    d, hidden = exact("rich", seed)
    assert (d.verdict, d.named) == ("explained", hidden)
    assert d.gain.rms_after_um < 1e-6
    assert not d.outliers


@pytest.mark.parametrize("seed", range(9))
def test_a_short_plan_gets_the_sets_that_fit_exactly(seed: int) -> None:
    """The paper's plan does not distinguish a ball radius from a delay: every set fits exactly."""
    d, hidden = exact("paper", seed)
    assert d.verdict in ("explained", "ambiguous")
    assert hidden in d.alternatives
    assert not d.outliers
    assert all(len(a) <= len(hidden) for a in d.alternatives)
    for one in d.alternatives:
        fit = tn.identify(d.data, d.setup, effects=tuple(sorted(one)))
        assert fit.rms_um < 1e-6


def made_of(kind: str, hidden: tuple[str, ...], seed: int) -> Table:
    """Measurement of a kind with hidden causes of 2 µm and a noise of 1e-9 µm, or none."""
    rng = np.random.default_rng([8, seed])
    if kind == "points":
        return tn.Points(**make_points(seed, hidden, 2e9, noise_um=1e-9).columns)
    if kind == "sweep":
        return tn.Sweep(**make_sweep(seed, hidden, 2e9, noise_um=1e-9).columns)
    if kind == "positioning":
        data = axis(rng, noise=0.0)
        change = np.sum([HIDDEN[name](data, rng) for name in hidden], axis=0)
        return data.with_columns(measured_mm=data.measured + 1e-3 * change)
    spot = rng.uniform(-200, 200, 3)
    rec = record(spot, step_deg=6.0, arcs=(("XY", 0, 360),))
    lengths = cartesian_lengths(rec, rng, sigma_um=0.0)
    places = {f"{x}_mm": rec.points[:, i] for i, x in enumerate("xy")}
    return tn.Ballbar(
        setup=rec.setup, length_mm=lengths, sense=rec.sense, time_s=rec.time_s, **places
    )


CASES = (
    ("points", ("scale_y", "squareness_xy")),
    ("points", ("scale_x",)),
    ("sweep", ("radial_2", "tilt_2")),
    ("sweep", ("axial_2", "drift")),
    ("positioning", ("scale", "reversal")),
    ("positioning", ("reversal", "warmup")),
    ("ballbar", ()),
)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("kind", "hidden"), CASES)
def test_exact_data_of_each_kind_get_the_right_set(
    kind: str, hidden: tuple[str, ...], seed: int
) -> None:
    data = made_of(kind, hidden, 70 + seed)
    d = tn.diagnose(data)
    assert d.verdict == ("explained" if hidden else "consistent")
    assert d.named == set(hidden)
    assert not d.outliers


@pytest.mark.parametrize("kind", ["points", "sweep", "positioning", "ballbar"])
def test_rows_pasted_twice_are_said(kind: str) -> None:
    data = made_of(kind, ("scale",) if kind == "positioning" else (), 80)
    twice = type(data)({name: np.concatenate([v, v]) for name, v in data.columns.items()})
    d = tn.diagnose(twice)
    assert f"{len(data)} of {2 * len(data)} rows repeat others" in d.notes[0]
    assert d.named == tn.diagnose(data).named

"""A seeded sample of the blind tests of points and sweeps; all of them by ``make power``."""

from collections.abc import Callable

import pytest

import trunnion as tn
from power.measured_twin import Made, make_points, make_sweep

SEED = 5000


def points(made: Made) -> tn.Points:
    return tn.Points(**made.columns)


def sweep(made: Made) -> tn.Sweep:
    return tn.Sweep(**made.columns)


@pytest.mark.parametrize(
    ("make", "most"),
    [
        (lambda s: points(make_points(s)), 2),
        (lambda s: sweep(make_sweep(s, targets=1)), 2),
        (lambda s: sweep(make_sweep(s, targets=2, range_deg=120, step_deg=5)), 2),
    ],
    ids=["points", "one target", "arc"],
)
def test_nothing_hidden_is_consistent(make: Callable[[int], object], most: int) -> None:
    """At a rate of 5 % three or more of eight are alarms in 1 of 170 samples."""
    alarms = [s for s in range(SEED, SEED + 8) if tn.diagnose(make(s)).verdict != "consistent"]
    assert len(alarms) <= most, alarms


@pytest.mark.parametrize(
    "hidden",
    ["scale_x", "straightness_y_of_x", "angular_z_of_y", "periodic_y", "expansion"],
)
def test_an_effect_hidden_in_points_is_among_the_answers(hidden: str) -> None:
    missed = [
        s
        for s in range(SEED, SEED + 3)
        if not any(
            hidden in a for a in tn.diagnose(points(make_points(s, (hidden,), 2.0))).alternatives
        )
    ]
    assert not missed


@pytest.mark.parametrize("hidden", ["radial_2", "axial_2", "tilt_2", "positioning_3", "drift"])
def test_an_effect_hidden_in_a_sweep_is_among_the_answers(hidden: str) -> None:
    missed = [
        s
        for s in range(SEED, SEED + 3)
        if not any(
            hidden in a
            for a in tn.diagnose(sweep(make_sweep(s, (hidden,), 2.0, targets=2))).alternatives
        )
    ]
    assert not missed


def test_the_shipped_measurements_are_what_they_say() -> None:
    first, second = (tn.read_points(tn.sample_path(f"plate/{n}.csv")) for n in ("first", "second"))
    d = tn.diagnose(first)
    assert {c.id for c in d.causes} == {"scale_x", "straightness_y_of_x"}
    assert d.score(second).rms_after_um < 0.6 * d.score(second).rms_before_um
    turn = tn.diagnose(tn.read_sweep(tn.sample_path("axis/sweep.csv")))
    assert {c.id for c in turn.causes} == {"axial_2", "positioning_3"}
    arc = tn.diagnose(tn.read_sweep(tn.sample_path("axis/arc.csv")))
    assert arc.verdict == "ambiguous"
    assert {"axial_2", "axial_trend"} <= set().union(*arc.alternatives)

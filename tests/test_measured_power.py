"""A seeded sample of the blind tests of points and sweeps; all of them by ``make power``."""

from collections.abc import Callable

import trunnion as tn
from power.measured_twin import Made, make_points, make_sweep
from promise import kept, needed_runs

SEED = 5000


def points(made: Made) -> tn.Points:
    return tn.Points(**made.columns)


def sweep(made: Made) -> tn.Sweep:
    return tn.Sweep(**made.columns)


NOTHING_HIDDEN: list[Callable[[int], object]] = [
    lambda s: points(make_points(s)),
    lambda s: sweep(make_sweep(s, targets=1)),
    lambda s: sweep(make_sweep(s, targets=2, range_deg=120, step_deg=5)),
]


def test_nothing_hidden_is_consistent() -> None:
    """Points, a full turn of one target and an arc of two, in turn."""
    runs = needed_runs(0.95)
    verdicts = [tn.diagnose(NOTHING_HIDDEN[s % 3](SEED + s)).verdict for s in range(runs)]
    assert kept(verdicts.count("consistent"), runs, 0.95), verdicts


POINTS = ("scale_x", "straightness_y_of_x", "angular_z_of_y", "periodic_y", "expansion")
SWEEPS = ("radial_2", "axial_2", "tilt_2", "positioning_3", "drift")


def test_an_effect_hidden_in_points_is_among_the_answers() -> None:
    runs = needed_runs(0.97)
    missed = []
    for s in range(runs):
        hidden = POINTS[s % len(POINTS)]
        d = tn.diagnose(points(make_points(SEED + s, (hidden,), 2.0)))
        if not any(hidden in a for a in d.alternatives):
            missed.append((s, hidden))
    assert kept(runs - len(missed), runs, 0.97), missed


def test_an_effect_hidden_in_a_sweep_is_among_the_answers() -> None:
    runs = needed_runs(0.97)
    missed = []
    for s in range(runs):
        hidden = SWEEPS[s % len(SWEEPS)]
        d = tn.diagnose(sweep(make_sweep(SEED + s, (hidden,), 2.0, targets=2)))
        if not any(hidden in a for a in d.alternatives):
            missed.append((s, hidden))
    assert kept(runs - len(missed), runs, 0.97), missed


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

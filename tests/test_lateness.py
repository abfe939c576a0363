"""A scale or a backlash makes touches late on average, and is no delay; a delay is named."""

from functools import cache

import pytest

import trunnion as tn

SETUP = tn.Setup(tn.Artefact("cross"))
EIGHTHS = tuple(map(float, range(0, 360, 45)))
PLANS = {
    "two feeds": tn.plan(SETUP, feeds_mm_min=(300.0, 600.0), c_deg=EIGHTHS),
    "one feed": tn.plan(SETUP),
}
CAUSES = {
    "scale_x": {"scale_x": {"ppm": 60.0}},
    "backlash_y": {"backlash_y": {"b_um": 5.0}},
    "two": {"scale_x": {"ppm": 40.0}, "backlash_y": {"b_um": 4.0}},
}
SEEDS = [2211, 2212, 2213, 2214, 2215]


@cache
def touches(plan: str, cause: str, seed: int) -> tn.Touches:
    planned, made = PLANS[plan], CAUSES[cause]
    return tn.simulate(planned, SETUP, {"EX0C": 10.0}, effects=made, noise_um=0.3, seed=seed)


def late(notes: tuple[str, ...]) -> list[str]:
    return [note for note in notes if "late on average" in note]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("plan", PLANS)
def test_what_a_cause_does_is_no_delay(plan: str, cause: str, seed: int) -> None:
    """Neither beside the named cause, nor in an estimate, which names none."""
    data = touches(plan, cause, seed)
    assert not late(tn.diagnose(data, SETUP).notes)
    assert not late(tn.identify(data, SETUP).notes)


def test_nor_in_a_joint_diagnosis() -> None:
    both = [touches("two feeds", "scale_x", seed) for seed in SEEDS[:2]]
    found = tn.diagnose(both, SETUP)
    assert found.named == {"scale_x"}
    assert not late(found.notes)


@pytest.mark.parametrize("beside", CAUSES)
def test_touches_late_by_half_a_period_are_said_so_beside_a_cause(beside: str) -> None:
    """A period of 1 ms, which nothing states: 0.5 ms late."""
    clock = tn.Setup(tn.Artefact("cross"), probe=tn.Probe(servo_period_ms=1.0))
    plan = tn.plan(SETUP, feeds_mm_min=(60.0, 600.0), c_deg=EIGHTHS)
    for seed in SEEDS:
        data = tn.simulate(plan, clock, effects=CAUSES[beside], noise_um=0.3, seed=seed)
        starts: dict[str, None] = {name: None for name in data.columns if name.startswith("start_")}
        (said,) = late(tn.identify(data.with_columns(**starts), SETUP).notes)
        size = float(said.split("Touches are ")[1].split(" ms")[0])
        assert size == pytest.approx(0.5, rel=0.2)

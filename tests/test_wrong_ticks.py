"""A tick that the set-up states wrongly, or not at all, is named; a right one is not."""

import re
from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn
from trunnion.probing.identify import mistakes_in
from trunnion.probing.model import TouchModel
from trunnion.probing.recorded import servo_period_ms

CUBOID = tn.Setup(tn.Artefact("cuboid", length_mm=80.0, width_mm=60.0, height_mm=30.0))
KINDS = {
    "cuboid": CUBOID,
    "cross": tn.Setup(tn.Artefact("cross")),
    "sphere": tn.Setup(tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(60.0, 20.0, 60.0))),
}
NAMES = ("EX0C", "EY0C", "EA0A", "EB0C", "EZ0A", "EB0A")
ERRORS = {"EX0C": 15.0, "EB0A": 12.0, "EY0C": -7.0, "EA0A": 20.0}
PLACE = {"dx_um": 333.0, "dy_um": -271.0, "dz_um": 187.0, "rc_arcsec": 100.0}
FEEDS = ((600.0,), (60.0,), (60.0, 600.0), (300.0, 100.0), (120.0,), (30.0,))
OF_TICKS = ("looks at", "does not look", "latch", "half of another", "servo_period_ms =")


def stated(setup: tn.Setup, period_ms: float) -> tn.Setup:
    return replace(setup, probe=tn.Probe(servo_period_ms=period_ms))


def without_starts(data: tn.Touches) -> tn.Touches:
    return data.with_columns(**{name: None for name in data.columns if name.startswith("start_")})


def measured(setup: tn.Setup, plan: tn.Touches, size: float, seed: int) -> tn.Touches:
    """Touches of a machine with errors of this size, µm and arcsec."""
    rng = np.random.default_rng(seed)
    errors = {name: float(rng.uniform(-size, size)) for name in NAMES}
    return tn.simulate(plan, setup, errors, noise_um=0.2, seed=seed)


def slow(plan: tn.Touches) -> tn.Touches:
    """The plan as a second pass at 30 mm/min records it."""
    return plan.with_columns(feed_mm_min=np.full(len(plan), 30.0))


def notes_of_ticks(data: tn.Touches, setup: tn.Setup) -> list[str]:
    model = TouchModel(setup)
    said = mistakes_in(model, data, model.moves(data))
    return [note for note in said if any(text in note for text in OF_TICKS)]


@pytest.mark.parametrize("seed", [2101, 2102, 2103])
@pytest.mark.parametrize("feeds", [(600.0,), (60.0, 600.0)])
def test_a_period_of_a_control_that_latches_is_named_however_small_the_errors(
    feeds: tuple[float, ...], seed: int
) -> None:
    """The contacts all differ by less than a tick, and half of it is no cause."""
    plan = tn.plan(stated(CUBOID, 1.0), feeds_mm_min=feeds)
    latched = measured(CUBOID, plan, 0.5, seed)
    for method in (tn.identify, tn.diagnose):
        (note,) = [n for n in method(latched, stated(CUBOID, 1.0)).notes if "latch" in n]
        assert "Then probe.servo_period_ms = 0." in note
    looked = measured(stated(CUBOID, 1.0), plan, 0.5, seed)
    assert not notes_of_ticks(looked, stated(CUBOID, 1.0))


@pytest.mark.parametrize("seed", [2111, 2112, 2113])
@pytest.mark.parametrize("period", [10.0, 20.0, 50.0])
def test_a_long_period_of_slow_touches_is_named_with_what_the_steps_say(
    period: float, seed: int
) -> None:
    once = stated(CUBOID, 1.0)
    data = measured(once, slow(tn.plan(once)), 10.0, seed)
    assert servo_period_ms(data) == pytest.approx(1.0, rel=0.02)
    (note,) = tn.identify(data, stated(CUBOID, period)).notes
    assert "every 1 ms" in note
    assert f"not every {period:g} ms" in note
    assert not notes_of_ticks(data, once)
    latched = measured(CUBOID, slow(tn.plan(once)), 10.0, seed)
    assert (
        "Then probe.servo_period_ms = 0." in tn.identify(latched, stated(CUBOID, period)).notes[0]
    )


@pytest.mark.parametrize("seed", [2121, 2122, 2123])
@pytest.mark.parametrize("period", [0.1, 0.5, 4.0, 20.0])
def test_a_wrong_period_without_starts_is_no_delay_unsaid(period: float, seed: int) -> None:
    """Both make touches late as the feed; the scatter is that of the true period."""
    once = stated(CUBOID, 1.0)
    data = without_starts(measured(once, tn.plan(once, feeds_mm_min=(60.0, 600.0)), 10.0, seed))
    notes = [n for n in tn.diagnose(data, stated(CUBOID, period)).notes if "exactly this" in n]
    (note,) = notes
    found = float(re.findall(r"probe every ([\d.]+) ms", note)[0])
    assert found == pytest.approx(1.0, rel=0.25)
    assert not notes_of_ticks(data, once)


@pytest.mark.parametrize("seed", [2131, 2132, 2133])
def test_a_delay_beside_the_right_period_is_no_other_period(seed: int) -> None:
    once = stated(CUBOID, 1.0)
    plan = tn.plan(once, feeds_mm_min=(60.0, 600.0))
    delay = {"trigger_delay": {"tau_ms": 2.0}}
    data = without_starts(
        tn.simulate(plan, once, {"EX0C": 12.0}, effects=delay, noise_um=0.2, seed=seed)
    )
    assert not notes_of_ticks(data, once)
    assert tn.diagnose(data, once).named == {"trigger_delay"}


@pytest.mark.parametrize("seed", [2161, 2162, 2163])
def test_another_radius_at_two_feeds_is_no_control_that_latches_for_certain(seed: int) -> None:
    """The readings of the slow feed scatter by more than their tick allows."""
    once = stated(KINDS["cross"], 1.0)
    plan = tn.plan(once, feeds_mm_min=(600.0, 100.0))
    radius = {"probe_radius": {"dr_um": 5.0}}
    data = tn.simulate(plan, once, ERRORS, PLACE, radius, noise_um=0.2, seed=seed)
    assert not any("far less" in note for note in notes_of_ticks(without_starts(data), once))


@pytest.mark.parametrize("seed", [2171, 2172])
def test_a_control_that_latches_is_no_clock_of_picoseconds(seed: int) -> None:
    once = stated(KINDS["cross"], 1.0)
    data = tn.simulate(tn.plan(once), KINDS["cross"], ERRORS, PLACE, seed=seed)
    said = notes_of_ticks(without_starts(data), once)
    assert any("probe.servo_period_ms = 0." in note for note in said)


@pytest.mark.parametrize("seed", [2141, 2142, 2143])
def test_half_a_tick_that_nothing_states_is_said_beside_the_causes(seed: int) -> None:
    """Slow touches, whose probe scatters by as much as the tick makes them late."""
    once = stated(CUBOID, 1.0)
    data = without_starts(measured(once, slow(tn.plan(once)), 10.0, seed))
    said = tn.diagnose(data, CUBOID)
    assert said.verdict == "ambiguous"
    assert any("µm late on average" in n and "probe.tick_um = 0." in n for n in said.notes)
    exact = without_starts(measured(CUBOID, slow(tn.plan(once)), 10.0, seed))
    assert not notes_of_ticks(exact, CUBOID)


def test_the_steps_of_commands_are_no_clock() -> None:
    """Starts in steps of 0.1 µm, which are as the feeds together with the ticks."""
    once = stated(KINDS["cross"], 4.0)
    plan = tn.plan(once, feeds_mm_min=(300.0, 100.0))
    data = without_starts(measured(once, plan, 10.0, 2151))
    assert servo_period_ms(data) == 0.0
    assert not notes_of_ticks(data, once)


def test_a_right_period_is_not_called_wrong() -> None:
    """Of any plan, feeds, noise and errors, with starts or without."""
    said = []
    for seed in range(100):
        rng = np.random.default_rng([91733, seed])
        kind = KINDS[str(rng.choice(list(KINDS)))]
        period = float(rng.choice([0.05, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0]))
        right = stated(kind, period)
        feeds = FEEDS[int(rng.integers(len(FEEDS)))]
        planned = right if rng.random() < 0.5 else kind
        plan = tn.plan(planned, feeds_mm_min=feeds, dither=bool(rng.random() < 0.7))
        size = float(rng.choice([0.0, 1.0, 15.0, 60.0]))
        errors = {name: float(rng.uniform(-size, size)) for name in NAMES}
        noise = min(float(rng.choice([0.0, 0.1, 0.3, 1.0, 3.0])) * period * min(feeds) / 60, 8.0)
        data = tn.simulate(plan, right, errors, noise_um=noise, seed=seed)
        said += notes_of_ticks(without_starts(data) if rng.random() < 0.4 else data, right)
    assert not said


def test_commands_as_coarse_as_the_tick_make_dither_void() -> None:
    """Said of a plan, unless the probe scatters by as much, as that of the sample does."""
    coarse = replace(CUBOID, resolution=tn.Resolution(linear_um=1.0))
    for period, feed, sigma, expected in (
        (1.0, 60.0, 0.0, True),
        (1.0, 600.0, 0.0, False),
        (1.0, 60.0, 0.6, False),
    ):
        probe = tn.Probe(servo_period_ms=period, repeatability_um=sigma)
        setup = replace(coarse, probe=probe)
        notes = tn.plan_notes(tn.plan(setup, feeds_mm_min=(feed,)), setup)
        assert any("dither does nothing" in note for note in notes) == expected
    twice = replace(coarse, probe=tn.Probe(servo_period_ms=1.0))
    twice = replace(twice, plan=replace(twice.plan, slow_feed_mm_min=30.0))
    assert any("tick of 0.5 um" in note for note in tn.plan_notes(tn.plan(twice), twice))
    sample = tn.read_setup(tn.sample_path("cross/setup.toml"))
    assert not any("dither" in note for note in tn.plan_notes(tn.plan(sample), sample))


@pytest.mark.parametrize("feed", [30.0, 20.0])
def test_a_second_pass_that_is_no_slower_is_refused(feed: float) -> None:
    once = stated(CUBOID, 1.0)
    twice = replace(once, plan=replace(once.plan, slow_feed_mm_min=30.0))
    plan = tn.plan(once, feeds_mm_min=(feed,))
    for refused in (
        lambda: tn.plan(twice, feeds_mm_min=(feed,)),
        lambda: tn.probing_program(plan, twice),
    ):
        with pytest.raises(tn.DataError, match=r"slow_feed_mm_min: got 30, no slower than .*feed"):
            refused()


def test_what_two_passes_record_is_at_the_slow_feed() -> None:
    """Simulated and observed as the program would touch; what is no second pass is refused."""
    once = stated(CUBOID, 1.0)
    twice = replace(once, plan=replace(once.plan, slow_feed_mm_min=30.0))
    plan = tn.plan(once, feeds_mm_min=(600.0,))
    made = tn.simulate(plan, twice, {"EX0C": 12.0})
    assert set(made["feed_mm_min"]) == {30.0}
    assert tn.simulate(made, twice, {"EX0C": 12.0}) == made  # recorded so: as they are
    assert plan.start_mm is not None
    travel = np.sum((made.position_mm - plan.start_mm) * plan.direction, axis=1)
    assert np.allclose(travel / 0.5e-3, np.round(travel / 0.5e-3))  # 30 mm/min in 1 ms
    for feeds, refused in (
        ((20.0,), "slow_feed_mm_min: got 30, no slower than the plan's feed of 20"),
        ((60.0, 600.0), "feeds of 60, 600 .* slow_feed_mm_min = 30"),
    ):
        other = tn.plan(once, feeds_mm_min=feeds)
        for asked in (tn.simulate, tn.observability):
            with pytest.raises(tn.DataError, match=refused):
                asked(other, twice)


def test_further_touches_of_two_passes_can_be_run() -> None:
    once = stated(CUBOID, 1.0)
    twice = replace(once, plan=replace(once.plan, slow_feed_mm_min=30.0))
    first = slow(tn.plan(twice))
    delay = {"trigger_delay": {"tau_ms": 8.0}}
    data = tn.simulate(first, once, {"EX0C": 12.0}, effects=delay, noise_um=0.2, seed=5)
    found = tn.next_touches(tn.diagnose(data, twice), n=8)
    assert set(found["feed_mm_min"]) == {600.0}
    assert len(tn.probing_program(found, twice).cycle.steps) == len(found)

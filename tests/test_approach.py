"""A sense of approach that is the other one in every pass is asked about."""

import numpy as np
import pytest

import trunnion as tn

TARGETS = np.arange(0.0, 500.0, 60.0)
WORDS = "Is its sign the other one?"


def run(seed: int, *, timed: bool) -> tn.Positioning:
    """Five cycles up and down, with a reversal of 3 µm, in the order of the axis' way."""
    rng = np.random.default_rng(seed)
    rows = [
        (target, sense, cycle)
        for cycle in range(1, 6)
        for sense, targets in ((1, TARGETS), (-1, TARGETS[::-1]))
        for target in targets.tolist()
    ]
    target, sense, cycle = map(np.array, zip(*rows, strict=True))
    off = rng.normal(0.0, 0.3, len(rows)) + 1.5 * sense
    columns = {
        "target_mm": target,
        "measured_mm": target + 1e-3 * off,
        "direction": sense,
        "cycle": cycle,
    }
    if timed:
        columns["time_s"] = 20.0 * np.arange(len(rows))
    return tn.Positioning(columns)


def asked(data: tn.Positioning) -> bool:
    return any(WORDS in said for said in tn.diagnose(data).mistakes)


@pytest.mark.parametrize("timed", [True, False])
def test_the_other_sign_in_every_pass_is_asked_about(timed: bool) -> None:
    for seed in range(4):
        data = run(seed, timed=timed)
        assert not asked(data)
        assert asked(data.with_columns(direction=-data.direction))


def test_rows_in_another_order_or_of_pilgrim_steps_say_nothing() -> None:
    data = run(7, timed=False)
    by_target = data[np.lexsort((data.target, data.direction, data.cycle))]
    assert not asked(by_target)
    assert not asked(by_target.with_columns(direction=-by_target.direction))
    pilgrim = data[np.lexsort((-data.direction, data.cycle, data.target))]
    assert not asked(pilgrim)
    assert not asked(pilgrim.with_columns(direction=-pilgrim.direction))
    one_way = data[np.flatnonzero(data.direction == 1)]
    assert not asked(one_way.with_columns(direction=-one_way.direction))


def test_with_times_the_order_is_theirs() -> None:
    data = run(3, timed=True)
    mixed = data[np.random.default_rng(3).permutation(len(data))]
    assert not asked(mixed)
    assert asked(mixed.with_columns(direction=-mixed.direction))


def test_it_is_said_of_its_measurement_among_several() -> None:
    first, other = run(1, timed=True), run(2, timed=True)
    two = (
        first.with_columns(axis=np.full(len(first), "X")),
        other.with_columns(axis=np.full(len(other), "Y"), direction=-other.direction),
    )
    said = [text for text in tn.diagnose(list(two)).mistakes if WORDS in text]
    assert len(said) == 1
    assert said[0].startswith("positioning 2")


def other_sign(data: tn.Positioning, rows: np.ndarray) -> tn.Positioning:
    return data.with_columns(direction=np.where(rows, -data.direction, data.direction))


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("cycle", [1, 3, 5])
def test_the_other_sign_in_one_cycle_is_refused(timed: bool, cycle: int) -> None:
    """It was a drift of every cycle and one of the whole that cancel (> 90 % in 16 of 16)."""
    for seed in range(4):
        data = run(seed, timed=timed)
        swapped = other_sign(data, data.cycle == cycle)
        row = 2 * len(TARGETS) * (cycle - 1)
        said = rf"row {row}\): got -1 in a pass whose targets rise, .* in cycle {cycle}\?"
        for of in (tn.diagnose, tn.Positioning.iso230_2):
            with pytest.raises(tn.DataError, match=said) as refused:
                of(swapped)
            assert "in 8 passes of 10 it is the other way" in str(refused.value)
        others = other_sign(data, data.cycle != cycle)  # the reversal has the other sign then
        with pytest.raises(
            tn.DataError, match=rf"got \+1 in a pass .* rise, .* in cycle {cycle}\?"
        ):
            tn.diagnose(others)


def test_the_other_sign_in_one_pass_is_refused() -> None:
    for seed in range(4):
        data = run(seed, timed=True)
        swapped = other_sign(data, (data.cycle == 4) & (data.direction < 0))
        with pytest.raises(
            tn.DataError, match=r"got \+1 in a pass whose targets fall, .* cycle 4\?"
        ):
            tn.diagnose(swapped)


def test_the_other_sign_in_half_of_the_cycles_is_asked_about() -> None:
    data = run(5, timed=True)
    data = data[data.cycle < 5]
    said = tn.diagnose(other_sign(data, data.cycle % 2 == 0)).mistakes
    assert any("the targets rise in 4 passes and fall in as many" in text for text in said)


def test_orders_that_a_measurement_may_have_are_not_refused() -> None:
    """Pilgrim steps, some stops back, rows sorted by target, one side approached on both ways."""
    data = run(6, timed=False)
    pilgrim = data[np.lexsort((-data.direction, data.cycle, data.target))]
    by_target = data[np.lexsort((data.target, data.direction, data.cycle))]
    one_way = data.with_columns(direction=np.ones(len(data), dtype=int))
    mixed = data[np.random.default_rng(6).permutation(len(data))]
    some_back = [*range(5), *range(3, -1, -1), *range(9), *range(9, 18)]  # 4 steps back
    stops = data[np.concatenate([18 * cycle + np.array(some_back) for cycle in range(5)])]
    stops = stops.with_columns(
        measured_mm=np.asarray(stops.measured_mm)
        + 1e-5 * np.random.default_rng(6).normal(size=len(stops))
    )
    for one in (data, pilgrim, by_target, mixed, one_way, stops):
        assert not [text for text in tn.diagnose(one).mistakes if text.startswith("direction")]
    assert not asked(other_sign(pilgrim, pilgrim.cycle == 3))  # its order says nothing of a sign

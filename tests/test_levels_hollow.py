"""A hollow is no kink and no bow; a bow is in doubt beside what a drift or a shape makes."""

from collections.abc import Callable

import numpy as np
import pytest

import trunnion as tn
from twin.forward import Floats

SEEDS = range(6)
FEET = 100.0
Rise = Callable[[Floats], Floats]


def _bed(
    rng: np.random.Generator, height: Rise, drift: float = 0.0, twist: float = 0.0
) -> tn.Levels:
    """A bed of 2 m read there and back, the level turned for the way back: rises over its feet.

    height: µm, at mm. drift: µm/m an hour, a reading takes 25 s. twist: µm/m per mm, across.
    """
    place: Floats = FEET / 2 + FEET * np.arange(20.0)
    place = np.asarray(np.concatenate([place, place[::-1]]), dtype=np.float64)
    sense = np.repeat([1.0, -1.0], 20)
    time = 25.0 * np.arange(40)
    slope = (height(place + FEET / 2) - height(place - FEET / 2)) / (1e-3 * FEET)
    moved = drift * time / 3600
    along = sense * (slope + 60) + 12 + moved
    across = sense * (twist * (place - 1000) - 30) - 6 + moved
    noise = 0.5 * rng.standard_normal((2, 40))
    read = np.round((np.stack([along, across]) + noise) / 0.2) * 0.2
    return tn.Levels(
        position_mm=place,
        along_um_m=read[0],
        across_um_m=read[1],
        turn_deg=np.where(sense > 0, 0, 180),
        time_s=time,
    )


def _hollow(depth: float, wide: float, middle: float) -> Rise:
    return lambda x: -depth * np.exp(-(((x - middle) / wide) ** 2))


def _bent(joint: float) -> Rise:
    return lambda x: 0.02 * np.maximum(x - joint, 0)


def _bowed_waves(phase: float) -> Rise:
    return lambda x: 4 * _arc(x) + np.sin(2 * np.pi * x / 600 + phase)


def _arc(x: Floats) -> Floats:
    return 8 * (1 - ((x - 1000) / 1000) ** 2)


def _named(found: tn.Diagnosis, least: float = 0.9) -> set[str]:
    return {c.id for c in found.causes if c.probability > least}


@pytest.mark.parametrize(("depth", "wide"), [(6.0, 150.0), (20.0, 150.0), (6.0, 90.0)])
def test_a_hollow_is_no_kink_and_no_bow(depth: float, wide: float) -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        middle = rng.uniform(500, 1400)
        found = tn.diagnose(_bed(rng, _hollow(depth, wide, middle)))
        assert _named(found) <= {"instrument_zero", "field"}
        for cause in found.causes:  # nor is anything as large as ten hollows
            assert cause.id != "bow" or abs(cause.parameters["h_um"]) < depth


def test_a_drift_that_looks_like_a_bow_is_no_bow() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        found = tn.diagnose(_bed(rng, lambda x: 0 * x, drift=15.0))
        assert _named(found) <= {"instrument_zero"}
        assert any("drift of the level" in note for note in found.notes)


def test_bow_twist_and_kink_are_named_all_the_same() -> None:
    """Of usual sizes, and a bow beside waves that are short."""
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        joint, phase = rng.uniform(700, 1300), rng.uniform(0, 6.28)
        assert "bow" in _named(tn.diagnose(_bed(rng, _arc)))
        assert "twist" in _named(tn.diagnose(_bed(rng, lambda x: 0 * x, twist=0.02)))
        bent = _bed(rng, _bent(joint))
        assert "kink" in _named(tn.diagnose(bent))
        waves = _bed(rng, _bowed_waves(phase))
        both = tn.diagnose(waves)
        assert {"bow", "field"} <= _named(both)


def _waves(seed: int, straight: float) -> tn.Levels:
    """A bed of smooth waves without a straight part in their slopes, and such a part (µm/m)."""
    rng = np.random.default_rng(seed)
    place: Floats = np.asarray(np.tile(FEET / 2 + FEET * np.arange(20.0), 2))
    sense, u = np.repeat([1.0, -1.0], 20), (place - 1000) / 1000
    cycles, phase = rng.uniform(0.9, 1.6, 2), rng.uniform(0, 6.28, 2)
    slopes = 15 * np.sin(np.pi * np.outer(u, cycles) + phase)
    line = np.column_stack([np.ones(40), u])
    slopes = slopes - line @ np.linalg.lstsq(line, slopes, rcond=None)[0]
    read = sense[:, None] * (slopes + straight * u[:, None] + 60)
    read = read + 0.5 * rng.standard_normal((40, 2))
    return tn.Levels(
        position_mm=place,
        along_um_m=read[:, 0],
        across_um_m=read[:, 1],
        turn_deg=np.where(sense > 0, 0, 180),
        time_s=25.0 * np.arange(40),
    )


def test_a_bow_that_a_smooth_shape_may_hide_is_not_excluded() -> None:
    """No straight part is seen: what a shape has of its own and a bow or a twist may cancel."""
    for seed in SEEDS:
        found = tn.diagnose(_waves(seed, 0.0))
        assert found.evidence[0].causes == {"field"}
        assert 0.6 < found.evidence[0].probability < 0.985, seed


def test_a_straight_part_beside_a_smooth_shape_is_a_bow_or_not() -> None:
    """As large as the waves it may be theirs, a few times as large it is no longer."""
    for seed in (0, 2, 3):
        for straight, least, most in ((15.0, 0.05, 0.5), (40.0, 0.5, 0.95)):
            found = tn.diagnose(_waves(seed, straight))
            bow = sum(a.probability for a in found.evidence if "bow" in a.causes)
            assert least < bow < most, (seed, straight)

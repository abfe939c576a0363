"""Diameters whose noise has a memory along the pass: waviness, a built-up edge.

Passes by formulas of their own, not those of the library's noise: an edge that holds a random size
for a random way, one that grows and breaks off, marks of random height that a nose rounds off, and
waviness that forgets itself along the part.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.whitening import identity
from trunnion.models.diameters import build

COUNT = 110  # readings of a pass
OVERHANG_MM = 90.0
Rng = np.random.Generator
Shape = Callable[[Rng, Floats], Floats]
SURE = 0.9
SEEDS = range(6)


def held(rng: Rng, way: Floats) -> Floats:
    """An edge of a random size, held for some 8 mm."""
    ends = np.cumsum(rng.exponential(8.0, 100))
    return np.asarray(-rng.uniform(0.0, 5.0, 101)[np.searchsorted(ends, way)])


def growing(rng: Rng, way: Floats) -> Floats:
    """An edge that grows and breaks off every 10 mm or so."""
    ends = np.concatenate([[0.0], np.cumsum(rng.gamma(4.0, 2.5, 100))]) - rng.uniform(0.0, 10.0)
    last = np.searchsorted(ends, way) - 1
    return np.asarray(-0.5 * rng.uniform(0.6, 1.4, 101)[last] * (way - ends[last]))


def rounded(rng: Rng, way: Floats) -> Floats:
    """Marks of random height every 0.5 mm, rounded off over 4 mm."""
    marks = np.arange(-15.0, OVERHANG_MM + 15.0, 0.5)
    weights = np.exp(-(((way[:, None] - marks) / 4.0) ** 2))
    return np.asarray(weights @ rng.standard_normal(len(marks)) * 0.6)


def wavy(rng: Rng, way: Floats) -> Floats:
    """Waviness of 1.5 µm that forgets itself in 5 mm."""
    keeps = np.exp(-np.diff(way) / 5.0)
    out = [1.5 * rng.standard_normal()]
    for keep in keeps:
        out.append(keep * out[-1] + 1.5 * np.sqrt(1.0 - keep**2) * rng.standard_normal())
    return np.array(out)


def still(_: Rng, way: Floats) -> Floats:
    """No such error."""
    return np.zeros(len(way))


def part(
    seed: int,
    shape: Shape,
    *,
    tip_um: float = 0.0,
    chatter_um: float = 0.0,
    jump_um: float = 0.0,
    bell_um: float = 0.0,
    step_um: float = 0.1,
    shuffled: bool = False,
) -> tuple[tn.Diameters, tn.Setup]:
    """Two passes, the second with reversed feed; noise of 0.5 µm.

    ``tip_um``: of bending. ``chatter_um``: at a pitch of 9 mm. ``jump_um``, ``bell_um``: an error
    of the place that is no cause. ``step_um``: of the gauge. ``shuffled``: rows in any order.
    """
    rng = np.random.default_rng(seed)
    parts = []
    for number, sign in enumerate((-1, 1), start=1):
        way = np.linspace(0.5, OVERHANG_MM - 4.0, COUNT)
        z = OVERHANG_MM - way if sign < 0 else way
        error = rng.normal(0.0, 10.0) + shape(rng, way) + tip_um * (z / OVERHANG_MM) ** 3
        error += chatter_um * np.sin(2 * np.pi * way / 9.0 + rng.uniform(0.0, 6.0))
        error += jump_um * (z > 40.0) + bell_um * np.exp(-(((z - 50.0) / 12.0) ** 2))
        read = np.round((error + rng.normal(0.0, 0.5, COUNT)) / step_um) * step_um
        parts.append((z, read, np.full(COUNT, number), way / 1.8, np.full(COUNT, sign)))
    columns = ("z_mm", "error_um", "pass", "time_s", "feed_sign")
    values = [np.concatenate(one) for one in zip(*parts, strict=True)]
    order = rng.permutation(2 * COUNT) if shuffled else np.arange(2 * COUNT)
    data = tn.Diameters({k: v[order] for k, v in zip(columns, values, strict=True)})
    turning = {"overhang_mm": OVERHANG_MM}
    return data, tn.Setup(artefact=tn.Artefact("none"), turning=turning)


def sure(found: tn.Diagnosis) -> set[str]:
    return {c.id for c in found.causes if c.probability > SURE}


def whitener(data: tn.Diameters, setup: tn.Setup) -> object:
    model = build(data, setup)
    plain = model.readings.values
    design = model.base_jacobian(model.start)
    return model.whitener(plain - design @ np.linalg.lstsq(design, plain, rcond=None)[0])


@pytest.mark.parametrize("shape", [held, growing, rounded, wavy])
def test_noise_with_a_memory_is_no_cause(shape: Shape) -> None:
    wrong = [seed for seed in SEEDS if sure(tn.diagnose(*part(seed, shape)))]
    assert len(wrong) <= 1, wrong


@pytest.mark.parametrize("shape", [held, growing, rounded, wavy])
def test_a_cause_beside_it_is_found_with_its_size(shape: Shape) -> None:
    wrong, missed, far = [], [], []
    for seed in SEEDS:
        found = tn.diagnose(*part(seed, shape, tip_um=25.0))
        wrong += [seed] if sure(found) - {"bending"} else []
        if not any("bending" in causes for causes in found.alternatives):
            missed.append(seed)
        if found.named == {"bending"}:
            bending = next(c for c in found.causes if c.id == "bending")
            off = bending.parameters["tip_um"] - 25.0
            far += [seed] if abs(off) > 3 * bending.std_errors["tip_um"] else []
    assert max(map(len, (wrong, missed, far))) <= 1, (wrong, missed, far)


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"tip_um": 25.0},
        {"chatter_um": 1.5},
        {"chatter_um": 6.0},
        {"jump_um": 3.0},
        {"bell_um": 6.0},
        {"step_um": 1.0},
    ],
    ids=str,
)
def test_white_noise_has_no_memory_whatever_is_beside_it(more: dict[str, Any]) -> None:
    made = [whitener(*part(seed, still, **more)) for seed in range(12)]
    assert all(one is identity for one in made)


def test_chatter_of_one_pitch_is_no_noise() -> None:
    for seed in SEEDS:
        assert sure(tn.diagnose(*part(seed, still, chatter_um=2.0))) == {"chatter"}


def test_the_order_of_rows_does_not_matter() -> None:
    data, setup = part(2, wavy)
    mixed, _ = part(2, wavy, shuffled=True)
    one, other = whitener(data, setup), whitener(mixed, setup)
    assert isinstance(one, Whitener)
    assert isinstance(other, Whitener)
    want = [np.round(rows.predictors[-1], 3).tolist() for _, rows in one.filters]
    assert [np.round(rows.predictors[-1], 3).tolist() for _, rows in other.filters] == want

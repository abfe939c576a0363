"""What a diagnosis knows already is not worked out again, and is what it was."""

from __future__ import annotations

import numpy as np
import pytest

from positioning_twin import axis
from trunnion.base.resolution import NO_FLOOR
from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.engine import leave
from trunnion.diagnosis.plain import case_of
from trunnion.diagnosis.probability import Probabilities
from trunnion.diagnosis.selection import search
from trunnion.diagnosis.smooth import Along, polynomials
from trunnion.models.kinds import model_of


def drawn(seed: int) -> tuple[Candidates, Floats]:
    """Draw candidates of one and several variants, and residuals of some of them."""
    rng = np.random.default_rng(seed)
    blocks = [rng.normal(size=(v, 80, k)) for v, k in [(1, 1)] * 8 + [(1, 2)] * 3 + [(6, 1)] * 3]
    blocks[3] = blocks[1] + 0.3 * blocks[3]  # one that may take another's place
    r = rng.normal(size=80) + 2 * sum(b[0, :, 0] for b in blocks[:2] + blocks[8:9] + blocks[12:13])
    basis = np.linalg.qr(rng.normal(size=(80, 3)))[0]
    return Candidates(blocks, basis), r - basis @ (basis.T @ r)


@pytest.mark.parametrize("seed", range(12))
def test_a_search_without_a_cause_finds_what_one_from_nothing_does(seed: int) -> None:
    c, r = drawn(seed)
    first = search(c, r)
    assert Probabilities(first, c).likeliest  # what is weighed now serves again
    banned = {max(first.top.members, key=lambda j: float(c.gains(r)[c.owner == j].max()))}
    c.ban(banned)
    again = first.without(banned)
    fresh_c, fresh_r = drawn(seed)
    fresh_c.ban(banned)
    fresh = search(fresh_c, fresh_r)
    assert banned <= first.top.members
    assert again.top.members == fresh.top.members
    assert again.top.score == pytest.approx(fresh.top.score, abs=1e-5)
    assert not any(banned & f.members for f in again.known.values())
    own, other = Probabilities(again, c), Probabilities(fresh, fresh_c)
    assert own.of_set(again.top.members) == pytest.approx(other.of_set(again.top.members), abs=0.02)


def test_products_of_columns_are_those_of_the_columns_however_they_are_asked_for() -> None:
    c, _ = drawn(1)
    rng = np.random.default_rng(2)
    for _ in range(20):
        blocks = rng.choice(len(c.owner), 5).tolist()  # one may be there twice
        columns = np.concatenate([c.columns(b) for b in blocks])
        assert np.allclose(c.gram(blocks), columns @ columns.T, atol=1e-12)
    more = c.beside([rng.normal(size=(1, 80, 2))], np.array([0.01]))
    blocks = [len(more.owner) - 1, 3, 0]
    columns = np.concatenate([more.columns(b) for b in blocks])
    assert np.allclose(more.gram(blocks), columns @ columns.T, atol=1e-12)
    further = c.with_variants({11: (0, rng.normal(size=(1, 80, 1)))}, {})
    blocks = list(range(len(further.owner)))
    columns = np.concatenate([further.columns(b) for b in blocks])
    assert np.allclose(further.gram(blocks), columns @ columns.T, atol=1e-12)


@pytest.mark.parametrize("gone", [(), (0,), (2, 3), (0, 1, 2, 3, 4)])
def test_a_process_beside_fewer_columns_is_that_beside_these_columns(gone: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    values = np.linspace(0.0, 1.0, 60)
    basis = np.linalg.qr(np.ones((60, 1)))[0]
    columns, r = (
        x - basis @ (basis.T @ x) for x in (rng.normal(size=(60, 5)), rng.normal(size=60))
    )
    along = Along(polynomials(values, values, 8), basis, r, NO_FLOOR)
    of_fewer = along.sums(np.delete(columns, gone, axis=1)).without()
    for found, expected in zip(along.sums(columns).without(gone), of_fewer, strict=True):
        assert np.allclose(found, expected, rtol=1e-9)


def test_a_joint_diagnosis_begins_at_places_that_its_measurements_found() -> None:
    rng = np.random.default_rng(5)
    x, y = (axis(rng, noise=0.3).with_columns(axis=[letter] * 110) for letter in "XY")
    # so strong that no place of the grid leaves noise alone
    warming = 2000 * (1 - np.exp(-np.arange(110) / 17))
    x = x.with_columns(measured_mm=x.measured + 1e-3 * warming)
    alone = leave(model_of(x)).linearised
    assert alone is not None
    found = {alone.model.effects[j].id: place for j, place in alone.further.items()}
    assert "warmup" in found
    model = model_of([x, y])
    joint = {model.effects[j].id: place for j, place in model.known_alone[1].items()}
    assert joint["positioning:warmup"]["tau_min"] == found["warmup"]["tau_min"]
    places = case_of(model).linearised.values[
        [e.id for e in model.effects].index("positioning:warmup")
    ]
    assert found["warmup"]["tau_min"] in [place["tau_min"] for place in places]


def test_products_with_columns_of_another_measurement_are_those_of_all_columns() -> None:
    """Columns that are zero in a measurement, some or all of them, or none."""
    rng = np.random.default_rng(8)
    case = case_of(model_of([axis(rng), axis(rng).with_columns(axis=["Y"] * 110)]))
    d, n = case.dictionary, len(case.rows)
    columns = np.stack([d.block(i)[:, 0] for i in range(0, d.count, 7)])
    r = rng.normal(size=(n, 4))
    r[: n // 2, 1], r[n // 2 :, 2], r[:, 3] = 0.0, 0.0, 0.0
    basis = np.zeros((n, 0))
    for some in ([0], [1], [2], [3], [1, 2], [0, 1, 3]):
        left = r[:, some]
        single = d.gains(left, basis)[0][::7]
        width = np.array([d.block(i).shape[1] for i in range(0, d.count, 7)])
        expected = (columns @ left) ** 2
        assert np.allclose(single[width == 1], expected[width == 1], atol=1e-9)

"""Which terms of structure compete with causes."""

from typing import Any

import numpy as np
import pytest

import trunnion as tn
from power.one_machine import drawn
from trunnion.diagnosis import explain, terms
from trunnion.diagnosis.functions import MAX_DIRECTIONS
from trunnion.diagnosis.plain import case_of
from trunnion.diagnosis.scan import Dictionary
from trunnion.models.kinds import model_of

ALL = ("touches", "ballbar", "axislog", "positioning")


@pytest.fixture
def picked(monkeypatch: pytest.MonkeyPatch) -> list[set[str]]:
    """Quantities of the terms that compete in each call."""
    found: list[set[str]] = []

    def promising(case: Any, *given: Any, **more: Any) -> list[int]:
        own = terms.promising(case, *given, **more)
        found.append({case.dictionary.term(i).covariate for i in own})
        return own

    monkeypatch.setattr(explain, "promising", promising)
    return found


def test_what_shows_nothing_in_its_measurement_competes_with_no_cause(
    picked: list[set[str]],
) -> None:
    made = drawn(ALL, 1, 11)  # an unknown error in the lengths of the ball-bar alone
    found = tn.diagnose(made.data, made.setup)
    assert found.verdict == "unexplained"
    names = set.union(*picked)
    assert any(name.endswith("of ballbar") for name in names)
    assert not any(name.endswith("of axislog") for name in names)


@pytest.mark.parametrize(("seed", "number"), [(11, 1), (11, 2), (12, 1), (19, 0), (20, 2), (21, 0)])
def test_structure_that_causes_imitate_competes_with_them(seed: int, number: int) -> None:
    made = drawn(("ballbar", "ballbar"), number, seed)
    assert made.unknown
    for data in made.data:
        found = tn.diagnose(data, made.setup)
        sure = {c.id for c in found.causes if c.probability > 0.95}
        assert sure <= made.shared | set.union(*map(set, made.own.values()))


def test_terms_gain_as_much_of_residuals_however_many_were_asked_before() -> None:
    made = drawn(("touches", "positioning"), 0, 11)
    case = case_of(model_of(made.data[1], made.setup))
    rng = np.random.default_rng(52)
    basis, d = case.plain.basis, Dictionary(case.model, case.rows, case.whiten)
    r = rng.normal(size=(len(case.rows), 8)) * 10.0 ** np.arange(-12, 4, 2)  # of any size
    r -= basis @ (basis.T @ r)
    for _ in range(MAX_DIRECTIONS // 8 + 1):
        further = np.linalg.qr(rng.normal(size=r.shape))[0]
        d.gains(further, further[:, :3])
    fresh = Dictionary(case.model, case.rows, case.whiten)
    (gain, rank), (expected, ranks) = (x.gains(r, basis) for x in (d, fresh))
    assert np.array_equal(rank, ranks)
    for own, other, size in zip(gain.T, expected.T, np.sum(r**2, axis=0), strict=True):
        assert own / size == pytest.approx(other / size, abs=1e-10)
    again = d.gains(r @ np.ones((8, 1)), basis)[0]
    assert again == pytest.approx(fresh.gains(r.sum(axis=1, keepdims=True), basis)[0], rel=1e-9)

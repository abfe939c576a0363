"""Causes of one of several measurements are kept by its readings, and are what they were."""

from __future__ import annotations

import numpy as np
import pytest

from positioning_twin import axis
from power.one_machine import drawn
from trunnion.diagnosis import left
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.columns import Piece
from trunnion.diagnosis.engine import leave
from trunnion.diagnosis.of_some import Beside, OfSome, Orthonormal
from trunnion.diagnosis.plain import case_of
from trunnion.diagnosis.quantities import saying
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.scorer import cost
from trunnion.models import kinds
from trunnion.models.joint import JointModel
from trunnion.models.kinds import model_of


def test_columns_of_some_readings_multiply_as_whole_ones() -> None:
    rng = np.random.default_rng(41)
    n, at = 60, slice(20, 45)
    basis = np.linalg.qr(rng.normal(size=(n, 4)))[0]
    whole = np.zeros((3, n, 2))
    whole[:, at] = rng.normal(size=(3, 25, 2))
    other = rng.normal(size=(1, n, 1))
    some: list[Piece] = [(0, other), (1, OfSome(whole[:, at], at))]
    dense: list[Piece] = [(0, other), (1, whole)]
    kept, full = (Candidates.of_pieces(x, 2, 7 * n, basis) for x in (some, dense))
    r = rng.normal(size=(n, 3))
    assert np.allclose(kept.gains(r), full.gains(r), rtol=1e-12)
    assert np.allclose(kept.places, full.places, rtol=1e-12)
    for block in range(len(full.owner)):
        assert np.allclose(kept.columns(block), full.columns(block), atol=1e-12)
        assert np.allclose(kept.gram_rows(block), full.gram_rows(block), atol=1e-12)
    blocks = list(range(len(full.owner)))
    assert np.allclose(kept.gram(blocks), full.gram(blocks), atol=1e-12)
    fewer = np.flatnonzero(np.arange(n) % 3 > 0)
    part = OfSome(whole[:, at], at).rows(fewer)
    back = np.zeros((3, len(fewer), 2))
    back[:, part.at] = part.own
    assert np.array_equal(back, whole[:, fewer])


def test_a_joint_model_gives_what_acts_in_one_part_by_its_readings() -> None:
    rng = np.random.default_rng(42)
    runs = [axis(rng).with_columns(axis=[letter] * 110) for letter in "XY"]
    model = model_of(runs)
    assert isinstance(model, JointModel)
    case = case_of(model)
    pieces = dict(case.linearised.pieces())
    kept = [piece for piece in pieces.values() if isinstance(piece, OfSome | Orthonormal)]
    assert len(kept) == len(model.effects)  # of two axes nothing is shared
    for j, known in pieces.items():
        values, start = case.values[j], case.plain.nuisance
        whole = model.white_columns(start, model.effects[j], values, case.whiten)
        piece = known.whole() if isinstance(known, Orthonormal) else known
        assert isinstance(piece, OfSome)
        assert np.array_equal(whole[:, piece.at], piece.own)
        assert np.count_nonzero(whole) == np.count_nonzero(piece.own)


def test_structure_of_several_measurements_is_that_of_each() -> None:
    measured = drawn(("touches", "sweep"), 0, 43)
    model = model_of(measured.data, measured.setup)
    assert isinstance(model, JointModel)
    assert any(part.dictionary is part.terms for part in model.parts)
    case = case_of(model)
    taken, made = case.dictionary, Dictionary(model, case.rows, case.whiten)
    place = {term: i for i, term in enumerate(made.terms)}
    assert len(taken.terms) == len(place)
    assert {term.covariate.rpartition(" of ")[2] for term in place} == {"touches", "sweep"}
    assert "-X arm, -Y side" in [t.number for t in place if t.covariate == "face of touches"]
    same = [place[term] for term in taken.terms]
    r = np.random.default_rng(43).normal(size=(len(case.rows), 3))
    r -= case.plain.basis @ (case.plain.basis.T @ r)
    for own, expected in zip(*(d.gains(r, case.plain.basis) for d in (taken, made)), strict=True):
        assert np.allclose(own, expected[same], atol=1e-9)
    for term in range(0, made.count, 17):
        assert np.allclose(taken.block(term), made.block(same[term]), atol=1e-12)
        own, again = taken.variants(term), made.variants(same[term])
        assert isinstance(own, OfSome)
        assert isinstance(again, OfSome)
        assert own.at == again.at
        assert np.allclose(own.own, again.own, atol=1e-12)


def joint(kinds_of: tuple[str, ...], number: int, *, own: bool) -> JointModel:
    """Return the joint model of a drawn machine; ``own``: with columns of the measurements."""
    made = drawn(kinds_of, number, seed=23)
    measured = kinds._measured(made.data, made.setup, ())
    for one in measured:
        if not own:
            object.__setattr__(one.alone, "columns", None)
    return kinds._joint(measured, made.setup, ())


@pytest.mark.parametrize(
    "kinds_of",
    [
        ("points", "diameters"),
        ("touches", "ballbar"),
        ("positioning", "axislog"),
        ("sweep", "positioning"),
    ],
)
def test_columns_of_the_measurements_are_those_of_the_joint_diagnosis(
    kinds_of: tuple[str, ...],
) -> None:
    with_own, without = (case_of(joint(kinds_of, 0, own=own)) for own in (True, False))
    kept = [piece for _, piece in with_own.linearised.pieces()]
    assert any(isinstance(piece, Orthonormal) for piece in kept)
    assert not any(isinstance(piece, Orthonormal) for _, piece in without.linearised.pieces())
    one, other = with_own.candidates, without.candidates
    assert np.array_equal(one.owner, other.owner)
    assert np.array_equal(one.rank, other.rank)
    assert one.penalty == pytest.approx(other.penalty, rel=1e-6)
    assert one.curves == pytest.approx(other.curves, rel=1e-6)
    # They are not copied, but where two measurements have opposite signs of an effect.
    own = [part.own for part in one._parts if isinstance(part, Beside) and part.of_basis is None]
    assert any(x.base is not None for x in own)
    # What each block explains of any residual is the same, whatever signs its columns have.
    drawn_left = np.random.default_rng(5).normal(size=(len(with_own.rows), 3))
    assert one.gains(drawn_left) == pytest.approx(other.gains(drawn_left), rel=1e-6, abs=1e-9)


def test_columns_are_made_anew_where_other_directions_are_fitted() -> None:
    rng = np.random.default_rng(44)
    n, at = 40, slice(10, 30)
    whole = np.zeros((2, n, 1))
    whole[:, at] = rng.normal(size=(2, 20, 1))
    fitted = np.zeros((n, 2))
    fitted[at] = np.linalg.qr(rng.normal(size=(20, 2)))[0]
    alone = Candidates.of_pieces([(0, whole[:, at])], 1, 2 * n, fitted[at])
    known = alone.orthonormal(0, slice(None))
    assert known is not None
    piece = Orthonormal(*known, at, alone.fitted, lambda: OfSome(whole[:, at], at))
    assert np.shares_memory(piece.own, alone._parts[0])
    r = rng.normal(size=(n, 3))
    for basis, holds in ((fitted, True), (fitted[:, :1], False)):
        assert piece.holds(basis) is holds
        one, other = (Candidates.of_pieces([(0, x)], 1, 2 * n, basis) for x in (piece, whole))
        assert np.allclose(one.gains(r), other.gains(r), rtol=1e-9)


def test_columns_of_fewer_readings_are_made_anew() -> None:
    model = joint(("points", "diameters"), 0, own=True)
    pieces = [x for _, x in case_of(model).linearised.pieces() if isinstance(x, Orthonormal)]
    piece = pieces[0]
    fewer = np.delete(np.arange(len(model.readings)), [piece.at.start + 1])
    some = piece.rows(fewer)
    assert np.allclose(some.own, np.delete(piece.whole().own, 1, axis=1))


def test_noise_of_a_log_from_causes_one_by_one_is_that_of_its_own_diagnosis(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = drawn(("positioning", "axislog"), 2, seed=23)
    model = kinds.model_of(made.data[1], made.setup, ())
    quick = left.left_one_by_one(case_of(model))
    assert quick is not None
    monkeypatch.setattr("trunnion.diagnosis.engine.left_one_by_one", lambda _: None)
    whole = leave(kinds.model_of(made.data[1], made.setup, ()))
    assert whole.unexplained is None
    assert np.std(quick.after) == pytest.approx(np.std(whole.after), rel=0.02)


def test_a_cause_that_is_banned_costs_infinitely_much_without_a_warning() -> None:
    assert np.array_equal(cost(np.array([np.inf, 4.0]), np.array([2, 2]), 40) > 1e9, [True, False])


def test_gains_beside_one_fit_after_another_are_those_beside_each_alone() -> None:
    """Products with what was fitted before are kept, and dropped where they are many."""
    made = drawn(("touches", "positioning"), 3, 47)
    case = case_of(model_of(list(made.data), made.setup))
    d, rng, n = case.dictionary, np.random.default_rng(48), len(case.rows)
    basis = case.plain.basis
    for further in (0, 1, 2, 7, 40, 3, 40, 40, 0):
        more = rng.normal(size=(n, further))
        fitted = np.linalg.qr(np.concatenate([basis, more], axis=1))[0]
        r = rng.normal(size=n)
        r -= fitted @ (fitted.T @ r)
        gain, rank = d.gains(r, fitted)
        for term in range(0, d.count, 41):
            own = d.block(term)
            left = own - fitted @ (fitted.T @ own)
            if rank[term] == own.shape[1] == np.linalg.matrix_rank(left, tol=1e-3):
                sizes = np.linalg.lstsq(left, r, rcond=None)[0]
                assert gain[term] == pytest.approx(float(r @ left @ sizes), rel=1e-5, abs=1e-9)


def test_a_joint_plain_fit_leaves_what_nothing_identifies_at_the_start() -> None:
    """Also where it begins at fits of the measurements, each of which moved other combinations."""
    made = drawn(("hybrid ballbar", "hybrid ballbar"), 0, seed=11)
    model = model_of(made.data, made.setup)
    plain = case_of(model).plain
    assert plain.not_identifiable.any()
    moved, ways = plain.nuisance - model.start, plain.judged.directions.T
    assert np.any(moved)
    along = ways @ np.linalg.lstsq(ways, moved)[0]
    assert along == pytest.approx(moved, abs=1e-9 * float(np.abs(moved).max()))


def test_quantities_of_measurements_are_what_the_joint_model_says_of_them() -> None:
    model = joint(("points", "diameters"), 0, own=True)
    known = case_of(model).dictionary.quantities
    assert known is not None
    asked = list(saying(model.covariates, model.components, np.arange(len(model.readings))))
    assert [x.covariate.name for x in known] == [x.covariate.name for x in asked]
    for one, other in zip(known, asked, strict=True):
        assert (one.said, one.some) == (other.said, other.some)
        assert np.array_equal(one.ranks, other.ranks)
        assert [*map(tuple, one.enter.values())] == [*map(tuple, other.enter.values())]

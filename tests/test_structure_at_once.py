"""What disturbs all components of the readings at once is one structure without a name."""

import numpy as np
import pytest

import levels_twin as twin
import trunnion as tn
from power.measured_twin import make_sweep
from trunnion.diagnosis.alike import Alike
from trunnion.diagnosis.plain import case_of
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.selection import search
from trunnion.diagnosis.terms import standing_at_once
from trunnion.models.kinds import diagnose
from trunnion.models.levels import LevelsModel
from trunnion.models.rotary.model import SweepModel

PLACES = 20
ROWS = 2 * PLACES
KNOCKED = 39.0  # noises, root of the sum of squares


def line(change: np.ndarray, rng: np.random.Generator) -> tn.Levels:
    """A line read twice in one order, turned in between, with noise of 1 µm/m."""
    places = np.tile(100.0 * (0.5 + np.arange(PLACES)), 2)
    sense = np.repeat([1.0, -1.0], PLACES)
    way = twin.Way(places, np.zeros(ROWS), sense, 100.0, grid=False)
    size = float(np.linalg.norm(way.left(change))) or 1.0
    read = way.sense[:, None] * rng.uniform(-60, 60, 2) + change * KNOCKED / size
    return way.data(read + rng.standard_normal(read.shape))


def numbers(d: Dictionary, kind: str) -> list[int]:
    """Terms of a kind in all components at once, of time."""
    every = range(d.count, d.count + len(d.at_once))
    return [i for i in every if d.term(i).kind == kind]


def test_a_term_at_once_has_a_size_of_its_own_in_each_component() -> None:
    data = line(np.zeros((ROWS, 2)), np.random.default_rng(1))
    model, at = LevelsModel(data), np.asarray(data.time_s)[12]
    d = Dictionary(model, np.arange(2 * ROWS))
    number = next(i for i in numbers(d, "jump") if d.term(i).number == at)
    step = (np.arange(ROWS) >= 12).astype(float)
    knocked = np.outer(step, [3.0, -0.4]).ravel()
    columns = d.block(number)
    assert columns.shape == (2 * ROWS, 2)
    left = knocked - columns @ np.linalg.lstsq(columns, knocked, rcond=None)[0]
    assert np.abs(left).max() < 1e-12
    variants = d.variants(number)
    assert isinstance(variants, np.ndarray)
    assert variants.shape == (1, 2 * ROWS, 2)
    assert d.term(number).component == "along and across"


def test_a_polynomial_that_holds_a_drift_and_a_bow_takes_not_their_place() -> None:
    case = case_of(LevelsModel(line(np.zeros((ROWS, 2)), np.random.default_rng(2))))
    curves, jumps = (numbers(case.dictionary, kind) for kind in ("polynomial", "jump"))
    assert curves[-1] in Alike(case, curves).holding_causes()  # of degree 4
    assert not Alike(case, jumps).holding_causes()


@pytest.mark.parametrize("seed", range(12))
def test_a_level_that_is_knocked_is_no_drift(seed: int) -> None:
    """One component alone was a jump without a name, and the other one was taken for a drift."""
    rng = np.random.default_rng([seed, 77])
    share = np.linspace(0.0, 1.0, ROWS)
    knocked = share > rng.uniform(0.2, 0.4) + rng.choice([0.0, 0.4])
    d = diagnose(line(np.outer(knocked, [1.0, -0.8]), rng))
    assert d.verdict == "unexplained"
    assert not d.causes
    assert d.none_probability > 0.5


def test_a_sweep_is_disturbed_in_the_frame_of_its_instrument_or_of_its_target() -> None:
    """Each alone: their directions are no further ones, and their gains do not add up."""
    model = SweepModel(tn.Sweep(**make_sweep(5, ()).columns))
    d = Dictionary(model, np.arange(len(model.readings)))
    assert {d.term(i).component for i in numbers(d, "jump")} == {
        "radial and tangential and axial",
        "X and Y and Z",
    }
    assert all(d.block(i).shape[1] == 3 for i in numbers(d, "jump"))


@pytest.mark.parametrize("seed", range(4))
def test_a_term_stands_only_where_it_explains_what_the_causes_do(seed: int) -> None:
    """No function of time is an error twice a turn, whatever the place of the axis explains."""
    data = tn.Sweep(**make_sweep(seed, ("positioning_2",), 5.0, targets=1, step_deg=5.0).columns)
    case = case_of(SweepModel(data))
    d, white, basis = case.dictionary, case.plain.white, case.plain.basis
    best = search(case.candidates, white, floor=case.floor).top
    assert best.members
    assert d.at_once
    n, of_causes = len(white), best.columns
    for i in range(d.count, d.count + len(d.at_once)):
        columns = d.block(i)
        both = np.concatenate([basis, columns], axis=1)
        left = white - both @ np.linalg.lstsq(both, white, rcond=None)[0]
        more = columns.shape[1] - of_causes
        assert n * np.log(left @ left / best.rss) + more * np.log(n) > 10  # BIC
    assert standing_at_once(case, best) == []

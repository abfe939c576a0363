"""Columns of candidates are made where and when they are needed, and once."""

from typing import Any

import numpy as np
import pytest

import trunnion as tn
from power.one_machine import drawn
from trunnion.diagnosis.along import of_ratios
from trunnion.diagnosis.of_some import OfSome
from trunnion.diagnosis.plain import case_of, plain_fit
from trunnion.models.ballbar.model import BallbarModel
from trunnion.models.kinds import model_of


def circle() -> Any:
    return tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))


def test_columns_between_the_places_of_a_grid_are_made_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = case_of(BallbarModel(circle()))
    effect = next(e for e in case.effects if len(e.parameters) == 3 and not e.linear)
    free = next(p for p in effect.parameters if not p.linear)
    between = float(np.sqrt(free.grid[0] * free.grid[1]))
    places = [
        effect.values(place if p is free else 0.0 for p in effect.parameters)
        for place in (free.grid[0], between, free.grid[1])
    ]
    expected = case.model.white_columns(case.plain.nuisance, effect, places, case.whiten)
    made: list[int] = []
    as_ever = BallbarModel.white_columns

    def counted(self: BallbarModel, nuisance: Any, one: Any, values: Any, whiten: Any) -> Any:
        made.append(len(values))
        return as_ever(self, nuisance, one, values, whiten)

    monkeypatch.setattr(BallbarModel, "white_columns", counted)
    for _ in range(3):
        found = case.linearised.columns(effect, places)
        assert found is not None
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    assert made == [1]  # the place between, the first time


def test_columns_between_places_are_those_of_all_readings_where_the_cause_acts() -> None:
    """Of a cause some columns may be those of its measurement's own diagnosis, and others not."""
    made = drawn(("touches", "ballbar"), 30, 2)
    case = case_of(model_of(made.data, made.setup))
    asked = 0
    for j, effect in enumerate(case.effects):
        if (free := of_ratios(effect)) is None:
            continue
        middle = free.grid[len(free.grid) // 2 :][:2]
        values = [
            effect.values(place if p is free else 0.0 for p in effect.parameters)
            for place in (*free.grid, float(np.sqrt(np.prod(middle))))
        ]
        known = case.linearised.with_places({j: values[-1]})
        expected = case.model.white_columns(known.nuisance, effect, values, case.whiten)
        found = known.piece(effect, values)
        assert isinstance(found, OfSome)
        every = np.stack([found.made(i, expected.shape[1]) for i in range(len(values))])
        np.testing.assert_allclose(every, expected, rtol=1e-12, atol=1e-12)
        asked += 1
    assert asked > 3


def test_a_plain_fit_of_a_ball_bar_makes_no_candidates(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(model: BallbarModel) -> Any:
        raise AssertionError(f"candidates of {model} were made")

    monkeypatch.setattr(BallbarModel, "_catalogue", refused)
    assert plain_fit(BallbarModel(circle())).rss > 0


def test_an_unknown_candidate_of_a_ball_bar_is_refused_at_once() -> None:
    with pytest.raises(tn.UnknownNameError, match="backlash"):
        BallbarModel(circle(), effects=["backlsh_y"])

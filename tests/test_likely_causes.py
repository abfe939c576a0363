"""Mistakes that a diagnosis names first: turns of a level, heights of a ball, units of a whole."""

from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.units import unit_of
from trunnion.data.turned import turn_doubts
from trunnion.models import examples
from trunnion.reports.causes import Found
from trunnion.reports.verdict import verdict_of_diagnosis

Made = dict[str, Any]


def rail(
    rng: np.random.Generator,
    senses: tuple[int, ...],
    *,
    rough: float = 6.0,
    drift: float = 0.0,
    step: float = 0.0,
    places: int = 24,
) -> tuple[Made, np.ndarray[Any, Any]]:
    """Readings of a level on a rail, turned for some rounds, and the turn of each row."""
    place = 100.0 * (0.5 + np.arange(places))
    slope = rng.uniform(-60, 60, (2, 1)) + rough * np.cumsum(
        rng.standard_normal((2, places)), axis=1
    )
    sense = np.repeat(senses, places)
    zero, noise = rng.uniform(-200, 200), rng.uniform(0.5, 2.0)
    read = sense * np.tile(slope, len(senses)) + zero + drift * np.arange(len(sense)) / places
    read = read + noise * rng.standard_normal(read.shape)
    if step:
        read = step * np.round(read / step)
    columns = {"position_mm": np.tile(place, len(senses)), "along_um_m": read[0]}
    return columns | {"across_um_m": read[1]}, np.where(sense > 0, 0, 180)


@pytest.mark.parametrize("senses", [(1, -1), (1, -1, 1, -1), (1, 1, -1, -1)])
def test_a_forgotten_turn_of_a_level_is_named(senses: tuple[int, ...]) -> None:
    columns, turn = rail(np.random.default_rng(1), senses)
    said = "was the level turned by 180 degrees, and turn_deg not given?"
    assert said in tn.diagnose(tn.Levels(**columns)).summary().replace("\n", " ")
    assert not turn_doubts(tn.Levels(**columns, turn_deg=turn))


def test_a_level_that_was_not_turned_as_stated_is_named() -> None:
    columns, _ = rail(np.random.default_rng(2), (1, 1))
    (said,) = turn_doubts(tn.Levels(**columns, turn_deg=np.repeat([0, 180], 24)))
    assert "turn_deg says that the level was turned" in said


def test_no_sound_level_is_suspected_of_a_turn() -> None:
    rng = np.random.default_rng(3)
    for run in range(200):
        senses = ((1, -1), (1, 1), (1, 1, 1), (1, -1, 1, -1))[run % 4]
        columns, turn = rail(
            rng,
            senses,
            rough=float(rng.choice([0.0, 0.3, 2.0])),
            drift=float(rng.choice([0.0, 1.0, 10.0])),
            step=float(rng.choice([0.0, 5.0])),
            places=int(rng.integers(5, 30)),
        )
        assert not turn_doubts(tn.Levels(**columns, turn_deg=turn))


def bent_rail(
    seed: int, *, turned: bool, back: bool, bent: float = 1.0
) -> dict[str, np.ndarray[Any, Any]]:
    """Readings up and back (or up again) of a rail that is bent and twisted: slopes on lines."""
    rng = np.random.default_rng(seed)
    place = 100.0 * (0.5 + np.arange(20))
    slope = np.outer(rng.uniform(20.0, 60.0, 2) * rng.choice([-1, 1], 2), place / 1000.0 - 1.0)
    slope = bent * slope + rng.uniform(-20.0, 20.0, (2, 1))
    second = slice(None, None, -1 if back else 1)
    sign = -1.0 if turned else 1.0
    read = np.concatenate([slope, sign * slope[:, second]], axis=1) + rng.uniform(-50, 50, (2, 1))
    read = np.round(read + 0.8 * rng.standard_normal(read.shape), 1)
    columns = {"position_mm": np.concatenate([place, place[second]]), "along_um_m": read[0]}
    return columns | {"across_um_m": read[1], "time_s": 25.0 * np.arange(40)}


@pytest.mark.parametrize(("turned", "back"), [(True, True), (True, False), (False, True)])
def test_the_turn_of_a_level_on_a_bent_rail_is_asked_about(turned: bool, back: bool) -> None:
    """Up and back, slopes on a line are a drift and a jump: none was asked about in 16 of 16.

    Up twice, a level that was not turned reads as a turned one that drifts on a straight rail.
    """
    right, wrong = (
        np.repeat([0, 180 if turned else 0], 20),
        np.repeat([0, 0 if turned else 180], 20),
    )
    said = "and turn_deg not given" if turned else "turn_deg says that the level was turned"
    for seed in range(12):
        columns = bent_rail(seed, turned=turned, back=back)
        assert not turn_doubts(tn.Levels(**columns, turn_deg=right))
        (asked,) = turn_doubts(tn.Levels(**columns, turn_deg=wrong))
        assert said in asked


@pytest.mark.parametrize("back", [True, False])
@pytest.mark.parametrize(
    ("bent", "drift", "jump"), [(1, 15, 0), (1, 0, 30), (0, 15, 0), (0, 0, 30)]
)
def test_a_drift_or_another_zero_is_no_turn(
    bent: float, drift: float, jump: float, back: bool
) -> None:
    for seed in range(12):
        columns = bent_rail(seed, turned=False, back=back, bent=bent)
        for name in ("along_um_m", "across_um_m"):
            columns[name] = (
                columns[name] + drift * np.arange(40) / 20 + jump * (np.arange(40) >= 20)
            )
        assert not turn_doubts(tn.Levels(**columns))


def test_heights_of_a_ball_that_are_3_mm_off_are_asked_about() -> None:
    data, setup = examples.rotary_test()
    d = tn.diagnose(data.with_columns(z_mm=data["z_mm"] + 3.0), setup)
    assert any(n.startswith("More than 1 mm from the set-up: EZ0A +299") for n in d.mistakes)
    assert tn.diagnose(data, setup).mistakes == ()


def scaled(data: Any, factor: float, unit: str) -> Any:
    columns = {**data.readings, **data.set_positions}
    return data.with_columns(**{n: factor * v for n, v in columns.items() if unit_of(n) == unit})


def test_an_r_test_in_inches_throughout_is_asked_about() -> None:
    data, setup = examples.rotary_test()
    (said,) = tn.diagnose(scaled(data, 1 / 25.4, "mm"), setup).mistakes
    assert "x_mm, y_mm and z_mm: values reach 5.75 mm" in said
    assert "or inches (25.4 times)?" in said


def test_a_log_whose_angles_are_radians_throughout_is_asked_about() -> None:
    """The tool tip tells them."""
    data, setup = examples.axis_log()
    (said,) = tn.diagnose(scaled(data, np.pi / 180, "deg"), setup).mistakes
    assert "if a_act_deg, c_act_deg, a_cmd_deg and c_cmd_deg are in radians" in said


def test_a_likely_mistake_is_the_first_line() -> None:
    """A unit that is 1000 times too large stood in the fourth line."""
    data, setup = examples.diameters()
    d = tn.diagnose(data.with_columns(error_um=1e-3 * data.error_um), setup)
    assert d.mistakes
    assert d.sentences()[0] == d.mistakes[0]
    assert d.sentences().count(d.mistakes[0]) == 1
    assert d.summary().startswith("error_um: values differ by")
    assert verdict_of_diagnosis(Found(d)).startswith(d.mistakes[0])
    assert d.mistakes[0] in d.notes
    assert tn.Diagnosis.from_dict(d.to_dict()).mistakes == d.mistakes

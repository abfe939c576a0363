"""Backlash that is another at either end of the circle, or on either side of the axis.

Machines as they are built: a screw that friction winds up from the bearing that holds it, and a
carriage that turns in its guide as it turns back. Both are circles of `ballbar_twin`.
"""

from dataclasses import dataclass

import numpy as np
import pytest

import trunnion as tn
from ballbar_twin import Recording, cartesian_lengths, columns_of, record, sign
from test_ballbar_lateral_play import circles, pulls, sure
from trunnion.diagnosis.families import family_of, meaning

STEEL_N_MM2, SCREW_MM = 206e3, 25.0
PAIRS = ((0, 1), (1, 0))
NOISE_UM = 0.3


@dataclass(frozen=True)
class Screw:
    """Holds a nut at a distance from its fixed bearing: 500 mm to the middle of the circle."""

    axis: int
    friction_n: float
    from_plus: bool = False

    def moved_mm(self, rec: Recording, middle: np.ndarray) -> np.ndarray:
        """How far the tool stays behind, whichever way it goes."""
        stiff = STEEL_N_MM2 * np.pi / 4 * SCREW_MM**2
        way = -1.0 if self.from_plus else 1.0
        free = 500.0 + way * (rec.points[:, self.axis] - middle[self.axis])
        out = np.zeros_like(rec.points)
        out[:, self.axis] = -self.friction_n * free / stiff * sign(rec.velocity[:, self.axis])
        return out

    @property
    def hidden(self) -> dict[str, float]:
        per_mm = 2e3 * self.friction_n / (STEEL_N_MM2 * np.pi / 4 * SCREW_MM**2)
        slope = (-1e3 if self.from_plus else 1e3) * per_mm
        letter = "xyz"[self.axis]
        return {f"backlash_{letter}": 500.0 * per_mm, f"backlash_slope_{letter}": slope}


@dataclass(frozen=True)
class Carriage:
    """Carries the other axis, and turns by an angle (µrad) either way as it turns back."""

    axis: int
    other: int
    turn: float

    def moved_mm(self, rec: Recording, middle: np.ndarray) -> np.ndarray:
        """What a tool that stands off the middle of the carriage sees of it."""
        off = rec.points[:, self.other] - middle[self.other]
        out = np.zeros_like(rec.points)
        out[:, self.axis] = -1e-6 * self.turn * off * sign(rec.velocity[:, self.axis])
        return out

    @property
    def hidden(self) -> dict[str, float]:
        return {f"backlash_slope_{'xyz'[self.axis]}_along_{'xyz'[self.other]}": 2.0 * self.turn}


def measured(
    seed: int,
    *causes: Screw | Carriage,
    centre: tuple[float, float] = (0.0, 0.0),
    times: bool = True,
) -> tn.Ballbar:
    rng = np.random.default_rng(seed)
    middle = np.array([*centre, 0.0])
    rec = record(middle, step_deg=1.0, arcs=(("XY", 0, 360),))
    length = cartesian_lengths(
        rec,
        rng,
        sigma_um=NOISE_UM,
        motion=lambda r: sum((c.moved_mm(r, middle) for c in causes), np.zeros_like(r.points)),
    )
    columns = columns_of(rec, length) | {"feed_mm_min": np.full(len(length), 1000.0)}
    if not times:
        del columns["time_s"]
    return tn.Ballbar(columns)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("friction_n", [200.0, 500.0])
def test_a_screw_held_at_one_end(axis: int, friction_n: float) -> None:
    off = []
    for seed in range(8):
        screw = Screw(axis, friction_n, from_plus=bool(seed % 2))
        d = tn.diagnose(measured(seed, screw))
        assert sure(d) == set(screw.hidden)
        assert not d.unexplained
        off += pulls(d, screw.hidden)
    assert np.max(np.abs(off)) < 3.5
    assert np.sqrt(np.mean(np.square(off))) < 1.6


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("turn", [-4.0, 10.0])
def test_a_carriage_that_turns(pair: tuple[int, int], turn: float) -> None:
    for seed in range(20, 28):
        carriage = Carriage(*pair, turn)
        d = tn.diagnose(measured(seed, carriage))
        assert sure(d) == set(carriage.hidden)
        assert np.max(np.abs(pulls(d, carriage.hidden))) < 3.5


def test_both_at_once() -> None:
    for seed in range(30, 36):
        causes = Screw(0, 400.0), Carriage(1, 0, 8.0)
        hidden = causes[0].hidden | causes[1].hidden
        d = tn.diagnose(measured(seed, *causes))
        assert sure(d) == set(hidden)
        assert np.max(np.abs(pulls(d, hidden))) < 3.5


def test_machines_without_it_have_none() -> None:
    for seed in range(40, 60):
        play = {(0, 1): 2.0 * (seed % 3)}
        data = circles(seed, play, backlash_um=(3.0, -1.5 * (seed % 2), 0.0), squareness_arcsec=5.0)
        assert not any("slope" in c.id for c in tn.diagnose(data).causes if c.probability > 0.5)


def test_without_times_it_is_no_candidate() -> None:
    ids = {e.id for e in tn.catalogue(measured(60, Screw(0, 500.0), times=False))}
    assert "backlash_x" in ids
    assert not any("slope" in one for one in ids)


def stops(seed: int, screw: Screw) -> tn.Positioning:
    """Stops along all of the screw, 1000 mm, whose middle is that of the circles or not."""
    rng = np.random.default_rng(seed)
    stiff = STEEL_N_MM2 * np.pi / 4 * SCREW_MM**2
    up = np.linspace(0.0, 1000.0, 11)
    target = np.tile(np.concatenate([up, up[::-1]]), 5)
    way = np.tile(np.repeat([1, -1], len(up)), 5)
    behind = 1e3 * screw.friction_n * target / stiff * way
    return tn.Positioning(
        target_mm=target,
        measured_mm=target + 1e-3 * (1.5 - behind + 0.5 * rng.standard_normal(len(target))),
        direction=way,
        cycle=np.repeat(np.arange(1, 6), 2 * len(up)),
        time_s=15.0 * np.arange(len(target)),
        axis=np.full(len(target), "X"),
    )


def test_stops_and_circles_share_it() -> None:
    """With one sign: what is behind in the circles is a reversal below zero of the stops."""
    for seed in range(70, 76):
        screw = Screw(0, 400.0)
        d = tn.diagnose([measured(seed, screw), stops(seed, screw)])
        assert sure(d) == set(screw.hidden)
        assert np.max(np.abs(pulls(d, screw.hidden))) < 3.5
        assert d.labels["backlash_slope_x"] == "backlash of the X axis that grows along X"


def test_middles_that_are_apart_are_said_to_be() -> None:
    """Circles about 300 mm of the screw have another backlash in their middle than stops."""

    class Nearer(Screw):
        def moved_mm(self, rec: Recording, middle: np.ndarray) -> np.ndarray:
            return super().moved_mm(rec, middle + np.array([200.0, 0.0, 0.0]))

    for seed in range(80, 84):
        screw = Screw(0, 400.0)
        d = tn.diagnose([measured(seed, Nearer(0, 400.0)), stops(seed, screw)])
        slope = next(c for c in d.causes if c.id == "backlash_slope_x")
        assert abs(slope["rate_um_m"] - screw.hidden["backlash_slope_x"]) < 1.0
        assert d.unexplained
        assert "as where their middles are " in d.unexplained
        away = float(d.unexplained.partition("middles are ")[2].split()[0])
        assert away == pytest.approx(200.0, abs=25.0)


def test_circles_at_two_places_are_of_one_machine() -> None:
    """The slope is about the middle of all circles that are diagnosed together."""
    screw = Screw(0, 400.0)

    class Same(Screw):
        def moved_mm(self, rec: Recording, middle: np.ndarray) -> np.ndarray:
            return super().moved_mm(rec, np.zeros_like(middle))

    for seed in range(90, 94):
        data = [
            measured(seed + k, Same(0, 400.0), centre=(x, 0.0))
            for k, x in ((0, -100.0), (9, 100.0))
        ]
        d = tn.diagnose(data)
        assert sure(d) == set(screw.hidden)
        assert np.max(np.abs(pulls(d, screw.hidden))) < 3.5


def test_words() -> None:
    assert meaning("backlash_slope_x", {"rate_um_m": 9.0}) == "the backlash is larger towards +X"
    assert meaning("backlash_slope_x_along_y", {"rate_um_m": -9.0}) == (
        "the backlash is larger towards −Y"
    )
    assert "screw" in family_of("backlash_slope_z").advice
    assert "carriage" in family_of("backlash_slope_x_along_z").advice
    d = tn.diagnose(measured(99, Carriage(0, 1, 10.0)))
    assert "do not distinguish it from a lateral play of the X axis in Y" in d.summary()

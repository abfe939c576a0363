"""Lateral play: the guide of an axis gives way sideways, and another axis jumps as it turns back.

Circles as they are driven, from their angle: which way an axis travels is taken from the angle, not
from the coordinates.
"""

from collections.abc import Sequence

import numpy as np
import pytest

import trunnion as tn
from trunnion.diagnosis.families import meaning
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.ballbar.path import Path

RADIUS_MM = 150.0
NOISE_UM = 0.3
FEED_MM_S = 1000.0 / 60.0
SURE = 0.9
PAIRS = ((0, 1), (1, 0))
PLANES = ((0, 1), (2, 0), (1, 2))


def circles(
    seed: int,
    play_um: dict[tuple[int, int], float],
    *,
    backlash_um: Sequence[float] = (0.0, 0.0, 0.0),
    squareness_arcsec: float = 0.0,
    senses: Sequence[int] = (1, -1),
    planes: Sequence[tuple[int, int]] = PLANES[:1],
    radius_mm: float = RADIUS_MM,
    first_deg: float = 0.5,
) -> tn.Ballbar:
    """Circles of each plane about a ball of its own.

    play_um: Of axis and direction: the tool stands half of it behind, in that direction, as the
    axis travels to plus, and half of it ahead on its way back; on one side as it does not travel.
    """
    rng = np.random.default_rng(seed)
    gone = np.radians(np.arange(first_deg, 360.0))
    rows, clock = [], 0.0
    for setup, (i, j) in enumerate(planes):
        ball = 1e-3 * rng.uniform(-10.0, 10.0, 3)
        side = rng.choice([-1.0, 1.0], 3)
        for sense in senses:
            place = np.zeros((len(gone), 3))
            place[:, i], place[:, j] = radius_mm * np.cos(gone), sense * radius_mm * np.sin(gone)
            way = np.tile(side, (len(gone), 1))
            way[:, i] = np.where(gone < np.pi, -1.0, 1.0)
            way[:, j] = sense * np.where((gone < np.pi / 2) | (gone > 3 * np.pi / 2), 1.0, -1.0)
            tool = place - ball - 5e-4 * way * backlash_um
            tool[:, 0] -= np.radians(squareness_arcsec / 3600) * place[:, 1]
            for (axis, across), width in play_um.items():
                tool[:, across] -= 5e-4 * width * way[:, axis]
            length = np.linalg.norm(tool, axis=1) + 1e-3 * NOISE_UM * rng.standard_normal(len(gone))
            time = clock + gone * radius_mm / FEED_MM_S
            clock = time[-1] + 20.0
            which = [np.full(len(gone), one) for one in (setup, sense)]
            rows.append(np.column_stack([*which, place, length, time]))
    setup, sense, x, y, z, length, time = np.concatenate(rows).T
    return tn.Ballbar(
        setup=setup.astype(int),
        x_mm=x,
        y_mm=y,
        **({"z_mm": z} if len(planes) > 1 else {}),
        length_mm=np.round(length, 4),
        sense=sense,
        feed_mm_min=np.full(len(x), 60.0 * FEED_MM_S),
        time_s=time,
    )


def name_of(axis: int, across: int) -> str:
    return f"lateral_play_{'xyz'[across]}_of_{'xyz'[axis]}"


def sure(d: Diagnosis) -> set[str]:
    """Causes that are stated."""
    return {c.id for c in d.causes if c.probability > SURE}


def pulls(d: Diagnosis, hidden: dict[str, float]) -> list[float]:
    """How far the sizes of causes of one parameter are off, in standard errors."""
    found = {c.id: c for c in d.causes}
    sizes = {k: next(iter(found[k].parameters)) for k in hidden}
    return [(found[k][n] - hidden[k]) / found[k].std_errors[n] for k, n in sizes.items()]


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("size_um", [-2.0, 0.5, 1.0, 4.0])
def test_play_has_its_name_and_size(pair: tuple[int, int], size_um: float) -> None:
    off = []
    for seed in range(8):
        d = tn.diagnose(circles(seed, {pair: size_um}))
        assert sure(d) == {name_of(*pair)}
        assert not d.unexplained
        off += pulls(d, {name_of(*pair): size_um})
    assert np.max(np.abs(off)) < 3.5
    assert np.sqrt(np.mean(np.square(off))) < 1.7


@pytest.mark.parametrize("size_um", [1.0, 3.0])
def test_play_beside_backlash_and_squareness(size_um: float) -> None:
    hidden = {"lateral_play_y_of_x": size_um, "backlash_x": 3.0, "squareness_xy": 6.0}
    for seed in range(20, 28):
        data = circles(seed, {(0, 1): size_um}, backlash_um=(3.0, 0.0, 0.0), squareness_arcsec=6.0)
        d = tn.diagnose(data)
        assert sure(d) == set(hidden)
        assert np.max(np.abs(pulls(d, hidden))) < 3.5


def test_play_of_both_axes_and_in_one_sense_alone() -> None:
    for seed in range(30, 34):
        both = tn.diagnose(circles(seed, {(0, 1): 2.0, (1, 0): 3.0}))
        assert sure(both) == {name_of(*pair) for pair in PAIRS}
        one = tn.diagnose(circles(seed, {(0, 1): 3.0}, senses=(1,)))
        assert sure(one) == {"lateral_play_y_of_x"}


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (2, 0), (1, 2)])
def test_play_is_named_in_the_plane_that_shows_it(pair: tuple[int, int]) -> None:
    """Where its axis does not travel the tool stands on one side, of which nobody knows."""
    for seed in range(40, 43):
        d = tn.diagnose(circles(seed, {pair: 2.0}, planes=PLANES))
        assert sure(d) == {name_of(*pair)}
        assert np.max(np.abs(pulls(d, {name_of(*pair): 2.0}))) < 3.5


def test_machines_without_play_get_none() -> None:
    for seed in range(50, 58):
        for backlash, square in (((0.0, 0.0, 0.0), 0.0), ((4.0, -2.0, 0.0), 8.0)):
            d = tn.diagnose(circles(seed, {}, backlash_um=backlash, squareness_arcsec=square))
            assert not any(name.startswith("lateral_play") for name in sure(d))


def test_bars_of_two_lengths_share_the_play_of_a_machine() -> None:
    d = tn.diagnose([circles(60 + k, {(0, 1): 2.0}, radius_mm=r) for k, r in enumerate((100, 250))])
    assert d.named == {"lateral_play_y_of_x"}
    (cause,) = d.causes
    assert cause["b_um"] == pytest.approx(2.0, abs=4 * cause.std_errors["b_um"])
    assert "lateral play of the X axis in Y (lateral_play_y_of_x)" in d.summary()


@pytest.mark.parametrize(("size_um", "side"), [(3.0, "−Y"), (-3.0, "+Y")])
def test_the_words_say_where_the_tool_stands(size_um: float, side: str) -> None:
    """To plus of X half of the play behind: the words of `circles`."""
    said = meaning("lateral_play_y_of_x", {"b_um": size_um})
    assert said == f"while X travels towards +, the tool stands on the {side} side"


def test_an_axis_that_stands_all_the_run_does_not_travel() -> None:
    """Coordinates that are off by rounding are no travel, and hide no reversal of the others."""
    data = circles(70, {}, planes=PLANES, first_deg=0.0)
    assert data.position_mm is not None
    tips = data.position_mm + 1e-13 * np.random.default_rng(71).standard_normal((len(data), 3))
    path = Path(data, tips)
    setup = np.asarray(data.setup, int)
    for axis in range(3):
        sign = path.both_ways(axis)
        assert sign is not None
        stands = np.array([axis not in plane for plane in PLANES])[setup]
        assert not sign[stands].any()
        assert np.mean(sign[~stands] != 0.0) > 0.95
    left_out = np.setdiff1d(np.arange(len(tips)), path.between_reversals())
    assert set(setup[left_out]) == {0, 1, 2}
    assert np.abs(tips[left_out]).max(axis=1) == pytest.approx(RADIUS_MM)

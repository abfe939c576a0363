"""Families of causes: each effect has one, and the words for a sign are what the machine does."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from result_examples import cross
from trunnion.diagnosis.families import FAMILIES, OTHER, family_of, meaning
from trunnion.machine.effects import Owner
from trunnion.models.diameters import CAUSES
from trunnion.models.kinds import kinds

SETUP = cross()[1]


def test_every_effect_of_every_catalogue_has_an_advice() -> None:
    listed = [
        (kind.name, e.id, e.owner)
        for kind in kinds()
        if kind.examples
        for e in tn.catalogue(kind.name)
    ]
    listed += [("diameters", name, Owner.MACHINE) for name in CAUSES]
    listed += [("several measurements", "scale_xyz", Owner.MACHINE)]
    assert len(listed) > 200
    assert [one for one in listed if family_of(one[1], one[2]) is OTHER] == []
    used = {id(family_of(name, owner)) for _, name, owner in listed}
    unused = {f.ids for f in FAMILIES if id(f) not in used}
    assert len(unused) == 0, unused


def test_an_effect_of_the_users_own_gets_no_advice_that_nobody_wrote() -> None:
    assert family_of("sun") is OTHER
    assert family_of("sun", Owner.ARTEFACT).name == "artefact"


def travel(effect: str, values: dict[str, float], letter: str, length_mm: float) -> np.ndarray:
    """Where the tool ends that is sent along an axis, from where it starts, in mm."""
    ends = np.zeros((2, 3))
    ends[1, "xyz".index(letter)] = length_mm
    field = tn.volumetric_error(SETUP, {}, effects={effect: values})
    moved = 1e-3 * field.at(ends).reshape(2, 3)
    return np.asarray(np.diff(ends + moved, axis=0)[0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("first", "second"), ["xy", "xz", "yz"])
def test_the_words_of_a_squareness_are_the_angle_of_the_axes(
    first: str, second: str, sign: float
) -> None:
    name, values = f"squareness_{first}{second}", {"arcsec": 100.0 * sign}
    a, b = (travel(name, values, letter, 100.0) for letter in (first, second))
    square = a @ b / np.linalg.norm(a) / np.linalg.norm(b)  # cosine of the angle
    said = meaning(name, values)
    assert f"the angle between +{first.upper()} and +{second.upper()} is" in said
    assert ("larger than 90°" in said) == (square < 0)
    micrometres, over = said.split(": ")[1].split(" µm over ")
    assert over == "300 mm"
    assert float(micrometres) == pytest.approx(abs(square) * 300e3, rel=0.05)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_words_of_a_scale_are_where_the_axis_goes(sign: float) -> None:
    values = {"ppm": 50.0 * sign}
    too_far = travel("scale_x", values, "x", 300.0)[0] - 300.0
    said = meaning("scale_x", values)
    assert ("too far" in said) == (too_far > 0)
    size = float(said.split(": ")[1].split()[0])
    assert size == pytest.approx(1e3 * abs(too_far), rel=0.05)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_words_of_a_reversal_are_what_the_stops_show(sign: float) -> None:
    target = np.linspace(0.0, 300.0, 7)
    up = np.tile(np.concatenate([target, target[::-1]]), 3)
    direction = np.tile(np.repeat([1, -1], 7), 3)
    late = -1e-3 * sign * direction / 2  # positive: the axis stops short of where it goes
    noise = 1e-4 * np.random.default_rng(3).standard_normal(len(up))
    data = tn.Positioning(
        target_mm=up,
        measured_mm=up + 4 * late + noise,
        direction=direction,
        cycle=np.repeat([1, 2, 3], 14),
    )
    cause = next(c for c in tn.diagnose(data).causes if c.id == "reversal")
    assert ("stops short" in meaning("reversal", cause.parameters)) == (sign > 0)

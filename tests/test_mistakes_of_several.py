"""Mistakes of one of several measurements are named as those of one alone: joint, and compared."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.data.mistaken import of_each
from trunnion.models import examples

SETUP = tn.Setup(tn.Artefact("cross"))
PLANNED = "is this the plan, not what was measured?"


@cache
def touches(seed: int) -> tn.Touches:
    made = {"EX0C": 15.0, "EB0A": 12.0}
    return tn.simulate(tn.plan(SETUP), SETUP, made, noise_um=0.4, seed=seed)


def asked(found: Any) -> list[str]:
    """What is asked about the data: in the first sentences, and once in all of them."""
    mistakes = list(found.mistakes)
    assert list(found.sentences()[: len(mistakes)]) == mistakes
    assert all(found.sentences().count(one) == 1 for one in mistakes)
    return mistakes


def test_a_plan_among_several_measurements_is_asked_about_first() -> None:
    plan = tn.plan(SETUP)
    (said,) = asked(tn.diagnose([touches(1), plan], SETUP))
    assert said.startswith("touches 2: Every touch lies where")
    assert said.endswith(PLANNED)
    (said,) = asked(tn.diagnose([plan, touches(2)], SETUP))
    assert said.startswith("touches: Every touch lies where")
    (said,) = asked(tn.compare(touches(1), plan, setup=SETUP))
    assert said.startswith("after: Every touch lies where")
    (said,) = asked(tn.compare(plan, touches(1), touches(2), setup=SETUP, names=("p", "q", "r")))
    assert said.startswith("p: Every touch lies where")


def test_sound_measurements_are_not_asked_about() -> None:
    for seed in range(3, 8):
        assert asked(tn.compare(touches(seed), touches(seed + 10), setup=SETUP)) == []
    assert asked(tn.diagnose([touches(3), touches(4)], SETUP)) == []


def test_what_is_wrong_with_the_set_up_is_said_once() -> None:
    """Of all measurements alike, in mm for µm; the other kind of data says it, too."""
    given = replace(SETUP, machine=tn.Machine("trt-ca", errors={"EX0C": 0.015}))
    for found in (
        tn.diagnose([touches(1), touches(2)], given),
        tn.compare(touches(1), touches(2), setup=given),
    ):
        (said,) = asked(found)
        assert said.startswith("[machine.errors] has EX0C = 0.015: are these mm?")


def test_mistakes_of_other_kinds_are_named_in_a_joint_diagnosis() -> None:
    data, setup = examples.rotary_test()
    high = data.with_columns(z_mm=data["z_mm"] + 3.0)
    alone = tn.diagnose(high, setup).mistakes
    assert alone[0].startswith("More than 1 mm from the set-up: EZ0A")
    said = asked(tn.diagnose([data, data.with_columns(time_s=None), high], setup))
    assert [one.partition(": ")[2] for one in said] == list(alone)


def test_each_text_has_the_name_of_its_measurement_unless_it_is_of_all() -> None:
    said = {"one": ("x", "y"), "two": ("y",), "three": ("y", "z", "x")}
    assert of_each(said) == ("y", "one: x", "three: z", "three: x")
    assert of_each({"one": ("x",)}) == ("x",)


# --- an instrument that was turned between two sweeps


def swept(seed: int, turn: Any, *, other: bool = False) -> tn.Sweep:
    """The sample's axis with a radial error along X, in the frame of an instrument turned so."""
    known = tn.read_sweep(tn.sample_path("axis/sweep.csv"))
    at = np.radians(known.angle_deg)
    place = known.position_mm + 7e-4 * np.random.default_rng(seed).standard_normal((len(at), 3))
    place[:, 0] += 0.006 * np.cos(2 * at)
    place[:, 1] += 0.006 * np.cos(2 * at) * other
    x, y, z = (place @ np.asarray(turn, dtype=float).T).T
    return known.with_columns(x_mm=x, y_mm=y, z_mm=z)


ABOUT_Z = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
ABOUT_X = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]


@pytest.mark.parametrize("turn", [ABOUT_Z, ABOUT_X], ids=["Z", "X"])
def test_a_turned_instrument_is_asked_about(turn: Any) -> None:
    first, turned = swept(101, np.eye(3)), swept(102, turn)
    said = "turned by 90 deg in the instrument's frame"
    found = tn.compare(first, turned)
    assert said in " ".join(found.notes)
    assert ("radial_2 (rms)" in found.changed) == (turn is ABOUT_Z)
    assert f"The targets of sweep 2 lie as those of sweep, {said}" in " ".join(
        tn.diagnose([first, turned]).notes
    )


def test_a_changed_axis_is_no_turned_instrument() -> None:
    """Nor are the same targets in the same frame, nor others."""
    first = swept(103, np.eye(3))
    for other in (swept(104, np.eye(3), other=True), swept(105, np.eye(3))):
        assert "turned" not in " ".join(tn.compare(first, other).notes)
    far = swept(106, ABOUT_Z)
    mounted = far.with_columns(z_mm=far.z_mm + 30.0 * (far.target == far.target[0]))
    assert first.done_otherwise(far, ("a", "b"))
    assert first.done_otherwise(mounted, ("a", "b")) == ""
    assert first.done_otherwise(far[:2], ("a", "b")) == ""

"""Axes that miss the origin, an artefact off the middle: what the formulas for the origin become.

Kinematics, readings, derivatives and least squares with them are in the cross-checks.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn

MEETING = tn.Setup(artefact=tn.Artefact("cross"), table=tn.TableSetup(80.0, 20.0))
SUNK = replace(MEETING, axes={"A": tn.AxisSetup(point_mm=(40.0, 7.0, -30.0))})
ERRORS = {
    "EA0A": 21.6, "EB0A": 18.0, "EC0A": -10.8, "EB0C": 25.2,
    "EX0C": 15.0, "EY0A": -17.0, "EZ0A": 12.0, "EY0C": 21.0,
}  # fmt: skip
PLACED = {"dx_um": 30.0, "dy_um": -20.0, "dz_um": 10.0, "rc_arcsec": 15.0, "ra_arcsec": -8.0}


def test_separating_forms_hold_for_an_axis_anywhere() -> None:
    data = tn.simulate(tn.plan(SUNK), SUNK, ERRORS, PLACED)
    found = tn.closed_form(data, SUNK)
    assert found.errors == pytest.approx(ERRORS, abs=1e-3)
    assert found.placement == pytest.approx({"rb_arcsec": 0.0} | PLACED, abs=1e-3)


def test_printed_forms_return_what_they_return_for_an_axis_through_the_origin() -> None:
    """Position by position of C and A, on a machine with the same errors.

    Without EB0A, of which equation (9) finds 73 %: what it misses acts on EX with the axis' depth.
    """
    errors = ERRORS | {"EB0A": 0.0}
    results = [
        tn.closed_form(tn.simulate(tn.plan(setup), setup, errors), setup, method="printed")
        for setup in (MEETING, SUNK)
    ]
    rows = [[*found.per_position.c, *found.per_position.a] for found in results]
    for one, other in zip(*rows, strict=True):
        # Products of two errors with the axis' offset: 30 mm · 1e-4 · 1e-4.
        assert one == pytest.approx(other, abs=0.02)


def test_forms_refuse_an_artefact_off_the_middle() -> None:
    off = replace(MEETING, artefact=tn.Artefact("cross", place_mm=(0.0, 0.0, 12.0)))
    plan = tn.plan(off)
    data = tn.simulate(plan, off, ERRORS)
    with pytest.raises(tn.DataError, match=r"artefact off the middle .*\(identify\)"):
        tn.closed_form(data, off)
    fit = tn.identify(data, off)
    assert fit.errors == pytest.approx(ERRORS, abs=1e-6)


def test_a_plan_follows_the_nominal_geometry_and_known_errors() -> None:
    """The expected contact is where the touch of that machine is."""
    known = replace(SUNK, machine=tn.Machine(errors={"EZ0A": 1500.0, "EA0A": 200.0}))
    turned = replace(known, artefact=tn.Artefact("cross", place_mm=(20, -10, 5), turn_deg=30))
    for setup in (known, turned):
        plan = tn.plan(setup, c_deg=(0, 50), a_deg=(90, -60), dither=False)
        assert len(plan) > 30
        touched = tn.simulate(plan, setup)
        assert np.abs(touched.position_mm - plan.position_mm).max() < 1e-9
    assert len(tn.plan(known)) == 72


def test_volumetric_error_and_compensation_follow_the_axis() -> None:
    """EB0A turns about the A axis: 30 mm deeper, the table top moves 30 mm · EB0A in X."""
    at = {"x_mm": (0.0,), "y_mm": (0.0,), "z_mm": (0.0,), "a_deg": 0.0, "c_deg": 0.0}
    field = tn.volumetric_error(SUNK, {"EB0A": 10.0, "EB0C": 10.0}, **at).field_um  # type: ignore[arg-type]
    moved = 30e3 * np.deg2rad(10.0 / 3600.0)
    assert np.linalg.norm(np.asarray(field).reshape(-1, 3)[0]) == pytest.approx(moved, rel=1e-4)
    points = np.array([[10.0, -20.0, 30.0], [-40.0, 5.0, 60.0]])
    rotary = {"A": 35.0, "C": -70.0}
    command = tn.inverse_compensation(SUNK, ERRORS, points, rotary)
    axes = np.column_stack([command.linear_mm, command.rotary_deg["A"], command.rotary_deg["C"]])
    reached, _ = tn.forward_kinematics(SUNK, axes, ERRORS)
    assert np.abs(reached - points).max() < 1e-9


def test_a_picture_shows_the_touches_on_the_artefact_wherever_it_stands() -> None:
    """Contacts on the surface of the drawn box, in its frame."""
    box = tn.Artefact("cuboid", 60.0, 40.0, 30.0, place_mm=(25.0, -10.0, 8.0), turn_deg=40.0)
    setup = replace(SUNK, artefact=box)
    ax = tn.plot.plot_artefact(tn.plan(setup, dither=False), setup)
    shown = next(item for item in ax.collections if hasattr(item, "_offsets3d"))
    points = np.abs(np.array(shown._offsets3d).T - [0.0, 0.0, 15.0]) - [30.0, 20.0, 15.0]
    assert np.abs(points.max(axis=1)).max() < 1e-3

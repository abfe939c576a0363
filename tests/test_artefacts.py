"""Several spheres, a ring, a datum cube off centre: against contacts found by another way.

The twin's lines of approach carry the machine's errors and the placement; where the ball touches is
looked for here, by bracketing the distance to the surface, written from the shapes' definition.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.machine.chain import Chain
from trunnion.plot.scenes.machine import Posture, artefact_traces
from twin import forward

PLATE = tn.Artefact(
    "spheres",
    diameter_mm=20.0,
    spheres_mm=((-60.0, -50.0, 60.0), (60.0, -40.0, 80.0), (0.0, 65.0, 50.0)),
)
RING = tn.Artefact("ring", diameter_mm=60.0, outer_diameter_mm=80.0, height_mm=25.0)
CUBE = tn.Artefact("cuboid", 40.0, 40.0, 40.0, place_mm=(70.0, 30.0, 10.0), turn_deg=20.0)
KINDS = {"spheres": PLATE, "ring": RING, "cube": CUBE}
ERRORS = {"EA0A": 12.0, "EB0A": -9.0, "EC0A": 7.0, "EY0A": 21.0, "EZ0A": -14.0}
ERRORS |= {"EB0C": 8.0, "EX0C": 15.0, "EY0C": -11.0}
PLACEMENT = {"dx_um": 40.0, "dy_um": -25.0, "dz_um": 12.0, "ra_arcsec": 30.0, "rb_arcsec": -20.0}
DIMENSIONS: dict[str, dict[str, dict[str, float]]] = {
    "spheres": {"artefact_diameter": {"dd_um": 7.0}, "artefact_spacing": {"ds_um": 25.0}},
    "ring": {"artefact_diameter": {"dd_um": -9.0}, "artefact_height": {"dh_um": 14.0}},
    "cube": {"artefact_length": {"dl_um": 5.0}, "artefact_width": {"dw_um": -6.0}},
}


def gap(artefact: tn.Artefact, ball: Floats, radius: float, grown: dict[str, float]) -> float:
    """Distance of a ball (centre in the artefact's frame) from the surface, mm."""
    more = {name: 1e-3 * value for name, value in grown.items()}
    if artefact.kind == "spheres":
        centres = np.array(artefact.spheres_mm)
        span = max(float(np.linalg.norm(a - b)) for a in centres for b in centres)
        centres = centres * (1 + more.get("ds_um", 0.0) / span)
        size = (artefact.diameter_mm or 0.0) + more.get("dd_um", 0.0)
        return float(np.linalg.norm(ball - centres, axis=1).min()) - size / 2 - radius
    if artefact.kind == "ring":
        bore = ((artefact.diameter_mm or 0.0) + more.get("dd_um", 0.0)) / 2
        out = float(np.hypot(ball[0], ball[1]))
        over = ball[2] - artefact.height_mm - more.get("dh_um", 0.0)
        return (bore - out if out < bore else float(over)) - radius
    half = np.array([artefact.length_mm, artefact.width_mm, artefact.height_mm]) / 2
    half = half + np.array([more.get("dl_um", 0.0), more.get("dw_um", 0.0), 0.0]) / 2
    local = ball - [0.0, 0.0, half[2]]
    return float(np.linalg.norm(local - np.clip(local, -half, half))) - radius


def twin_travel(
    plan: tn.Touches,
    setup: tn.Setup,
    effects: dict[str, dict[str, float]],
    errors: dict[str, float] = ERRORS,
    placement: dict[str, float] = PLACEMENT,
) -> Floats:
    """Travel from each start to the contact, (n,), mm."""
    n = len(plan)
    conditions = forward.Conditions(
        np.asarray(plan["a_deg"]),
        np.asarray(plan["c_deg"]),
        plan.direction,
        np.full(n, 600.0),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
    )
    a = setup.artefact
    theirs = forward.Setup(
        place_mm=a.place_mm, turn_deg=a.turn_deg, ball_radius_mm=setup.probe.ball_radius_mm
    )
    truth = forward.Truth(errors=errors, placement=placement)
    assert plan.start_mm is not None
    lines = forward.approach_lines(conditions, plan.start_mm, theirs, truth)
    grown = {name: value for one in effects.values() for name, value in one.items()}
    found = np.empty(n)
    for i in range(n):

        def of(way: float, i: int = i) -> float:
            ball = lines.start[i] + way * lines.step[i]
            return gap(a, ball, float(lines.radius[i]), grown)

        ways = np.arange(0.0, 12.0, 0.05)
        first = next(k for k, way in enumerate(ways) if of(way) < 0.0)
        found[i] = brentq(of, ways[first - 1], ways[first], xtol=1e-13)
    return found


def wide(setup_artefact: tn.Artefact, **more: Any) -> tuple[tn.Touches, tn.Setup]:
    setup = tn.Setup(artefact=setup_artefact, **more)
    tilts = (35, -35, 20) if setup_artefact.kind == "ring" else (90, -90, 60, -60)
    pairs = [(20, 45), (-20, 200)] if setup_artefact.kind == "ring" else [(60, 45), (-45, 200)]
    return tn.plan(setup, a_deg=tilts, positions_deg=pairs), setup


@pytest.mark.parametrize("kind", KINDS)
def test_simulated_touches_are_the_twins(kind: str) -> None:
    plan, setup = wide(KINDS[kind])
    assert len(plan) > 30
    made = tn.simulate(plan, setup, ERRORS, PLACEMENT, DIMENSIONS[kind])
    assert plan.start_mm is not None
    travel = np.einsum("ij,ij->i", made.position_mm - plan.start_mm, plan.direction)
    assert np.abs(travel - twin_travel(plan, setup, DIMENSIONS[kind])).max() < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_simulated_is_identified(kind: str) -> None:
    plan, setup = wide(KINDS[kind])
    made = tn.simulate(plan, setup, ERRORS, PLACEMENT)
    fit = tn.identify(made, setup)
    for name, value in ERRORS.items():
        if np.isfinite(fit.std_errors[name]):
            assert fit[name] == pytest.approx(value, abs=1e-5), name
    assert fit.rms_um < 1e-6
    if kind != "ring":
        assert all(np.isfinite(fit.std_errors[name]) for name in ERRORS)


@pytest.mark.parametrize(
    ("kind", "cause"), [("spheres", "artefact_spacing"), ("ring", "artefact_diameter")]
)
def test_a_wrong_dimension_is_diagnosed(kind: str, cause: str) -> None:
    plan, setup = wide(KINDS[kind])
    wrong = {cause: {next(iter(DIMENSIONS[kind][cause])): 20.0}}
    found = tn.diagnose(
        tn.simulate(plan, setup, ERRORS, effects=wrong, noise_um=0.3, seed=3), setup
    )
    assert any(cause in chosen for chosen in found.alternatives), found.summary()
    assert found.verdict in ("explained", "ambiguous")


def test_the_rotation_of_a_ring_about_its_axis_is_no_unknown() -> None:
    plan, setup = wide(RING)
    assert "rc_arcsec" not in tn.observability(plan, setup).names
    plan, setup = wide(PLATE)
    assert "rc_arcsec" in tn.observability(plan, setup).names


def test_set_ups_of_all_kinds_are_read_and_written(tmp_path: Path) -> None:
    file = tmp_path / "setup.toml"
    for artefact in (*KINDS.values(), replace(RING, base_mm=(90.0, 90.0, 10.0))):
        setup = tn.Setup(artefact=artefact)
        for comments in (False, True):
            file.write_text(setup.to_toml(comments=comments))
            assert tn.read_setup(file) == setup
    text = "got 2 mm|artefact spheres in mm|apart"
    close = tn.Artefact("spheres", diameter_mm=20.0, spheres_mm=((0, 0, 50), (10, 0, 50)))
    with pytest.raises(tn.InputError, match=text):
        tn.plan(tn.Setup(artefact=close))
    with pytest.raises(tn.InputError, match=r"outer_diameter_mm.*more than"):
        tn.Artefact("ring", diameter_mm=60.0, outer_diameter_mm=50.0)
    with pytest.raises(tn.InputError, match=r"spheres_mm"):
        tn.Artefact("spheres", diameter_mm=20.0)


def test_what_is_written_for_the_cross_alone_refuses_with_the_reason() -> None:
    for artefact in (PLATE, RING):
        plan, setup = wide(artefact)
        data = tn.simulate(plan, setup, ERRORS)
        with pytest.raises(tn.DataError, match="another kind, expected a cross; identify takes"):
            tn.closed_form(data, setup)
        text = f"kind '{artefact.kind}', expected one of cross, cuboid, sphere: its contact"
        with pytest.raises(tn.InputError, match=text):
            tn.casadi_baseline.identify(data, setup)


def test_all_kinds_are_drawn_where_they_are() -> None:
    """The corners of the meshes are within the artefact's size, at both ends of its height."""
    for artefact, top in ((PLATE, 90.0), (RING, 25.0), (CUBE, 50.0)):
        setup = tn.Setup(artefact=artefact)
        traces = artefact_traces(setup, Posture(Chain(setup), np.zeros(2)))
        heights = np.concatenate([np.asarray(t["z"]) for t in traces if t["type"] == "mesh3d"])
        assert heights.max() == pytest.approx(top, abs=0.1)

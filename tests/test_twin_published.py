"""Numbers of the paper and about its plan, derived with the twin and without the core."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from twin.forward import EFFECTS, Floats, Setup, Truth, table_pose
from twin.generator import (
    effect_columns,
    jacobian,
    left_of,
    location_names,
    paper_plan,
    rich_plan,
)

TABLE_2 = {
    **{"EA0A": 21.6, "EB0A": 18.0, "EC0A": 10.8, "EB0C": 18.0 + 7.2},
    **{"EX0C": 15.0, "EY0A": 17.0, "EZ0A": 12.0, "EY0C": 17.0 + 4.0},
}
TABLE_2_ESTIMATED = {
    **{"EA0A": 21.5784, "EB0A": 18.0086, "EC0A": 10.8288, "EB0C": 18.0086 + 7.2194},
    **{"EX0C": 14.9908, "EY0A": 16.9500, "EZ0A": 12.0000, "EY0C": 16.9500 + 4.0666},
}
CORNERS = np.array([[*p, 1.0] for p in itertools.product((-150, 150), (-120, 120), (0, 150))])

SETUP = Setup()
PAPER = paper_plan()
DESIGN = jacobian(PAPER, SETUP)
NAMES = location_names(SETUP)


def in_the_papers_unknowns(design: Floats) -> Floats:
    """Columns for EB0C-EB0A and EY0C-EY0A in the places of EB0C and EY0C."""
    change = np.eye(14)
    change[NAMES.index("EB0C"), NAMES.index("EB0A")] = 1.0
    change[NAMES.index("EY0C"), NAMES.index("EY0A")] = 1.0
    return design @ change


def bounds(design: Floats) -> dict[str, float]:
    """Cramér-Rao bounds for 1 µm of noise."""
    covariance = np.linalg.inv(design.T @ design)
    return dict(zip(NAMES, np.sqrt(np.diag(covariance)), strict=False))


def left(id_: str, parameter: int = 0) -> Floats:
    """What the plain fit leaves of one unit of an effect."""
    return left_of(effect_columns(PAPER, SETUP, id_)[:, parameter], DESIGN)


# --- Table 3 --------------------------------------------------------------------------------------


def corners_off_um(errors: dict[str, float], than: dict[str, float]) -> float:
    one, other = (table_pose(np.zeros(1), np.zeros(1), SETUP, Truth(e))[0] for e in (errors, than))
    off: Floats = np.linalg.norm((CORNERS @ (one - other).T)[:, :3], axis=1)
    return float(off.max() * 1e3)


def test_the_largest_volumetric_error_of_table_3() -> None:
    assert corners_off_um(TABLE_2, {}) == pytest.approx(50.768, abs=5e-4)  # the paper prints 50.77


def test_what_the_estimated_errors_leave() -> None:
    assert corners_off_um(TABLE_2, TABLE_2_ESTIMATED) == pytest.approx(0.0629, abs=5e-5)


# --- what the 72 touches can tell -----------------------------------------------------------------


def test_fourteen_parameters_are_seen_at_condition_6_44() -> None:
    design = in_the_papers_unknowns(DESIGN)
    singular = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
    assert singular[-1] > 0.2
    assert singular[0] / singular[-1] == pytest.approx(6.44, abs=0.005)
    # The figure belongs to the unknowns as the paper has them; absolute EB0C and EY0C give 5.87.
    singular = np.linalg.svd(DESIGN / np.linalg.norm(DESIGN, axis=0), compute_uv=False)
    assert singular[0] / singular[-1] == pytest.approx(5.87, abs=0.005)


def test_cramer_rao_bounds() -> None:
    # EB0C and EY0C stand for EB0C-EB0A and EY0C-EY0A here.
    assert bounds(in_the_papers_unknowns(DESIGN)) == pytest.approx(
        {"EA0A": 1.82, "EB0A": 2.75, "EC0A": 2.92, "EB0C": 3.37}
        | {"EX0C": 0.236, "EY0A": 0.433, "EZ0A": 0.359, "EY0C": 0.400},
        rel=2e-3,
    )


def test_cramer_rao_bounds_of_the_layout_on_top_faces() -> None:
    top = bounds(jacobian(paper_plan(layout="top"), SETUP))
    assert top["EB0A"] == pytest.approx(3.89, rel=2e-3)
    assert top["EC0A"] == pytest.approx(2.75, rel=2e-3)
    assert top["EY0A"] == pytest.approx(0.377, rel=2e-3)
    assert top["EZ0A"] == pytest.approx(0.396, rel=2e-3)


def test_half_a_tick_left_in_moves_two_parameters_only() -> None:
    # Late by half a tick along the approach everywhere: like a ball smaller by that.
    late = np.full(72, 0.05)
    moved = np.linalg.lstsq(DESIGN, late, rcond=None)[0]
    names = [*NAMES, "dx_um", "dy_um", "dz_um", "ra", "rb", "rc"]
    by_name = dict(zip(names, moved, strict=True))
    assert by_name.pop("EZ0A") == pytest.approx(-0.039, abs=5e-4)
    assert by_name.pop("dz_um") == pytest.approx(-0.016, abs=5e-4)
    assert np.abs(list(by_name.values())).max() < 1e-6


# --- what they cannot -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("id_", "parameters"),
    [
        ("probe_lobing", 2),
        ("artefact_height", 1),
        ("squareness_xz", 1),
        ("backlash_z", 1),
        ("a_twist", 1),
    ],
)
def test_not_identifiable_under_the_papers_plan(id_: str, parameters: int) -> None:
    for j in range(parameters):
        assert np.linalg.norm(left(id_, j)) < 1e-3


def test_c_backlash_is_not_identifiable_when_the_sense_is_the_same_everywhere() -> None:
    same = paper_plan()
    same.conditions.c_dir[:] = 1.0
    column = effect_columns(same, SETUP, "c_backlash")[:, 0]
    assert np.linalg.norm(left_of(column, DESIGN)) < 1e-6
    assert np.linalg.norm(left("c_backlash")) > 0.2  # the first position not turned to: seen


def alike(one: Floats, other: Floats) -> float:
    return float(abs(one @ other) / np.linalg.norm(one) / np.linalg.norm(other))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("probe_radius", "probe_bending"),
        ("probe_radius", "trigger_delay"),
        ("a_positioning", "a_scale"),
    ],
)
def test_alike_under_the_papers_plan(one: str, other: str) -> None:
    assert alike(left(one), left(other)) > 1 - 1e-9


def test_of_sag_only_the_difference_is_seen_under_any_plan() -> None:
    for plan in (PAPER, rich_plan()):
        design = jacobian(plan, SETUP)
        ky, kz = effect_columns(plan, SETUP, "a_sag").T
        assert np.linalg.norm(left_of(ky - kz, design)) < 1e-4
        assert np.linalg.norm(left_of(ky + kz, design)) > 1.0


def test_exact_dependencies_among_several() -> None:
    def rest(column: Floats) -> float:
        return float(np.linalg.norm(column))

    two = 2 * left("artefact_length") + 2 * left("artefact_width")
    assert rest(left("probe_radius") - two) < 1e-5
    backlash = 2 * (left("backlash_x") + left("backlash_y"))
    assert rest(left("probe_bending") - backlash) < 1e-5
    grow = 0.1 * left("artefact_length") + 0.025 * left("artefact_width")
    assert rest(left("artefact_expansion") - grow) < 1e-5
    four = [left(e) for e in ("probe_radius", "artefact_length", "scale_x", "scale_y")]
    assert rest(left_of(left("scale_z"), np.stack(four, axis=1))) < 1e-5


def test_the_33_columns_of_the_catalogue_have_rank_23() -> None:
    # Which 33: C comes from the same side everywhere, warm-up has a time constant, slips are out.
    plan = paper_plan()
    plan.conditions.c_dir[:] = 1.0
    fixed: dict[str, dict[str, float]] = {"warmup_z": {"tau_min": 5.0}}
    columns = [
        left_of(column, DESIGN)
        for id_ in EFFECTS
        if id_ != "setup_shift"
        for column in effect_columns(plan, SETUP, id_, **fixed.get(id_, {})).T
    ]
    seen = np.stack([c / np.linalg.norm(c) for c in columns if np.linalg.norm(c) > 1e-3], axis=1)
    singular = np.linalg.svd(seen, compute_uv=False)
    assert seen.shape[1] == 33
    assert np.sum(singular > 1e-9) == 23
    assert singular[22] > 0.03

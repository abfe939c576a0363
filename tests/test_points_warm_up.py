"""A part, or the screw of an axis, that warms up while points are measured one after the other."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from promise import kept, needed_runs

RATE = 0.95
SURE = 0.9
NOISE_UM = 0.6
STEEL_UM_M_K = 11.5
HALF_MM = 200.0
SECONDS_A_POINT = 20.0


def places(order: str, rng: np.random.Generator) -> np.ndarray:
    """Places of a plate of 11 by 11 points in the order of measurement, (n, 2)."""
    line = np.linspace(-HALF_MM, HALF_MM, 11)
    rows = [[(x, y) for x in line[:: 1 if i % 2 == 0 or order != "snake" else -1]]
            for i, y in enumerate(line)]  # fmt: skip
    at = np.array([p for row in rows for p in row])
    if order == "columns":
        return at[:, ::-1]
    return at[rng.permutation(len(at))] if order == "any" else at


def kelvin(count: int, warm_k: float, tau_min: float | None) -> np.ndarray:
    """Temperature over that at the start by Newton's law, in steps of a second; None: steady."""
    if tau_min is None:
        return np.linspace(0.0, warm_k, count)
    out, now = [], 0.0
    for _ in range(count):
        out.append(now)
        for _ in range(int(SECONDS_A_POINT)):
            now += (warm_k - now) / (60.0 * tau_min)
    return np.array(out)


def measured(seed: int, at: np.ndarray, error_um: np.ndarray) -> tn.Points:
    """Points with an error of the axes or the part, put down a little askew."""
    rng = np.random.default_rng([51, seed])
    there = at + 1e-3 * (error_um + NOISE_UM * rng.standard_normal(at.shape))
    c, s = np.cos(a := rng.normal(0.0, 2e-3)), np.sin(a)
    there = there @ np.array([[c, s], [-s, c]]) + rng.normal(0.0, 0.5, 2)
    columns = {f"nominal_{x}_mm": at[:, i] for i, x in enumerate("xy")}
    columns |= {f"{x}_mm": there[:, i] for i, x in enumerate("xy")}
    return tn.Points(columns, time_s=SECONDS_A_POINT * np.arange(len(at)))


def warmed(
    seed: int, what: str, order: str, tau_min: float | None, warm_k: float = 2.5
) -> tn.Points:
    """A plate that warms up, held at a corner, or the screw of X or Y, at a bearing outside."""
    at = places(order, np.random.default_rng([52, seed]))
    warm = kelvin(len(at), warm_k, tau_min)[:, None]
    if what == "part_warmup":
        return measured(seed, at, 1e-3 * STEEL_UM_M_K * warm * (at + HALF_MM))
    axis = "xy".index(what[-1])
    grown = 1e-3 * STEEL_UM_M_K * warm * (at + 260.0)
    return measured(seed, at, grown * np.eye(2)[axis])


def sure(d: tn.Diagnosis) -> set[str]:
    """Causes that are named with more than 90 %."""
    return {c.id for c in d.causes if (c.probability or 0.0) > SURE}


NAMED = (
    *(("part_warmup", order) for order in ("rows", "columns", "snake", "any")),
    *(("screw_warmup_x", order) for order in ("rows", "snake", "any")),
    ("screw_warmup_y", "any"),
)


def test_what_warms_up_is_named() -> None:
    """In rows it was an angular error of X, with a positioning of Y, both > 99 %."""
    runs = needed_runs(RATE)
    right, inside = 0, 0
    for seed in range(runs):
        what, order = NAMED[seed % len(NAMED)]
        d = tn.diagnose(warmed(seed, what, order, (10.0, 20.0, 35.0)[seed % 3]))
        right += sure(d) == {what}
        cause = next((c for c in d.causes if c.id == what), None)
        if cause is not None:
            off = abs(cause.parameters["ppm"] - 2.5 * STEEL_UM_M_K)
            inside += off < 3.0 * cause.std_errors["ppm"]
    assert kept(right, runs, RATE)
    assert kept(inside, runs, RATE)


def test_a_screw_that_warms_up_row_by_row_across_it_is_no_positioning_for_sure() -> None:
    """Time and place are nearly the same then. It was > 90 % in 5 of 8."""
    runs = needed_runs(RATE)
    right = 0
    for seed in range(runs):
        data = warmed(seed, "screw_warmup_y", ("rows", "snake")[seed % 2], 10.0 + seed % 20)
        right += "positioning_y" not in sure(tn.diagnose(data))
    assert kept(right, runs, RATE)


def test_what_grows_steadily_is_no_error_of_the_axes_for_sure() -> None:
    """A screw that grows so, row by row, is an angular error of X but for its shape in time."""
    runs = needed_runs(RATE)
    right = 0
    for seed in range(runs):
        what, order = [one for one in NAMED if one[1] != "columns"][seed % 6]
        right += sure(tn.diagnose(warmed(seed, what, order, None))) <= {what}
    assert kept(right, runs, RATE)


def test_an_angular_error_is_no_warm_up_for_sure() -> None:
    """X yaws along its travel: points are off across it by their height."""
    runs = needed_runs(RATE)
    right, named = 0, 0
    for seed in range(runs):
        at = places(("rows", "any")[seed % 2], np.random.default_rng([53, seed]))
        yaw = np.radians(8.0 / 3600.0) * at[:, 0] / HALF_MM
        d = tn.diagnose(measured(seed, at, np.outer(-1e3 * yaw * at[:, 1], [1.0, 0.0])))
        right += sure(d) <= {"angular_z_of_x"}
        named += "angular_z_of_x" in sure(d)
    assert kept(right, runs, RATE)
    assert kept(2 * named, runs, RATE)


def test_a_plate_that_only_drifts_has_not_grown() -> None:
    runs = needed_runs(RATE)
    right = 0
    for seed in range(runs):
        at = places("any", np.random.default_rng([54, seed]))
        moved = kelvin(len(at), 5.0, (None, 15.0)[seed % 2])  # µm
        d = tn.diagnose(measured(seed, at, np.outer(moved, [1.0, 0.0])))
        right += sure(d) <= {"drift_x", "warmup_x"}
    assert kept(right, runs, RATE)


def test_a_part_that_warms_up_is_not_the_machine_s() -> None:
    """On other points it is fitted anew; a screw is no error of any other time."""
    part = tn.diagnose(warmed(1, "part_warmup", "any", 20.0))
    other = warmed(2, "part_warmup", "any", 20.0, warm_k=1.0)
    assert part.named == {"part_warmup"}
    assert part.model is not None
    assert np.ptp(part.model.error_um(other, features=False)) < 1e-6
    assert part.score(other).rms_after_um == pytest.approx(NOISE_UM, rel=0.2)
    assert tn.Diagnosis.from_json(part.to_json()) == part

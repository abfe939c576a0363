"""Random machines with hidden errors below a real LinuxCNC, and the set-ups that know them not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import trunnion as tn
from controller import Bench, run

FloatArray = npt.NDArray[np.float64]

RACE = "Queue is not empty after probing"
SPEED = 20.0
SERVO_MS = 1.0
ARCSEC = np.pi / 648_000
ERRORS = ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C")


@dataclass(frozen=True)
class Hidden:
    """A set-up, its plan, and the machine that it is run on."""

    setup: tn.Setup
    plan: tn.Touches
    bench: Bench
    errors: dict[str, float]
    seed: int


def turned(axis: int, angle: float) -> FloatArray:
    """Turn about X, Y or Z, (4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    place = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    place[i, i] = place[j, j] = c
    place[i, j], place[j, i] = -s, s
    return place


def placed(x: float, y: float, z: float, a: float, b: float, c: float) -> FloatArray:
    """Translate, then turn about X, Y, Z in this order; mm and rad."""
    place = np.eye(4)
    place[:3, 3] = x, y, z
    return place @ turned(0, a) @ turned(1, b) @ turned(2, c)


def places(errors: dict[str, float]) -> tuple[FloatArray, FloatArray]:
    """T_A and T_C of a ``trt-ca``, written from the contract's formula; µm and arcsec."""
    e = {k: v * (1e-3 if k[1] in "XYZ" else ARCSEC) for k, v in errors.items()}
    a = placed(0, e["EY0A"], e["EZ0A"], e["EA0A"], e["EB0A"], e["EC0A"])
    c = placed(e["EX0C"], e["EY0C"] - e["EY0A"], 0, 0, e["EB0C"] - e["EB0A"], 0)
    return a, c


def boxes(artefact: tn.Artefact) -> list[list[float]]:
    """The artefact as the bench knows it."""
    x, y, z = artefact.length_mm / 2, artefact.width_mm / 2, artefact.height_mm / 2
    if artefact.kind == "cross":
        return [[0, 0, z, x, y, z, 0], [0, 0, z, y, x, z, 0]]
    return [[0, 0, z, x, y, z, 0]]


def set_up(rng: np.random.Generator, clearance: float, **plan: float) -> tn.Setup:
    """An artefact, a probe and a table of random sizes; speeds of the fast machine."""
    kind = ("cross", "cuboid")[int(rng.integers(2))]
    length = float(rng.uniform(70, 130))
    share = float(rng.uniform(0.2, 0.35) if kind == "cross" else rng.uniform(0.5, 1.0))
    ball = float(rng.uniform(1.0, 2.5))
    return tn.Setup(
        artefact=tn.Artefact(
            kind, length_mm=length, width_mm=share * length, height_mm=float(rng.uniform(20, 40))
        ),
        probe=tn.Probe(ball_radius_mm=ball, stem_radius_mm=0.6 * ball),
        table=tn.TableSetup(radius_mm=float(rng.uniform(100, 160))),
        plan=tn.PlanSetup(
            clearance_mm=clearance,
            rapid_mm_min=10_000 * SPEED,
            rotary_deg_min=180 * 60 * SPEED,
            **plan,
        ),
        control=tn.ControlSetup(
            tool_number=1,
            positioning_mm_min=2000 * SPEED,
            acceleration_mm_s2=2000 * SPEED**2,
            rotary_acceleration_deg_s2=1500 * SPEED**2,
            centre_mm=tuple(rng.uniform(-50, 50, 3).tolist()),
        ),
    )


def hidden(seed: int, clearance: float | None = None, **plan: float) -> Hidden:
    """A random machine; the artefact's corners are off by up to 0.6 of the clearance."""
    rng = np.random.default_rng(seed)
    clearance = float(rng.uniform(2.0, 5.0)) if clearance is None else clearance
    setup = set_up(rng, clearance, **plan)
    errors = {name: float(rng.uniform(-60, 60)) for name in ERRORS}
    a, c = places(errors)
    offset, tilt = 0.5 * clearance / np.sqrt(3), np.radians(0.15)
    placement = [*rng.uniform(-offset, offset, 3), *rng.uniform(-tilt, tilt, 3)]
    centre = setup.control.centre_mm
    assert centre is not None
    bench = Bench(
        boxes=boxes(setup.artefact),
        place_a=a,
        place_c=c,
        place_s=placed(*placement),
        origin=centre,
        tool_mm=float(np.round(rng.uniform(60, 200), 3)),
        ball_mm=setup.probe.ball_radius_mm,
        stem_mm=setup.probe.effective_stem_radius_mm,
        table_radius_mm=setup.table.radius_mm,
        table_thickness_mm=setup.table.thickness_mm,
        speed=SPEED,
        seed=seed,
    )
    return Hidden(setup, tn.plan(setup, feeds_mm_min=[600 * SPEED]), bench, errors, seed)


def work_offset(case: Hidden) -> list[dict[str, str]]:
    """MDI lines that put G54 where it belongs."""
    assert case.setup.control.centre_mm is not None
    x, y, z = case.setup.control.centre_mm
    return [{"mdi": f"G10 L2 P1 X{x:.4f} Y{y:.4f} Z{z:.4f} R0"}, {"mdi": "T1 M6"}]


def run_program(case: Hidden, folder: Path, *before: str, text: str | None = None) -> Any:
    """Run a case's program from a clean state, after more MDI lines; what LinuxCNC reported."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "touches.log").unlink(missing_ok=True)
    report = _run(case, folder, before, text or tn.probing_program(case.plan, case.setup).text())
    # A race in LinuxCNC (its issue 3650) stops one program in some hundred, more on a busy machine.
    while RACE in report["messages"] and report["resumed"] < 5:
        done = (folder / "touches.log").read_text().split("\n")[-2].split()
        following = int(done[0]) + 1 if done[0].isdigit() else 1
        text = tn.probing_program(case.plan, case.setup, start_at=following).text()
        more = _run(case, folder, before, text)
        counted = {name: report[name] + more[name] for name in ("strikes", "stem-strikes")}
        report = {**more, **counted, "resumed": report["resumed"] + 1}
    return report


def _run(case: Hidden, folder: Path, before: Sequence[str], text: str) -> dict[str, Any]:
    (folder / "probe.ngc").write_text(text)
    steps = [*work_offset(case), *({"mdi": line} for line in before), {"program": "probe.ngc"}]
    report: dict[str, Any] = {**run(case.bench, steps, folder)[-1], "resumed": 0}
    assert "error" not in report, report
    return report

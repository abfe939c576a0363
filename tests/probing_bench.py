"""Random machines with hidden errors below a real LinuxCNC, and the set-ups that know them not."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import trunnion as tn
from controller import Bench, once_more, run
from power.report import commit, count_and_out, write

FloatArray = npt.NDArray[np.float64]

COUNTED = ("strikes", "stem-strikes", "moving_seconds")
"""What the runs of one program add up to."""
RACE = "Queue is not empty after probing"
SPEED = 20.0
SERVO_MS = 1.0
ARCSEC = np.pi / 648_000
KINDS = ("cross", "cuboid", "sphere")
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


def places(errors: dict[str, float], point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """T_A and T_C of a ``trt-ca``, its A axis through a point: docs/explanation/conventions.md."""
    e = {k: v * (1e-3 if k[1] in "XYZ" else ARCSEC) for k, v in errors.items()}
    _, y, z = point
    a = placed(0, y + e["EY0A"], z + e["EZ0A"], e["EA0A"], e["EB0A"], e["EC0A"])
    c = placed(e["EX0C"], e["EY0C"] - e["EY0A"] - y, -z, 0, e["EB0C"] - e["EB0A"], 0)
    return a, c


def boxes(artefact: tn.Artefact) -> list[list[float]]:
    """The artefact as the bench knows it: middle, half sides, radius of the edges."""
    if artefact.kind == "sphere":
        assert artefact.diameter_mm is not None
        assert artefact.centre_mm is not None
        x, y, z = artefact.centre_mm
        # The stem stands on the table, as a capsule whose upper end is in the sphere.
        stem, foot = artefact.effective_stem_diameter_mm / 2, -artefact.place_mm[2]
        return [
            [x, y, z, 0, 0, 0, artefact.diameter_mm / 2],
            [x, y, (z + foot) / 2, 0, 0, (z - foot) / 2 - stem, stem],
        ]
    x, y, z = artefact.length_mm / 2, artefact.width_mm / 2, artefact.height_mm / 2
    if artefact.kind == "cross":
        return [[0, 0, z, x, y, z, 0], [0, 0, z, y, x, z, 0]]
    return [[0, 0, z, x, y, z, 0]]


def an_artefact(rng: np.random.Generator, tolerance: float, kind: str) -> tn.Artefact:
    """A cross, cuboid or sphere of random size, somewhere on the table."""
    standing: dict[str, Any] = {
        "place_mm": (*rng.uniform(-15, 15, 2).tolist(), float(rng.uniform(0, 30))),
        "turn_deg": float(rng.uniform(-20, 20)),
        "tolerance_mm": tolerance,
        "tolerance_deg": float(rng.uniform(0.05, 0.3)),
    }
    if kind == "sphere":
        height = float(rng.uniform(40, 90))
        centre = (*rng.uniform(-40, 40, 2).tolist(), height)
        return tn.Artefact(
            kind, diameter_mm=float(rng.uniform(15, 40)), centre_mm=centre, **standing
        )
    length = float(rng.uniform(70, 130))
    share = float(rng.uniform(0.2, 0.35) if kind == "cross" else rng.uniform(0.5, 1.0))
    height = float(rng.uniform(20, 40))
    return tn.Artefact(
        kind, length_mm=length, width_mm=share * length, height_mm=height, **standing
    )


def set_up(rng: np.random.Generator, clearance: float, kind: str, **plan: float) -> tn.Setup:
    """An artefact, a probe and a trunnion of random sizes; speeds of the fast machine."""
    ball = float(rng.uniform(1.0, 2.5))
    return tn.Setup(
        artefact=an_artefact(rng, float(rng.uniform(0.2, 0.4)) * clearance, kind),
        axes={"A": tn.AxisSetup(point_mm=(0.0, *rng.uniform(-20, 20, 2).tolist()))},
        probe=tn.Probe(
            ball_radius_mm=ball, stem_radius_mm=0.6 * ball, servo_period_ms=SERVO_MS / SPEED
        ),
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
            # As G54 shows it: the set-up says where the work offset is.
            centre_mm=tuple(rng.uniform(-50, 50, 3).round(4).tolist()),
        ),
    )


def hidden(
    seed: int,
    clearance: float | None = None,
    kind: str | None = None,
    *,
    at_edge: bool = False,
    feed_mm_min: float = 600 * SPEED,
    **plan: float,
) -> Hidden:
    """A random machine; its artefact stands anywhere within the tolerance of the set-up.

    at_edge: As far off and turned as the tolerance lets it.
    """
    rng = np.random.default_rng(seed)
    clearance = float(rng.uniform(2.0, 5.0)) if clearance is None else clearance
    kind = KINDS[int(rng.integers(3))] if kind is None else kind
    setup = set_up(rng, clearance, kind, **plan)
    artefact, centre = setup.artefact, setup.control.centre_mm
    assert centre is not None
    errors = {name: float(rng.uniform(-60, 60)) for name in ERRORS}
    a, c = places(errors, np.array(setup.axes["A"].point_mm))
    way = rng.normal(size=3)
    share, turned_by = rng.uniform(), rng.uniform(-1, 1)
    if at_edge:
        share, turned_by = 1.0, np.copysign(1.0, turned_by)
    way *= artefact.tolerance_mm * share / np.linalg.norm(way)
    turn = np.radians(artefact.tolerance_deg) * turned_by
    tilts = rng.uniform(-60, 60, 2) * ARCSEC
    x, y, z = artefact.place_mm
    bench = Bench(
        boxes=boxes(artefact),
        place_a=a,
        place_c=c,
        place_s=placed(x + way[0], y + way[1], z + way[2], tilts[0], tilts[1], turn)
        @ turned(2, np.radians(artefact.turn_deg)),
        origin=centre,
        tool_mm=float(np.round(rng.uniform(60, 200), 3)),
        ball_mm=setup.probe.ball_radius_mm,
        stem_mm=setup.probe.effective_stem_radius_mm,
        table_radius_mm=setup.table.radius_mm,
        table_thickness_mm=setup.table.thickness_mm,
        speed=SPEED,
        seed=seed,
    )
    return Hidden(setup, tn.plan(setup, feeds_mm_min=[feed_mm_min]), bench, errors, seed)


def work_offset(case: Hidden) -> list[dict[str, str]]:
    """MDI lines that put G54 where it belongs."""
    assert case.setup.control.centre_mm is not None
    x, y, z = case.setup.control.centre_mm
    return [{"mdi": f"G10 L2 P1 X{x:.4f} Y{y:.4f} Z{z:.4f} R0"}, {"mdi": "T1 M6"}]


def run_program(
    case: Hidden, folder: Path, *, text: str | None = None, log_stays: bool = False
) -> dict[str, Any]:
    """Run a case's program, or another text, from a clean state; what LinuxCNC reported."""
    folder.mkdir(parents=True, exist_ok=True)
    if not log_stays:
        (folder / "touches.log").unlink(missing_ok=True)
    report = _run(case, folder, text or tn.probing_program(case.plan, case.setup).text())
    # A race in LinuxCNC (its issue 3650) stops one program in some hundred, more on a busy machine.
    while RACE in report["messages"] and report["resumed"] < 5:
        done = (folder / "touches.log").read_text().split("\n")[-2].split()
        following = int(done[0]) + 1 if done[0].isdigit() else 1
        text = tn.probing_program(case.plan, case.setup, start_at=following).text()
        more = _run(case, folder, text)
        counted = {name: report[name] + more[name] for name in COUNTED}
        report = {**more, **counted, "resumed": report["resumed"] + 1}
    return report


def _run(case: Hidden, folder: Path, text: str) -> dict[str, Any]:
    (folder / "probe.ngc").write_text(text)
    steps = [*work_offset(case), {"program": "probe.ngc"}]
    return {**run(case.bench, steps, folder)[-1], "resumed": 0}


def one_run(seed: int, folder: Path) -> dict[str, Any]:
    """Probe one machine: what was hit, and how far the estimates are off in standard errors."""
    case = hidden(seed, at_edge=seed % 2 == 0)
    report = run_program(case, folder)
    said = [line for line in report["messages"] if "contact" in line or "Probe" in line]
    touches = tn.read_probe_log(folder / "touches.log", case.plan)
    off: list[float] = []
    if len(touches) == len(case.plan):
        fit = tn.identify(touches, case.setup)
        seen = [name for name in ERRORS if np.isfinite(fit.std_errors[name])]
        off = [(fit.errors[name] - case.errors[name]) / fit.std_errors[name] for name in seen]
    return {
        "kind": case.setup.artefact.kind,
        "clearance": case.setup.plan.clearance_mm,
        "said": said,
        "touches": len(touches),
        "planned": len(case.plan),
        "strikes": report["strikes"],
        "stem_strikes": report["stem-strikes"],
        "resumed": report["resumed"],
        "off": off,
    }


def passes(feeds: Sequence[float], folder: Path, seed: int = 21) -> tuple[float, float, int]:
    """Noise of a reading, µm, time in motion, s, and touches of a program on a cross.

    feeds: mm/min of the approaches at true speed, the second of a second pass. Between moves the
    motion waits for LinuxCNC's task, as long as the load of this computer makes it.
    """
    first, second = (feed * SPEED for feed in (*feeds, 0.0)[:2])
    case = hidden(seed, clearance=5.0, kind="cross", feed_mm_min=first, slow_feed_mm_min=second)
    report = run_program(case, folder)
    assert report["strikes"] == report["stem-strikes"] == 0, report
    touches = tn.read_probe_log(folder / "touches.log", case.plan)
    fit = tn.identify(touches, case.setup)
    # Not `sigma_um`, which the step of a reading holds up.
    noise = float(np.sqrt(np.sum(np.square(fit.residuals_um)) / fit.degrees_of_freedom))
    return noise, float(report["moving_seconds"]), len(touches)


def main(count: int, out: Path | None) -> None:
    """Write what happened on many machines, and what a second pass buys."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        folder = Path(name) / "run"
        rows = [f"| {_feeds(feeds)} | {_measured(feeds, folder)} |" for feeds in PASSES]
        lines = [*HEAD.format(count=count).splitlines(), *_machines(count, folder)]
    write([*lines, "", commit(), "", *TWICE.splitlines(), *rows], out)


def _machines(count: int, folder: Path) -> list[str]:
    runs: list[dict[str, Any]] = []
    seed = 10_000
    while len(runs) < count:
        seed += 1
        try:
            runs.append(once_more(partial(one_run, seed, folder)))
        except tn.DataError as error:  # nothing can be reached
            print(seed, error, flush=True)
            continue
        print(seed, {k: v for k, v in runs[-1].items() if k != "off"}, flush=True)
    rows = []
    for kind in (*KINDS, "all"):
        some = [run for run in runs if kind in (run["kind"], "all")]
        off = np.array([value for run in some for value in run["off"]])
        total = {k: sum(r[k] for r in some) for k in ("touches", "planned")}
        hit = sum(run["strikes"] + run["stem_strikes"] > 0 for run in some)
        whole = sum(run["touches"] == run["planned"] for run in some)
        resumed = sum(run["resumed"] > 0 for run in some)
        if some:
            rms = float(np.sqrt(np.mean(off**2)))
            rows.append(
                f"| {kind} | {len(some)} | {whole} | {total['touches']} of {total['planned']} | "
                f"{hit} | {resumed} | {rms:.2f} |"
            )
    return rows


def _feeds(feeds: Sequence[float]) -> str:
    return ", then ".join(f"{feed:g}" for feed in feeds)


def _measured(feeds: Sequence[float], folder: Path) -> str:
    noise, seconds, touches = once_more(partial(passes, feeds, folder))
    return f"{noise:.3g} | {seconds:.0f} | {touches}"


PASSES = ((600,), (60,), (30,), (600, 30))
TWICE = """## What a second pass buys

A cross, a servo period of 1 ms, a probe without scatter of its own: what is left is the step of a
reading, feed × period. *Noise*: standard deviation of one reading as the residuals of an
identification show it. *Time*: in which an axis moves.

| feed, mm/min | noise, µm | time, s | touches |
|---|---|---|---|
"""
HEAD = """# Probing programs in LinuxCNC: {count} machines

Made by `make linuxcnc`. Each machine has random location errors (±60), a random artefact and
probe, an A axis up to 20 mm off the table's centre, an artefact that stands anywhere within the
stated tolerance of its place (every other one as far off and turned as it lets it), and a
clearance of 2 to 5 mm. LinuxCNC runs the program of
`trunnion program` over a simulated machine that says where ball and stem touch what. *Hit*: runs
with a contact outside a probing move, or of the stem or the table. *Resumed*: stopped by
LinuxCNC's own race ("Queue is not empty after probing") and gone on with by `--from`. *Off*: rms
of (estimate − true) / standard error over the errors.

| artefact | machines | whole | touches | hit | resumed | off |
|---|---|---|---|---|---|---|
"""

if __name__ == "__main__":
    main(*count_and_out(__doc__))

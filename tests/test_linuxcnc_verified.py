"""A ball on the table, touched in the real LinuxCNC before and after the corrections."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from controller import compiled, needs_linuxcnc
from corrected_bench import pose
from probing_bench import SPEED, Hidden, boxes, hidden, placed, run_program
from test_linuxcnc_corrected import probed, trunnion

pytestmark = needs_linuxcnc

BALL = tn.Artefact(
    "sphere", diameter_mm=25.0, centre_mm=(55.0, 40.0, 65.0), tolerance_mm=0.5, tolerance_deg=0.2
)


CENTRE = np.array([55.0, 40.0, 65.0, 1.0])


def corrected_bench(case: Hidden, folder: Path) -> Any:
    source = (folder / "trunnionkins.comp").read_text()
    return replace(
        case.bench,
        kinematics="trunnionkins",
        components={"trunnionkins": compiled("trunnionkins", source)},
        hal=(folder / "trunnion.hal").read_text(),
    )


def ball_on(case: Hidden) -> Hidden:
    """The same machine with a ball on its table, somewhat off its place."""
    control = replace(case.setup.control, tcp_off="M429")
    setup = replace(case.setup, artefact=BALL, control=control)
    bench = replace(case.bench, boxes=boxes(BALL), place_s=placed(0.2, -0.1, 0.1, 0, 0, 1e-3))
    return replace(case, setup=setup, bench=bench)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Hidden]:
    """A machine measured on a cross, and its corrections: by commands."""
    folder = tmp_path_factory.mktemp("verified")
    folder.chmod(0o755)
    case = hidden(31, clearance=4.0, kind="cross", slow_feed_mm_min=30 * SPEED)
    (folder / "setup.toml").write_text(case.setup.to_toml())
    trunnion(folder, "plan", "setup.toml", "-o", "plan.csv", "--feeds", f"{600 * SPEED:g}")
    case = replace(case, plan=tn.read_touches(folder / "plan.csv"))
    probed(case, folder, "cross")
    words = ("cross.json", "setup.toml", "--control", "linuxcnc", "-o", "made")
    trunnion(folder, "compensate", *words)
    return folder, case


def moved_um(case: Hidden) -> float:
    """How far the ball of the hidden machine leaves its mean place for a control without errors."""
    point = np.array(case.setup.axes["A"].point_mm)
    free = dict.fromkeys(case.errors, 0.0)
    seen = []
    for a, c in product((0, 30, -40), (0, 120, 240)):
        at = pose(case.errors, point, a, c) @ case.bench.place_s @ CENTRE
        seen.append(np.linalg.solve(pose(free, point, a, c), at)[:3])
    away = np.linalg.norm(seen - np.mean(seen, axis=0), axis=1)
    return float(1e3 * away.max())


def held(case: Hidden, folder: Path, name: str, *options: str) -> None:
    """Program, run, log, touches."""
    trunnion(folder, "program", "ball.csv", "ball.toml", "-o", f"{name}.ngc", *options)
    report = run_program(case, folder / name, text=(folder / f"{name}.ngc").read_text())
    assert report["strikes"] == report["stem-strikes"] == 0, report
    trunnion(folder, "touches", "ball.csv", f"{name}/touches.log", "ball.toml", "-o", f"{name}.csv")
    assert len(tn.read_touches(folder / f"{name}.csv")) == len(case.plan), report


def test_the_ball_stays_where_it_is_and_as_forecast(run: tuple[Path, Hidden]) -> None:
    folder, case = run
    ball = ball_on(case)
    (folder / "ball.toml").write_text(ball.setup.to_toml())
    words = ("--tilt", "30,-40", "--c", "0,120,240", "--every-pose")
    trunnion(folder, "plan", "ball.toml", "-o", "ball.csv", "--feeds", f"{600 * SPEED:g}", *words)
    ball = replace(ball, plan=tn.read_touches(folder / "ball.csv"))
    held(ball, folder, "before")
    held(replace(ball, bench=corrected_bench(ball, folder / "made")), folder, "after", "--tcp")
    files = ("before.csv", "after.csv", "ball.toml", "--estimate", "cross.json")
    trunnion(folder, "verify", *files, "-o", "verified.json")
    found = json.loads((folder / "verified.json").read_text())
    assert len(found["rotary_deg"]["C"]) == 9
    assert found["max_before_um"] > 40 * found["max_after_um"]
    assert found["as_forecast"], found
    assert found["max_before_um"] == pytest.approx(moved_um(ball), rel=0.02)
    # The log of one frame is not taken for that of the other.
    plan = tn.read_touches(folder / "ball.csv")
    with pytest.raises(tn.FileFormatError, match="is it another plan"):
        tn.read_probe_log(folder / "after/touches.log", plan)
    with pytest.raises(tn.FileFormatError, match="is it another plan"):
        tn.read_table_log(folder / "before/touches.log", plan, ball.setup)

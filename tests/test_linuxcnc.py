"""The probing program in a real LinuxCNC, over machines with hidden errors (tests/controller)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import trunnion as tn
from controller import needs_linuxcnc, run
from probing_bench import ERRORS, Hidden, hidden, run_program, work_offset

pytestmark = needs_linuxcnc

MACHINES = 3


def measured(case: Hidden, folder: Path) -> tuple[tn.Touches, dict[str, Any]]:
    report = run_program(case, folder)
    return tn.read_probe_log(folder / "touches.log", case.plan), report


@pytest.mark.parametrize("seed", range(MACHINES))
def test_nothing_is_hit_and_the_errors_are_found(seed: int, tmp_path: Path) -> None:
    case = hidden(seed, clearance=(2.0, 3.0, 5.0)[seed % 3])
    touches, report = measured(case, tmp_path)
    assert report["strikes"] == report["stem-strikes"] == 0, report
    assert len(touches) == len(case.plan), report
    fit = tn.identify(touches, case.setup)
    # The bench has no noise: what is left is the tick of the servo, 10 µm at the feed of the plan.
    for name in ERRORS:
        assert abs(fit.errors[name] - case.errors[name]) < 4 * fit.std_errors[name]
    assert report["joints"][3:] == [0, 0]


def dirty(case: Hidden, folder: Path, *states: list[str]) -> list[dict[str, Any]]:
    """Start the program from each state, one after the other; reports of the program."""
    (folder / "probe.ngc").write_text(
        tn.probing_program(case.plan, case.setup, dry_run=True).text()
    )
    steps = work_offset(case)
    for lines in states:
        steps += [{"mdi": line} for line in lines] + [{"program": "probe.ngc"}]
    reports = run(case.bench, steps, folder)
    return [r for r in reports if r.get("program")]


REFUSED = {
    "work offset": (["G10 L2 P1 Z0", "G10 L2 P1 X9"], "expected .* as in the set-up"),
    "rotation": (["G10 L2 P1 R1.5"], "G54 is rotated by 1.5"),
    "rotary offset": (["G10 L2 P1 R0 C90"], "G54 shifts C by 90"),
    "G92": (["G10 L2 P1 C0", "G92 X3"], "a G92 offset is active"),
    "another tool": (["G92.1", "T2 M6"], "tool 2.* is in the spindle, expected tool 1"),
}


def test_dirty_states_are_refused_before_the_first_move(tmp_path: Path) -> None:
    case = hidden(7)
    x, y, z = case.setup.control.centre_mm or (0, 0, 0)
    right = [f"G10 L2 P1 X{x:.4f} Y{y:.4f} Z{z:.4f} R0 A0 C0", "G92.1", "T1 M6"]
    states = []
    for lines, _ in REFUSED.values():
        states.append([*right, *lines])
    leftovers = [*right, "G20 G91 G64 G18", "M3 S100", "M7", "G55"]
    reports = dirty(case, tmp_path, *states, leftovers)
    for (name, (_, message)), report in zip(REFUSED.items(), reports, strict=False):
        assert any(re.search(message, said) for said in report["messages"]), (name, report)
        assert report["travel"] == 0, name
    last = reports[-1]
    assert last["travel"] > 1000
    assert last["strikes"] == last["stem-strikes"] == last["touches"] == 0
    assert not any("expected" in said for said in last["messages"])

"""Programs that a real LinuxCNC must refuse before they move: a changed frame, a wrapped axis."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from controller import needs_linuxcnc, run
from probing_bench import ERRORS, Hidden, hidden, work_offset

pytestmark = needs_linuxcnc

STOPPED_AT = 30


def broken(case: Hidden, at: int = STOPPED_AT) -> str:
    """The program of a case whose touch `at` ends before the artefact, which stops the run."""
    text = tn.probing_program(case.plan, case.setup).text()
    calls = [line for line in text.splitlines() if line.startswith("o<touch> call")]
    fields = calls[at - 1].split()
    start, end = (np.array([float(n[1:-1]) for n in fields[i : i + 3]]) for i in (7, 10))
    early = start + 0.4 / np.linalg.norm(end - start) * (end - start)
    fields[10:13] = [f"[{value:.4f}]" for value in early]
    return text.replace(calls[at - 1], " ".join(fields))


def shifted(case: Hidden, *by: float) -> dict[str, str]:
    """Put G54 this far from where it belongs."""
    assert case.setup.control.centre_mm is not None
    at = np.add(case.setup.control.centre_mm, by)
    return {"mdi": "G10 L2 P1 " + " ".join(f"{x}{v:.5f}" for x, v in zip("XYZ", at, strict=True))}


def programs(reports: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [report for report in reports if "program" in report]


def said(report: dict[str, Any], message: str) -> bool:
    return any(re.search(message, one) for one in report["messages"])


def may_be_off(case: Hidden, degrees: float) -> Hidden:
    """A case whose set-up lets the work offset shift the rotary axes so far, and a plan of it."""
    control = replace(case.setup.control, rotary_offset_deg=degrees)
    setup = replace(case.setup, control=control)
    feed = float(case.plan["feed_mm_min"][0])
    return replace(case, setup=setup, plan=tn.plan(setup, feeds_mm_min=[feed]))


def found_again(case: Hidden, log: Path) -> None:
    touches = tn.read_probe_log(log, case.plan)
    assert len(touches) == len(case.plan)
    fit = tn.identify(touches, case.setup)
    for name in ERRORS:
        assert abs(fit.errors[name] - case.errors[name]) < 4 * fit.std_errors[name]


def test_a_run_continues_in_its_own_frame_alone(tmp_path: Path) -> None:
    """In one session: 0.2 \u00b5m, another tool length and a turned zero are refused unmoved."""
    case = may_be_off(hidden(13, kind="cuboid"), 0.02)
    (tmp_path / "first.ngc").write_text(broken(case))
    again = tn.probing_program(case.plan, case.setup, start_at=STOPPED_AT).text()
    (tmp_path / "again.ngc").write_text(again)
    resume = {"program": "again.ngc"}
    length = case.bench.tool_mm
    steps = [
        *work_offset(case), {"program": "first.ngc"},
        shifted(case, 0, 2e-4, 0), resume,
        shifted(case, 0, 0, 0), {"mdi": f"G10 L1 P1 Z{length + 3e-4:.4f}"}, resume,
        {"mdi": f"G10 L1 P1 Z{length:.4f}"}, {"mdi": "G10 L2 P1 C0.01"}, resume,
        {"mdi": "G10 L2 P1 C0"}, shifted(case, 5e-5, 0, 0), resume,
    ]  # fmt: skip
    first, offset, tool, turned, whole = programs(run(case.bench, steps, tmp_path, 300))
    assert said(first, f"touch {STOPPED_AT}: no contact")
    for report, message in (
        (offset, r"G54 Y is \S+, expected \S+ as in the run that this one continues"),
        (tool, r"tool length is \S+, expected \S+ as in the run"),
        (turned, r"G54 C is 0\.01\d*, expected 0\.0+ as in the run"),
    ):
        assert said(report, message), report["messages"]
        assert report["travel"] == 0
        assert report["pauses"] == []
    assert whole["strikes"] == whole["stem-strikes"] == 0
    assert not said(whole, "not known here")
    found_again(case, tmp_path / "touches.log")


def test_a_run_continues_after_a_restart(tmp_path: Path) -> None:
    """Parameters are lost then: the log gives the frame, or the operator is told what to see."""
    case = hidden(13, kind="cuboid")
    log = tmp_path / "touches.log"
    (tmp_path / "probe.ngc").write_text(broken(case))
    (first,) = programs(run(case.bench, [*work_offset(case), {"program": "probe.ngc"}], tmp_path))
    assert said(first, f"touch {STOPPED_AT}: no contact")
    known = tn.probing_program(case.plan, case.setup, start_at=STOPPED_AT, continues=log)
    (tmp_path / "known.ngc").write_text(known.text())
    bare = tn.probing_program(case.plan, case.setup, start_at=STOPPED_AT, dry_run=True)
    (tmp_path / "bare.ngc").write_text(bare.text())
    steps = [
        *work_offset(case), shifted(case, 0, 0, -2e-4), {"program": "known.ngc"},
        {"program": "bare.ngc"}, shifted(case, 0, 0, 0), {"program": "known.ngc"},
    ]  # fmt: skip
    refused, asked, whole = programs(run(case.bench, steps, tmp_path, 300))
    assert said(refused, r"G54 Z is \S+, expected \S+ as in the run that this one continues")
    assert refused["travel"] == 0
    # Nothing to compare with: said before the one pause, before anything moves.
    ((before, _),) = asked["pauses"]
    told = asked["messages"][:before]
    assert any("frame of the runs before is not known here" in one for one in told)
    assert any(
        re.match(r"\s*G54 X \S+ Y \S+ Z \S+ A 0.0000 C 0.0000 tool length", one) for one in told
    )
    for report in (asked, whole):
        assert said(report, "no run since this control started: homing moves zeros")
    assert not said(whole, "not known here")
    found_again(case, log)


@pytest.mark.parametrize("letter", ["A", "C"])
def test_a_wrapped_axis_is_refused_before_the_first_move(letter: str, tmp_path: Path) -> None:
    """By the INI file; where the control does not let that be read, by LinuxCNC itself."""
    case = hidden(11)
    text = tn.probing_program(case.plan, case.setup, dry_run=True).text()
    steps = [*work_offset(case), {"program": "probe.ngc"}]
    for lines, interpreter, message in (
        ("WRAPPED_ROTARY = 1", "", f"{letter} would turn otherwise than planned"),
        ("WRAPPED_ROTARY = 1", "INI_VARS = 0", f"400.00 for wrapped rotary axis {letter}"),
        ("WRAPPED_ROTARY = 0", "", ""),
        ("", "INI_VARS = 0", ""),
    ):
        folder = tmp_path / f"{bool(lines)}{bool(interpreter)}{bool(message)}"
        folder.mkdir()
        (folder / "probe.ngc").write_text(text)
        bench = replace(case.bench, axis_ini={letter: lines}, interpreter_ini=interpreter)
        report = run(bench, steps, folder)[-1]
        if message:
            assert said(report, message), report["messages"]
            assert report["travel"] == 0
        else:
            assert report["travel"] > 1000, report["messages"]


def test_a_rotary_axis_that_is_shifted_too_far_is_refused_before_the_first_move(
    tmp_path: Path,
) -> None:
    """Further than the plan keeps clear of, which is nothing unless the set-up says so."""
    plain = hidden(24, kind="cuboid")
    cases = {"plain.ngc": plain, "stated.ngc": may_be_off(plain, 0.3)}
    steps = work_offset(plain)
    for name, case in cases.items():
        (tmp_path / name).write_text(tn.probing_program(case.plan, case.setup).text())
        for a, c in ((1.0, 0.0), (0.0, -1.0), (0.31, 0.0)):
            steps += [{"mdi": f"G10 L2 P1 A{a} C{c}"}, {"program": name}]
    for report in programs(run(plain.bench, steps, tmp_path)):
        assert said(report, r"G54 shifts [AC] by -?\d\S* deg, the plan keeps clear of 0"), report
        assert report["travel"] == 0
        assert report["strikes"] == report["stem-strikes"] == 0
        assert report["pauses"] == []


@pytest.mark.parametrize(("seed", "kind"), [(24, "cuboid"), (25, "cross"), (26, "sphere")])
def test_a_rotary_axis_may_be_shifted_as_far_as_the_plan_keeps_clear_of(
    seed: int, kind: str, tmp_path: Path
) -> None:
    """The table leans and turns by all that is stated, the artefact stands as far off as it may."""
    case = may_be_off(hidden(seed, clearance=5.0, kind=kind, at_edge=True), 0.3)
    (tmp_path / "probe.ngc").write_text(tn.probing_program(case.plan, case.setup).text())
    for number, (a, c) in enumerate(((0.3, -0.3), (-0.3, 0.3))):
        steps = [*work_offset(case), {"mdi": f"G10 L2 P1 A{a} C{c}"}, {"program": "probe.ngc"}]
        report = programs(run(case.bench, steps, tmp_path))[-1]
        assert report["strikes"] == report["stem-strikes"] == 0, report
        touches = tn.read_probe_log(tmp_path / "touches.log", case.plan)
        assert len(touches) == len(case.plan), report["messages"]
        (tmp_path / "touches.log").rename(tmp_path / f"{number}.log")

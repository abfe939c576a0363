"""The probing program in a real LinuxCNC, over machines with hidden errors (tests/controller)."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from controller import Bench, needs_linuxcnc, run
from probing_bench import ERRORS, SPEED, Hidden, hidden, passes, run_program, work_offset
from states_bench import refusals

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


def test_two_passes_are_finer_than_one_in_less_time(tmp_path: Path) -> None:
    case = hidden(21, clearance=3.0, kind="cross", slow_feed_mm_min=30 * SPEED)
    touches, report = measured(case, tmp_path)
    assert report["strikes"] == report["stem-strikes"] == 0
    assert touches.feed_mm_min is not None
    assert np.all(touches.feed_mm_min == 30 * SPEED)
    twice, seconds, _ = passes([600, 30], tmp_path)
    once, slow_seconds, _ = passes([60], tmp_path)
    # The bench's probe has no scatter: what is left are steps of 0.5 µm and 1 µm. Four standard
    # errors of a uniform distribution's deviation from some 56 readings are 24 %.
    assert twice == pytest.approx(0.5 / np.sqrt(12), rel=0.24)
    assert once == pytest.approx(1.0 / np.sqrt(12), rel=0.24)
    assert seconds < 0.5 * slow_seconds


def test_wrong_states_are_refused(tmp_path: Path) -> None:
    """Before the first move; what shows only in a move, before anything turns."""
    for state, found in refusals(7, tmp_path).items():
        assert found["refused"], (state, found)
        assert found["in_time"], (state, found)
        assert not found["hit"], (state, found)


def test_what_is_left_over_and_does_not_matter(tmp_path: Path) -> None:
    """Modes are set anew, and M429 of the set-up switches tool centre point control off."""
    case = hidden(11)
    case = replace(case, bench=replace(case.bench, kinematics="xyzac-trt-kins"))
    control = replace(case.setup.control, tcp_off="M429")
    text = tn.probing_program(case.plan, replace(case.setup, control=control), dry_run=True).text()
    (tmp_path / "probe.ngc").write_text(text)
    left = ["M428", "G20 G91 G64 G18", "M7", "G55"]
    steps = [*work_offset(case), *({"mdi": line} for line in left), {"program": "probe.ngc"}]
    report = run(case.bench, steps, tmp_path)[-1]
    assert report["travel"] > 1000
    assert report["strikes"] == report["stem-strikes"] == report["touches"] == 0
    assert not any("expected" in said or "joint" in said for said in report["messages"])


def test_an_artefact_out_of_place_stops_the_way_down(tmp_path: Path) -> None:
    """The bench sees what a rapid way down would do; the program's own stops on contact."""
    case = hidden(12, clearance=2.0, kind="cross")
    aside, higher = (replace(case, bench=shifted(case, *way)) for way in ((8, 8, 0), (0, 0, 10)))
    report = run_program(aside, tmp_path)
    assert any("contact on the way down to its start" in said for said in report["messages"])
    assert report["strikes"] == 0
    assert report["deepest"] < 2 * 33.3**2 / (2 * 2000)  # stops from 2000 mm/min at 2000 mm/s²
    report = run_program(higher, tmp_path)
    assert any("on the way down to the artefact" in said for said in report["messages"])
    assert report["strikes"] == 0
    assert report["joints"][3:] == [0, 0]
    text = tn.probing_program(case.plan, case.setup).text()
    rapid = run_program(higher, tmp_path, text=re.sub(r"G38\.3( X\S+ Y\S+)? Z", r"G0\1 Z", text))
    assert rapid["strikes"] > 0
    assert rapid["struck-depth"] > 2.0


def shifted(case: Hidden, x: float, y: float, z: float) -> Bench:
    """The machine of a case, its artefact this far from where it stood."""
    place = case.bench.place_s.copy()
    place[:3, 3] += x, y, z
    return replace(case.bench, place_s=place)


LEFT_OVER = {
    (0, 0, -250): "on the way down to the artefact",
    (0, 0, -6): "on the way down to the artefact|contact .* behind",
    (0, 0, 6): "no contact at|contact .* behind",
    (0, 0, 250): "no contact at",
    (300, 0, 0): "no contact at",
}


@pytest.mark.parametrize("kind", ["cross", "sphere"])
def test_a_work_offset_that_nobody_stated_is_seen_before_anything_turns(
    kind: str, tmp_path: Path
) -> None:
    """Without `centre_mm` there is nothing to compare with: the operator is asked, then the probe.

    Nobody looks here: the bench presses cycle start.
    """
    case = hidden(16, clearance=2.0, kind=kind)
    right = case.setup.control.centre_mm or (0, 0, 0)
    bare = replace(case.setup, control=replace(case.setup.control, centre_mm=None))
    (tmp_path / "probe.ngc").write_text(tn.probing_program(case.plan, bare).text())
    steps: list[dict[str, str]] = [{"mdi": "T1 M6"}]
    for off in LEFT_OVER:
        x, y, z = np.add(right, off)
        steps += [{"mdi": "G53 G0 Z300"}, {"mdi": f"G10 L2 P1 X{x:.4f} Y{y:.4f} Z{z:.4f} R0"}]
        steps += [{"program": "probe.ngc"}]
    done = run(case.bench, steps, tmp_path)
    for (off, message), before, report in zip(
        LEFT_OVER.items(), done[2::3], done[3::3], strict=True
    ):
        assert any(re.search(message, said) for said in report["messages"]), (off, report)
        assert report["strikes"] == report["stem-strikes"] == 0, (off, report)
        assert report["joints"][3:] == [0, 0]
        # Asked where everything still is.
        (_, at), *more = report["pauses"]
        assert not more
        assert np.allclose(at, before["joints"], atol=1e-3)
    assert not (tmp_path / "touches.log").exists()


def test_a_stopped_run_is_gone_on_with(tmp_path: Path) -> None:
    """No contact at one touch stops the run; the next begins there, and the log is whole."""
    case = hidden(13, kind="cuboid")
    text = tn.probing_program(case.plan, case.setup).text()
    calls = [line for line in text.splitlines() if line.startswith("o<touch> call")]
    numbers = calls[29].split()
    start, end = (np.array([float(n[1:-1]) for n in numbers[i : i + 3]]) for i in (7, 10))
    early = start + 0.4 / np.linalg.norm(end - start) * (end - start)
    fields = [*numbers[:10], *(f"[{value:.4f}]" for value in early), *numbers[13:]]
    broken = text.replace(calls[29], " ".join(fields))
    stopped = run_program(case, tmp_path, text=broken)
    assert any("touch 30: no contact" in said for said in stopped["messages"])
    assert stopped["strikes"] == 0
    first = tn.read_probe_log(tmp_path / "touches.log", case.plan)
    assert len(first) == 29
    again = tn.probing_program(case.plan, case.setup, start_at=30).text()
    report = run_program(case, tmp_path, text=again, log_stays=True)
    whole = tn.read_probe_log(tmp_path / "touches.log", case.plan)
    assert report["strikes"] == report["stem-strikes"] == 0
    assert len(whole) == len(case.plan)
    fit = tn.identify(whole, case.setup)
    for name in ERRORS:
        assert abs(fit.errors[name] - case.errors[name]) < 4 * fit.std_errors[name]


def test_a_reading_that_is_not_renewed_stops_the_run(tmp_path: Path) -> None:
    """The second probing move of touch 30 is left out, so that the reading of the first stays."""
    case = hidden(14, clearance=3.0, kind="cuboid", slow_feed_mm_min=30 * SPEED)
    text = tn.probing_program(case.plan, case.setup).text()
    (move,) = (x for x in text.splitlines() if "G38.3 X" in x and x.endswith("F#<_slow>"))
    left_out = f"o399 if [#1 NE 30]\n{move}\no399 endif"
    report = run_program(case, tmp_path, text=text.replace(move, left_out))
    assert any("touch 30: the control gave the reading" in said for said in report["messages"])
    assert report["strikes"] == report["stem-strikes"] == 0
    assert len(tn.read_probe_log(tmp_path / "touches.log", case.plan)) == 29


def test_all_that_is_not_as_planned_is_said_at_once(tmp_path: Path) -> None:
    """Three starts found three faults, one each; a G92 that is in force stays so."""
    case = hidden(7)
    (tmp_path / "probe.ngc").write_text(tn.probing_program(case.plan, case.setup).text())
    centre = case.setup.control.centre_mm
    assert centre is not None
    wrong = [f"G10 L2 P1 X{centre[0] + 3.0:.4f} C5", "G92 X3"]
    start = {"program": "probe.ngc"}
    steps = [*work_offset(case), *({"mdi": line} for line in wrong), start, start]
    for report in [one for one in run(case.bench, steps, tmp_path) if one.get("program")]:
        assert report["travel"] == 0
        assert report["pauses"] == []
        for says in (
            r"G54 X is \S+ mm, expected \S+ as in the set-up",
            r"G54 shifts C by 5\.0+ deg, the plan keeps clear of 0",
            "a G92 offset is active, G92.1 cancels it",
            "nothing has moved: 3 not as planned, see the messages before",
        ):
            assert sum(bool(re.search(says, said)) for said in report["messages"]) == 1, report


def test_the_operator_sees_how_far_it_is(tmp_path: Path) -> None:
    """At every posture, and every ten touches of one; not at every touch."""
    case = hidden(2, kind="cuboid")
    report = run_program(case, tmp_path)
    many = len(case.plan)
    pattern = rf"touch (\d+) of {many}, A(\S+) C(\S+), about (\d+) min left"
    progress = [found for said in report["messages"] if (found := re.search(pattern, said))]
    numbers = [int(found[1]) for found in progress]
    turned = np.flatnonzero(
        np.any([np.diff(angle, prepend=np.inf) != 0 for angle in case.plan.rotary_deg.values()], 0)
    )
    assert {*(turned + 1).tolist()} <= {*numbers}
    assert numbers[0] == 1
    assert np.diff([*numbers, many + 1]).max() <= 10
    assert len(numbers) <= len(turned) + many / 10
    for found in progress:
        row = int(found[1]) - 1
        assert float(found[2]) == pytest.approx(case.plan["a_deg"][row], abs=1e-3)
        assert float(found[3]) == pytest.approx(case.plan["c_deg"][row], abs=1e-3)
    left = [int(found[4]) for found in progress]
    assert left == sorted(left, reverse=True)
    assert any("done, touches are in" in said for said in report["messages"])

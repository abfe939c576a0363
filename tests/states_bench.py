"""Probing programs started in a real LinuxCNC from states of the control that they must refuse."""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import trunnion as tn
from controller import once_more, run
from power.report import count_and_out, write
from probing_bench import Hidden, hidden

STATED, BARE, NO_TOOL = "probe.ngc", "bare.ngc", "no_tool.ngc"
"""Programs of a set-up that states everything, no `centre_mm`, no `tool_number`."""


@dataclass(frozen=True)
class State:
    """Lines that bring the control into a state, and the message that refuses it.

    still: Refused before the first move; otherwise before anything turns by more than the 5° of the
        check.
    """

    lines: tuple[str, ...]
    message: str
    program: str = STATED
    still: bool = True


def states(rng: np.random.Generator, centre: np.ndarray) -> dict[str, State]:
    """States that a program must refuse; a work offset off by numbers drawn anew."""
    signs = np.where(rng.uniform(size=3) < 0.5, -1.0, 1.0)
    x, y, z = centre + signs * rng.uniform((0, 0, 6), (20, 20, 60))
    axis = int(rng.integers(3))
    near = centre + np.eye(3)[axis] * signs * rng.uniform(1.1, 5)
    near_at = " ".join(f"{a}{v:.4f}" for a, v in zip("XYZ", near, strict=True))
    letter, turned = str(rng.choice(("A", "C"))), rng.choice((-1, 1)) * 10 ** rng.uniform(-2, 0.5)
    return {
        "work offset off by 1.1 to 5 mm in X, Y or Z": State(
            (f"G10 L2 P1 {near_at}",), "expected .* as in the set-up"
        ),
        "work offset rotated": State(("G10 L2 P1 R1.5",), "is rotated by 1.5"),
        "work offset with C": State(("G10 L2 P1 C90",), "shifts C by 90"),
        "work offset with 0.01 to 3.2° of A or C": State(
            (f"G10 L2 P1 {letter}{turned:.4f}",), f"shifts {letter} by"
        ),
        "G92": State(("G92 X3",), "a G92 offset is active"),
        "another tool": State(("T2 M6",), "tool 2.* is in the spindle, expected tool 1"),
        "no tool length": State(("G49",), "none is in force by G43", NO_TOOL),
        "spindle on": State(("M3 S100",), "the spindle was on"),
        "tool centre point control on, A turned": State(
            ("M428", "G0 A20"), "joint . is not where . is"
        ),
        "tool centre point control on, A and C at 0": State(
            ("M428",), "joints 0 and 1 moved", still=False
        ),
        "work offset off by 6 to 60 mm in Z, `centre_mm` not stated": State(
            (f"G10 L2 P1 X{x:.4f} Y{y:.4f} Z{z:.4f}",),
            "contact on the way|no contact at|contact .* behind",
            BARE,
            still=False,
        ),
    }


def refusals(seed: int, folder: Path) -> dict[str, dict[str, Any]]:
    """Start the programs of one random machine from every state; what came of each.

    The bench presses cycle start where a program asks.
    """
    case = hidden(seed)
    case = replace(case, bench=replace(case.bench, kinematics="xyzac-trt-kins"))
    _write(case, folder)
    centre = np.array(case.setup.control.centre_mm)
    x, y, z = centre
    right = (
        "M5", "G92.1", "M429", "G0 A0 C0", "T1 M6", "G53 G0 Z300",
        f"G10 L2 P1 X{x:.4f} Y{y:.4f} Z{z:.4f} R0 A0 C0",
    )  # fmt: skip
    tried = states(np.random.default_rng(seed), centre)
    steps = []
    for state in tried.values():
        steps += [{"mdi": line} for line in (*right, *state.lines)] + [{"program": state.program}]
    reports = [r for r in run(case.bench, steps, folder) if r.get("program")]
    found = {}
    for (name, state), report in zip(tried.items(), reports, strict=True):
        turned = [abs(angle) for angle in report["joints"][3:]]
        found[name] = {
            "refused": any(re.search(state.message, said) for said in report["messages"]),
            "still": report["travel"] == 0,
            "in_time": report["travel"] == 0 if state.still else max(turned) <= 5.0,
            "hit": report["strikes"] > 0,
            "aside": report["strikes"] == 0 < report["stem-strikes"],
            "said": report["messages"],
        }
    return found


def _write(case: Hidden, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    control = case.setup.control
    for name, changed in (
        (STATED, control),
        (BARE, replace(control, centre_mm=None)),
        (NO_TOOL, replace(control, tool_number=0)),
    ):
        text = tn.probing_program(case.plan, replace(case.setup, control=changed)).text()
        (folder / name).write_text(text)


def main(count: int, out: Path | None) -> None:
    """Write how often each state was refused, and how."""
    found: list[dict[str, dict[str, Any]]] = []
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        folder = Path(name) / "run"
        seed = 20_000
        while len(found) < count:
            seed += 1
            try:
                found.append(once_more(partial(refusals, seed, folder)))
            except tn.DataError as error:  # nothing can be reached
                print(seed, error, flush=True)
                continue
            wrong = {k: v for k, v in found[-1].items() if v["hit"] or not v["refused"]}
            print(seed, wrong or "all refused", flush=True)
    rows = []
    for state in found[0]:
        some = [machine[state] for machine in found]
        counts = [sum(s[key] for s in some) for key in ("refused", "still", "hit", "aside")]
        rows.append(f"| {state} | {' | '.join(map(str, counts))} |")
    write([*HEAD.format(count=count).splitlines(), *rows], out)


HEAD = """# Probing programs in LinuxCNC, started from states that are wrong: {count} machines

Made by `make linuxcnc`. Random machines, artefacts and placements as in
[the runs](linuxcnc-runs.md), with kinematics that know tool centre point control. Each program
is started from each state, and cycle start is pressed where it asks. *Refused*: stopped by the
message that names the state. *Before the first move*: no joint had moved. *Hit*: a contact
outside a probing move. *Aside*: a probing move, which stops on contact, met the table, or the stem
met something.

Two states show only in a move: the control says nowhere whether tool centre point control is on
at A0 C0, where it changes nothing, and nothing is known of a work offset that the set-up does not
state. These are refused after Z has risen and X has moved by 10 mm, and by touches from above
and two sides, before anything turns by more than 5°.

| state | refused | before the first move | hit | aside |
|---|---|---|---|---|
"""

if __name__ == "__main__":
    main(*count_and_out(__doc__))

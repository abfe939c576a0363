"""The tutorial for LinuxCNC, run in an empty folder, with the real control to measure."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from controller import Bench, compiled, needs_linuxcnc, run
from docs_snippets import ROOT, Block, Session, blocks
from probing_bench import ERRORS, boxes, placed, places

PAGE = ROOT / "docs" / "tutorials" / "linuxcnc.md"
LOGS = "/home/me/"
"""Where the page's programs put their logs; LinuxCNC here puts them into its own folder."""
SECONDS = 1800.0

pytestmark = [needs_linuxcnc, pytest.mark.power]


@dataclass
class Machine:
    """Stands in for every ``trunnion simulate`` of the page: LinuxCNC, below it a machine."""

    folder: Path
    errors: dict[str, float]

    @classmethod
    def of(cls, folder: Path, words: list[str]) -> Machine:
        """With the errors that the page's first simulation hides."""
        given = [words[i + 1].split("=") for i, word in enumerate(words) if word == "--error"]
        return cls(folder, {name: float(size) for name, size in given})

    def bench(self) -> Bench:
        """The machine, with the corrections if they are there."""
        setup = tn.read_setup(self.folder / "setup.toml")
        assert setup.control.centre_mm is not None
        errors = dict.fromkeys(ERRORS, 0.0) | self.errors
        a, c = places(errors, np.array(setup.axes["A"].point_mm))
        made = Bench(
            boxes=boxes(setup.artefact), place_a=a, place_c=c,
            place_s=placed(0.3, -0.2, 0.0, 0, 0, 1e-3), origin=setup.control.centre_mm,
            ball_mm=setup.probe.ball_radius_mm, stem_mm=setup.probe.effective_stem_radius_mm,
            noise_mm=2e-4, seed=5, speed=1.0,
        )  # fmt: skip
        files = self.folder / "linuxcnc"
        if not files.exists():
            return made
        source = (files / "trunnionkins.comp").read_text()
        return replace(
            made,
            kinematics="trunnionkins",
            components={"trunnionkins": compiled("trunnionkins", source)},
            hal=(files / "trunnion.hal").read_text(),
        )

    def measure(self, program: str, log: str) -> None:
        """Run a program of the page; its log comes where the page's simulation puts it."""
        inside = self.folder / f"run_{Path(program).stem}"
        inside.mkdir()
        text = (self.folder / program).read_text().replace(LOGS, "")
        (inside / program).write_text(text)
        bench = self.bench()
        x, y, z = bench.origin
        steps: list[dict[str, Any]] = [
            {"mdi": f"G10 L2 P1 X{x:.4f} Y{y:.4f} Z{z:.4f} R0"},
            {"mdi": "T1 M6"},
            {"mdi": "G43 H1"},
            {"program": program},
        ]
        report = run(bench, steps, inside, SECONDS)[-1]
        assert report["strikes"] == report["stem-strikes"] == 0, report
        (self.folder / log).write_text((inside / log).read_text())


def commands(block: Block) -> list[str]:
    """Commands of a shell block, each in one line."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [line for line in lines if line and line[0] != "#"]


def option(words: list[str], *names: str) -> str:
    return next(words[i + 1] for i, word in enumerate(words) if word in names)


def test_the_page_runs_from_an_empty_folder_with_the_real_control(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    session, machine, program = Session(tmp_path), None, ""
    for block in blocks(PAGE.read_text(encoding="utf-8")):
        if block.title:
            (session.folder / block.title).write_text(block.text, encoding="utf-8")
        for line in commands(block) if block.is_run else ():
            words = shlex.split(line, comments=True)
            if words[:2] == ["trunnion", "simulate"]:
                machine = machine or Machine.of(session.folder, words)
                machine.measure(program, option(words, "--probe-log"))
                continue
            if words[:2] == ["trunnion", "program"]:
                program = option(words, "-o", "--output")
            session.run(replace(block, text=line + "\n"))
    assert machine is not None
    setup = tn.read_setup(session.folder / "setup.toml")
    found = tn.read_estimate(session.folder / "estimate.json")
    after = tn.identify(tn.read_touches(session.folder / "after.csv"), setup)
    for name in ERRORS:
        std = after.std_errors[name]
        assert abs(found[name] - machine.errors.get(name, 0.0)) < 5 * found.std_errors[name], name
        assert abs(after[name]) < 5 * np.hypot(std, found.std_errors[name]), name

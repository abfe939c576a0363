"""LinuxCNC's own interpreter, where it is there: canonical moves of a program.

``make rs274`` unpacks it below ``target``; a ``rs274`` on the PATH does as well.
"""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

UNPACKED = Path(__file__).parents[1] / "target" / "rs274"


@dataclass(frozen=True)
class Canonical:
    """A canonical move: X, Y, Z in mm (X a radius), A, B, C in degrees where it ends."""

    kind: str  # traverse, feed, arc, probe
    end: tuple[float, ...]
    centre: tuple[float, float] | None = None  # first and second axis of the plane


@cache
def _command() -> tuple[str, dict[str, str]] | None:
    environment = dict(os.environ)
    program = UNPACKED / "usr/bin/rs274"
    if program.exists():
        libraries = [UNPACKED / "usr/lib", *(UNPACKED / "usr/lib").glob("*-linux-gnu")]
        environment["LD_LIBRARY_PATH"] = ":".join(map(str, libraries))
        environment["PYTHONPATH"] = str(UNPACKED / "usr/lib/python3/dist-packages")
        return str(program), environment
    found = shutil.which("rs274")
    return (found, environment) if found else None


needs_rs274 = pytest.mark.skipif(
    _command() is None, reason="LinuxCNC's rs274 is not here: make rs274 (Debian) fetches it"
)


def interpret(text: str, folder: Path, *, nose_mm: float = 0.0) -> list[Canonical]:
    """Canonical moves of a program; an error of the interpreter fails the test."""
    command = _command()
    assert command is not None
    (folder / "program.ngc").write_text(text)
    # Standalone, it reads its tool table in inches. Orientation 9: the nose's centre.
    (folder / "tool.tbl").write_text(f"T1 P1 D{2 * nose_mm / 25.4:.9f} Q9 ;\n")
    (folder / "empty.var").write_text("")
    done = subprocess.run(
        [command[0], "-t", "tool.tbl", "-v", "empty.var", "-g", "program.ngc"],
        cwd=folder,
        env=command[1],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr + text
    moves: list[Canonical] = []
    position: tuple[float, ...] = (0.0,) * 6
    for line in done.stdout.splitlines():
        match = re.search(
            r"(STRAIGHT_TRAVERSE|STRAIGHT_FEED|STRAIGHT_PROBE|ARC_FEED)\((.*)\)", line
        )
        if match is None:
            continue
        numbers = [float(number) for number in match[2].split(",")]
        if match[1] == "ARC_FEED":
            second_end, first_end = numbers[1], numbers[0]
            centre = (numbers[2], numbers[3])
            # The plane of a lathe: first axis Z, second X.
            position = (second_end, numbers[5], first_end, *numbers[6:9])
            moves.append(Canonical("arc", position, centre))
        else:
            position = tuple(numbers[:6])
            kind = match[1].removeprefix("STRAIGHT_").lower()
            moves.append(Canonical(kind, position))
    return moves

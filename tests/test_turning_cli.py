"""``trunnion turning`` on files."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from samples.make_turning import make_turning
from trunnion import Diameters, sample_path
from trunnion.cli import app
from trunnion.nc import Program, follow

PROGRAM = """G7 G18 G21 G90
G95 F0.1
G0 X70. Z65.
G1 Z20.
G2 X80. Z15. R5.
G1 X90.
Z0
M2
"""


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "part.ngc").write_text(PROGRAM)
    z = np.arange(64.5, 16.0, -0.5)
    error = -15 * (1 - np.exp(-(65 - z) / 1.4 / 20)) + np.random.default_rng(1).normal(0, 0.5, 97)
    Diameters(z_mm=z, error_um=error).to_csv(tmp_path / "diameters.csv")
    (tmp_path / "setup.toml").write_text(
        "[turning]\noverhang_mm = 65.0\nfeed_mm_rev = 0.1\nspindle_rpm = 840.0\n"
    )
    return tmp_path


PATH = ("path", "--no-chuck")


def run(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["turning", *map(str, arguments)])
    assert result.exit_code == code, result.output
    return result.output


def test_path(files: Path) -> None:
    picture = files / "path.png"
    said = run(*PATH, files / "part.ngc", "-o", files / "probe.ngc", "--picture", picture)
    assert "2 intervals" in said
    assert "an arc: not measured" in said
    probe = Program.parse((files / "probe.ngc").read_text(), "linuxcnc-lathe")
    assert len(follow(probe)) > 4
    words = {
        word for line in (files / "probe.ngc").read_text().splitlines() for word in line.split()
    }
    assert {"M5", "G40", "G61"} <= words  # spindle, nose, exact path
    assert picture.stat().st_size > 10_000
    assert len(json.loads(run(*PATH, files / "part.ngc", "--json"))["intervals"]) == 2


def test_the_chuck_has_to_be_stated_and_is_kept_clear_of(files: Path) -> None:
    """The body of the probe, 4.9 mm, stays in front of the face of the jaws, wherever that is."""
    assert "got neither of --chuck-radius-mm and --no-chuck" in run(
        "path", files / "part.ngc", code=2
    )
    both = ("--chuck-radius-mm", 80, "--no-chuck")
    assert "got both of" in run("path", files / "part.ngc", *both, code=2)
    assert "No chuck was stated" in run(*PATH, files / "part.ngc")
    for face in (0.0, -4.0, 11.0):
        out = files / f"probe{face:g}.ngc"
        chuck = ("--chuck-radius-mm", 80, "--chuck-face-mm", face)
        run("path", files / "part.ngc", *chuck, "-o", out)
        text = out.read_text()
        assert f"(Chuck: radius 80 mm, face at Z {face:g})" in text
        assert "(Probe: ball diameter 3.175 mm" in text
        moves = follow(Program.parse(text, "linuxcnc-lathe"))
        low = moves.end[moves.end[:, 0] < 80.0]
        assert low[:, 2].min() > max(face + 2.45, 0.0) - 1e-3


def test_correct(files: Path) -> None:
    out = files / "corrected.ngc"
    said = run("correct", files / "diameters.csv", files / "part.ngc", "-o", out)
    assert "left if it repeats" in said
    assert "X70.0" in out.read_text()
    answer = json.loads(run("correct", files / "diameters.csv", files / "part.ngc", "--json"))
    assert np.abs(answer["remaining_um"]).max() < 4
    bad = run("correct", files / "diameters.csv", files / "part.ngc", "--rule", "x", code=2)
    assert "rule: got 'x'" in bad


def test_diagnose(files: Path) -> None:
    arguments = ("diagnose", files / "diameters.csv", files / "setup.toml")
    answer = json.loads(run(*arguments, "--json"))
    assert answer["verdict"] in ("explained", "ambiguous")
    named = {frozenset(s) for s in answer["alternatives"]}
    assert frozenset({"tool_heating"}) in named
    said = run(*arguments)
    assert ("To discriminate between them" in said) == (answer["verdict"] == "ambiguous")


def test_faults_are_told_with_file_and_place(files: Path) -> None:
    bad = files / "bad.ngc"
    readings = files / "diameters.csv"
    faults = {
        "G7 G18\nG0 X70 Z65\nG1 Z20\n": "line 3, column 4: a feed move but no feed",
        "G7 G95 F.1\nG0 X70 Z65\nG2 X80 Z60\n": "line 3, column 4: an arc without radius",
        "G7 G95 F.1\nG0 X70 Z65\nG1 Z2O\n": "line 3, column 6: O without a number",
        "G7 G95 F.1\nG0 X70 Z65\nG1 Z20 Q5\n": "line 3, column 8: Q5 has no meaning",
    }
    for text, said in faults.items():
        bad.write_text(text)
        for arguments in (("path", bad), ("correct", bad, readings)):
            assert f"{bad}: {said}" in run(*arguments, code=2)
    bad.write_bytes(b"G7\n\xff\n")
    assert f"{bad}: got byte 0xff at 3, expected UTF-8 text" in run("path", bad, code=2)
    answer = run(*PATH, files / "part.ngc", "--picture", files / "x.foo", code=2)
    assert "picture: got 'x.foo', expected a name that ends in one of" in answer
    assert "machine code" in run(*PATH, files / "part.ngc", "--machine-code", "45", code=2)


def test_diameters_for_errors_are_refused(files: Path) -> None:
    z = np.arange(60.0, 20.0, -1.0)
    Diameters(z_mm=z, error_um=70e3 + z).to_csv(files / "slip.csv")
    setup = files / "setup.toml"
    assert "error_um (line 2 of slip.csv)" in run("diagnose", files / "slip.csv", setup, code=2)
    assert "reading 0" in run("correct", files / "part.ngc", files / "slip.csv", code=2)


def test_the_samples_do_what_the_page_says(tmp_path: Path) -> None:
    """docs/how-to/turning.md; and they are what their maker makes."""
    make_turning(tmp_path)
    kept = {path.name: path for path in tmp_path.iterdir()}
    assert sorted(kept) == ["diameters.csv", "part.ngc", "passes.csv", "setup.toml"]
    for name, path in kept.items():
        assert sample_path(f"turning/{name}").read_text() == path.read_text()
    answer = json.loads(run("correct", kept["diameters.csv"], kept["part.ngc"], "--json"))
    assert len(answer["inserted"]) == 1
    answer = json.loads(run("diagnose", kept["passes.csv"], kept["setup.toml"], "--json"))
    assert {"bending", "tool_heating"} in [set(s) for s in answer["alternatives"]]


SHAPE = """# Fig. 9, z and radius
z_mm,x_mm,type,radius_mm
235,0,1,
235,10,1,
230,15,1,
190,15,1,
155,25,1,
155,30,1,
150,35,1,
125,35,3,5
125,20,2,
65,20,2,
65,35,3,5
35,35,1,
35,42,1,
0,42,1,
"""


def test_from_shape_to_finishing_program(tmp_path: Path) -> None:
    (tmp_path / "shape.csv").write_text(SHAPE)
    picture = tmp_path / "part.png"
    said = run(
        "finish", tmp_path / "shape.csv", "-o", tmp_path / "part.ngc", "--picture", picture,
        "--access-z-mm", 92.945, "--nose-mm", 0.8,
    )  # fmt: skip
    assert "stretches left out: 1" in said
    assert picture.stat().st_size > 8_000
    text = (tmp_path / "part.ngc").read_text()
    assert "G96 D3000" in text
    moves = follow(Program.parse(text, "linuxcnc-lathe"))
    cut = moves.end[moves.code > 0]
    for z, x in ((230, 15), (190, 15), (155, 30), (125, 30), (65, 20), (35, 42)):
        assert np.abs(cut[:, [2, 0]] - [z, x]).sum(axis=1).min() < 0.01 or z in (125, 65), (z, x)
    # Followed by the centre of the nose, a cylinder is larger by its radius on either side.
    made = run(
        "finish", tmp_path / "shape.csv", "--dialect", "paper-um", "--follows", "nose-centre",
        "--nose-mm", 0.8, "--no-face", "--access-z-mm", 92.945,
    )  # fmt: skip
    assert {"X 31600", "X 85600"} <= {" ".join(p) for p in _pairs(made)}


def _pairs(text: str) -> list[tuple[str, str]]:
    words = text.split()
    return list(pairwise(words))


def test_arcs_and_reliefs_of_a_shape(tmp_path: Path) -> None:
    shape = tmp_path / "shape.csv"
    shape.write_text(
        "z_mm,x_mm,type,radius_mm\n50,10,1,\n40,10,5,-8\n32,18,6,\n20,18,8,1\n0,18,,\n"
    )
    text = run("finish", shape)
    assert "G2" in text or "G3" in text
    for row, message in (
        ("a,1,1,", "line 2, column z_mm: got 'a', expected a number"),
        ("1,1,9,", "line 2, column type: got '9', expected 1 to 8"),
    ):
        shape.write_text(f"z_mm,x_mm,type,radius_mm\n{row}\n")
        assert message in run("finish", shape, code=2)
    shape.write_text("z,x\n1,2\n")
    assert "expected z_mm, x_mm, type, radius_mm" in run("finish", shape, code=2)

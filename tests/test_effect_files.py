"""A file of effects that lacks a line, or names what the data do not have, is refused there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import trunnion as tn
from test_cli import run
from trunnion.models.kinds import model_of

TOUCHES, SETUP = tn.sample_path("cross/touches.csv"), tn.sample_path("cross/setup.toml")
LINES = """[[effect]]
id = "rail_wave"
data = "Touches"
covariate = "X place"
shape = "polynomial"
number = 2.0
component = "X"
low = -51.0
high = 51.0
"""


def read_with(text: str, folder: Path) -> None:
    path = folder / "effects.toml"
    path.write_text(text, encoding="utf-8")
    model_of(tn.read(TOUCHES), tn.read_setup(SETUP), tn.read_effects(path))


@pytest.mark.parametrize("name", ["number", "low", "high"])
def test_a_deleted_line_of_the_formula_is_no_default(name: str, tmp_path: Path) -> None:
    """`low` was read as 0: another polynomial was fitted, and named."""
    left = "".join(f"{line}\n" for line in LINES.splitlines() if not line.startswith(name))
    with pytest.raises(tn.FileFormatError, match=rf"effects\.toml:1:1: .*{name}"):
        read_with(left, tmp_path)


def test_a_deleted_direction_is_refused(tmp_path: Path) -> None:
    """It was accepted, and the effect did nothing."""
    said = r"effects\.toml:1:1: .*got no component .*expected X, Y, Z"
    with pytest.raises(tn.FileFormatError, match=said):
        read_with(LINES.replace('component = "X"\n', ""), tmp_path)
    read_with(LINES.replace('component = "X"', 'component = ""'), tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('"X place"', '"xyz"'), r"4:13: .*covariate: got 'xyz', expected what these data have: A"),
        (('"X place"', '"X plac"'), "4:13: .*did you mean X place"),
        (('component = "X"', 'component = "Q"'), "7:13: .*component: got 'Q', expected X, Y, Z"),
        (('"rail_wave"', '"scale_x"'), "2:6: .*'scale_x', which the catalogue of these data has"),
        (("low", 'unit = "in"\nlow'), "8:8: .*unit: got 'in', expected 'mm'"),
    ],
)
def test_what_the_data_do_not_have_is_named_where_it_stands(
    change: tuple[str, str], said: str, tmp_path: Path
) -> None:
    with pytest.raises(tn.FileFormatError, match=rf"effects\.toml:{said}"):
        read_with(LINES.replace(*change), tmp_path)


def test_an_id_of_the_catalogue_is_refused_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "effects.toml"
    path.write_text(LINES.replace("rail_wave", "scale_x"), encoding="utf-8")
    said = run("diagnose", str(TOUCHES), str(SETUP), "--effects", str(path), code=2)
    assert said.startswith(f"error: {path}:2:6: effect 'scale_x': id: got 'scale_x'")


def test_what_is_written_states_its_formula_whole(tmp_path: Path) -> None:
    """Also where a number is the default: low = 0 of a travel that begins there."""
    effect = tn.FormulaEffect(
        "bend", "Positioning", covariate="position", shape="polynomial", number=2, high=500.0
    )
    for one in (effect, replace(effect, shape="jump", number=0.0)):
        path = tn.write_effects(tmp_path / "effects.toml", [one])
        assert tn.read_effects(path) == (one,)


def test_an_effect_of_other_data_and_a_deleted_line_are_said_so(tmp_path: Path) -> None:
    path = tmp_path / "e.toml"
    effect = tn.FormulaEffect("third", "Ballbar", covariate="angle in the XY plane", unit="deg",
                              component="", shape="harmonic", number=3)  # fmt: skip
    text = tn.write_effects(path, [effect]).read_text("utf-8")
    points = tn.read_points(tn.sample_path("plate/first.csv"))
    said = "data: got an effect of Ballbar for measured Points, expected measured Ballbar"
    with pytest.raises(tn.FileFormatError, match=said):
        tn.diagnose(points, effects=tn.read_effects(path))
    path.write_text(text.replace("number = 3\n", "").replace("number = 3.0\n", ""), "utf-8")
    with pytest.raises(tn.FileFormatError, match=r"got 0, .* \(was the line number deleted\?\)"):
        tn.read_effects(path)

"""Errors that are compensated in another unit than µm and arcsec are asked about."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion import controls
from trunnion.cli import app
from trunnion.compensation import compensation_forecast
from trunnion.machine.sizes import size_doubt

SETUP = tn.Setup(tn.Artefact("cross"))
UM = {"EX0C": 15.0, "EY0A": -10.0, "EZ0A": 22.0, "EA0A": 8.0, "EB0C": -4.0}


def in_mm(factor: float) -> dict[str, float]:
    return {k: v * factor if k[1] in "XYZ" else v for k, v in UM.items()}


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        (in_mm(1e-3), "EX0C = 0.015, EY0A = -0.01, EZ0A = 0.022: are these mm?"),
        ({"EX0C": 15.0, "EA0A": 8.0 / 3600}, "EA0A = 0.00222222: are these degrees or radians?"),
        (in_mm(1e3), "are these 1000 times too large"),
    ],
)
def test_another_unit_is_asked_about(errors: dict[str, float], said: str) -> None:
    assert said in compensation_forecast(SETUP, errors).summary()
    text = controls.iso_table(SETUP, errors, any_size=True).summary()
    assert said in text


def test_the_command_says_it(tmp_path: Path) -> None:
    file = tmp_path / "errors.json"
    file.write_text(json.dumps(in_mm(1e-3)))
    setup = tn.sample_path("cross/setup.toml")
    where = str(tmp_path / "out")
    said = CliRunner().invoke(app, ["compensate", str(file), str(setup), "-o", where])
    assert said.exit_code == 0
    assert "are these mm?" in " ".join(said.output.split())


def test_a_corrected_program_says_it() -> None:
    made = controls.correct_program(
        SETUP, in_mm(1e-3), "G21 G90 G94\nG0 X0 Y0 Z0 A0 C0\nG1 X10 F100\nM2\n"
    )
    assert "are these mm?" in made.summary()


def test_errors_of_machines_are_not_asked_about() -> None:
    """Sizes from tenths of a micrometre to 1 mm, and a good machine within its uncertainty."""
    rng = np.random.default_rng(4)
    for _ in range(300):
        size = 10.0 ** rng.uniform(0.0, 2.7)
        signs = rng.choice([-1.0, 1.0], size=len(UM))
        errors = dict(
            zip(UM, (size * signs * rng.uniform(0.2, 1.0, len(UM))).tolist(), strict=True)
        )
        assert size_doubt(errors, {}) == ""
    assert size_doubt({"EX0C": 0.05, "EA0A": 0.02}, {"EX0C": 0.04, "EA0A": 0.01}) == ""
    assert size_doubt(dict.fromkeys(UM, 0.0), {}) == ""
    assert size_doubt({"EX0C": 3e-12}, {}) == ""

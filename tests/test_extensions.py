"""What can be added from outside the package, each by the edits that CONTRIBUTING names.

The kind of data is a straightness measurement: deviations of a guide at positions along it.
"""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

import trunnion as tn
from model_contract import check_model
from trunnion.cli import app
from trunnion.diagnosis.effect import Effect, Parameter, linear, periodic
from trunnion.diagnosis.model import Model, Nuisance, Readings
from trunnion.diagnosis.own_effects import with_own
from trunnion.files.columns import Number, OptionalNumber
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table
from trunnion.models import kinds
from trunnion.models.kinds import Kind, add_kind, model_of
from trunnion.models.points import effects as point_effects
from trunnion.models.points.effects import LinearError
from trunnion.models.points.geometry import Places
from trunnion.setup.machines import descriptions, presets

Floats = NDArray[np.float64]


# --- a kind of data: its columns, its model, and one call


class Guide(Table):
    """Deviations of a guide from a straight line."""

    position_mm = Number("position along the guide")
    deviation_um = Number("deviation from a straight line")
    time_s = OptionalNumber("time of the reading")


def read_guide(path: str | PathLike[str]) -> Guide:
    """Read deviations of a guide."""
    return read_table(path, Guide)


class GuideModel(Model):
    """A straight line, and what makes a guide depart from it."""

    def __init__(self, data: Guide, effects: Sequence[Any] = ()) -> None:
        self.data = data
        self.readings = Readings(np.asarray(data.deviation_um), np.arange(len(data)))
        self.nuisance = (Nuisance("offset_um", "µm"), Nuisance("slope_um_m", "µm/m"))
        self.given = tuple(effects)
        self.effects = with_own(self._catalogue(), effects, data)

    def _catalogue(self) -> list[Effect]:
        x = np.asarray(self.data.position_mm)
        u = 2 * (x - x.min()) / np.ptp(x) - 1
        pitches = tuple(np.geomspace(20.0, 60.0, 30))
        return [
            linear("bow", ["a_um"], u * u, "bow of the guide"),
            periodic(
                "rail_pitch", Parameter("pitch_mm", grid=pitches), [(x, np.ones(len(x)))], "wave"
            ),
        ]

    def base(self, nuisance: Floats) -> Floats:
        return self.base_jacobian(nuisance) @ nuisance

    def base_jacobian(self, _: Floats) -> Floats:
        x = np.asarray(self.data.position_mm) * 1e-3
        return np.stack([np.ones_like(x), x], axis=1)

    def bind(self, data: Guide) -> Model:
        return GuideModel(data, self.given)


def build(data: Guide, _: Any = None, effects: Sequence[Any] = ()) -> GuideModel:
    """Build the model of a guide."""
    return GuideModel(data, effects)


def example() -> tuple[Guide, None]:
    """A guide with a bow of 8 µm."""
    x = np.linspace(0.0, 500.0, 51)
    noise = 0.3 * np.random.default_rng(5).standard_normal(len(x))
    bow = 8.0 * (x / 250.0 - 1) ** 2
    return Guide(position_mm=x, deviation_um=bow + noise, time_s=2.0 * np.arange(len(x))), None


@pytest.fixture
def guide_kind() -> Iterator[Kind]:
    before = list(kinds._KINDS)
    module = GuideModel.__module__
    kind = Kind(
        "guide",
        f"{module}:Guide",
        f"{module}:read_guide",
        f"{module}:build",
        ("position_mm", "deviation_um"),
        (f"{module}:example",),
    )
    add_kind(kind)
    yield kind
    kinds._KINDS[:] = before


def test_a_kind_of_data_of_ones_own_is_used_end_to_end(guide_kind: Kind, tmp_path: Path) -> None:
    data, _ = example()
    data.to_csv(tmp_path / "guide.csv")
    read = guide_kind.read(tmp_path / "guide.csv")
    d = tn.diagnose(read)
    assert [c.id for c in d.causes] == ["bow"]
    assert d.causes[0].parameters["a_um"] == pytest.approx(8.0, abs=4 * 0.3 / np.sqrt(5))
    assert "bow of the guide" in d.summary().lower()
    assert pickle.loads(pickle.dumps(d)) == d
    assert [e.id for e in tn.catalogue("guide")] == ["bow", "rail_pitch"]
    with pytest.raises(tn.InputError, match="guide"):
        add_kind(guide_kind)

    said = CliRunner().invoke(app, ["diagnose", str(tmp_path / "guide.csv"), "--json"])
    assert said.exit_code == 0, said.output
    assert json.loads(said.stdout)["verdict"] == "explained"


def test_a_kind_of_data_of_ones_own_keeps_the_contract(guide_kind: Kind) -> None:
    assert guide_kind.examples
    check_model(model_of(example()[0]))


# --- an effect on a kind that is there: one entry


def test_an_effect_is_one_entry(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def kinked(points: tn.Points, _: Places) -> Floats:
        out = np.zeros((len(points), points.dimension))
        out[:, 1] = np.maximum(points.nominal_mm[:, 0] - 120.0, 0.0) / 100.0
        return out.reshape(-1, 1)

    kink = LinearError("kink_x", ("k_um",), "kink in the guide of the X axis", kinked)
    known = point_effects.entries
    monkeypatch.setattr(point_effects, "entries", lambda dimension: [*known(dimension), kink])

    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 200, 15), np.linspace(0, 150, 8)))
    noise = 0.4 * np.random.default_rng(8).standard_normal((2, len(x)))
    made = tn.Points(
        nominal_x_mm=x,
        nominal_y_mm=y,
        x_mm=x + 1e-3 * noise[0],
        y_mm=y + 1e-3 * (noise[1] + 9.0 * np.maximum(x - 120.0, 0.0) / 100.0),
    )
    assert "kink_x" in [e.id for e in tn.catalogue(made)]
    made.to_csv(tmp_path / "plate.csv")
    d = tn.diagnose(tn.read_points(tmp_path / "plate.csv"))
    assert [c.id for c in d.causes] == ["kink_x"]
    cause = d.causes[0]
    assert cause.parameters["k_um"] == pytest.approx(9.0, abs=4 * cause.std_errors["k_um"])
    assert "kink in the guide of the X axis (kink_x)" in d.summary()


# --- an effect of one's own, without any edit


class Sun:
    """The machine bends while the sun shines on it: one half of the readings."""

    id = "sun"
    label = "sun on the column"
    parameters = ("b_um",)

    def change(self, data: Any, values: Mapping[str, float]) -> Floats:
        several = 2 if isinstance(data, tn.Points) else 1
        shines = np.arange(len(data)) >= len(data) // 2
        return np.repeat(values["b_um"] * shines, several)


def test_an_effect_of_ones_own_competes_with_the_catalogue() -> None:
    data = tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))
    sunny = data.with_columns(length_mm=data.length_mm + 1e-3 * Sun().change(data, {"b_um": 6.0}))
    d = tn.diagnose(sunny, effects=(Sun(),))
    assert "sun" in [c.id for c in d.causes]
    assert "sun on the column" in d.summary().lower()
    assert pickle.loads(pickle.dumps(d)) == d


# --- a machine: one entry of data in setup/machines.toml, or the same keys in a set-up


@pytest.mark.parametrize("preset", sorted(presets()))
def test_a_machine_is_its_entry_in_the_table_of_presets(preset: str, tmp_path: Path) -> None:
    """No other file names a preset: what follows works for every entry of the table."""
    setup = tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine(preset))
    (tmp_path / "setup.toml").write_text(setup.to_toml(), encoding="utf-8")
    setup = tn.read_setup(tmp_path / "setup.toml")
    plan = tn.plan(setup)
    errors = [name for name, unit in presets()[preset].core(100.0).location_errors][:1]
    data = tn.simulate(plan, setup, dict.fromkeys(errors, 12.0), noise_um=0.3, seed=4)
    data.to_csv(tmp_path / "touches.csv")
    fit = tn.identify(tn.read_touches(tmp_path / "touches.csv"), setup)
    assert pickle.loads(pickle.dumps(fit)) == fit
    assert set(errors) <= set(fit.errors)
    assert tn.catalogue(setup)


OWN_MACHINE = """
[machine]
chain = "[w C' Y' b X Z B (C) t]"
table_normal = [0, 0.2, 1]
[axes.B]
direction = [0, 1, 0.3]
point_mm = [12, 0, 150]
range_deg = [-95, 95]
[axes.C]
direction = [0.05, 0, 1]
sense = -1
[artefact]
kind = "cuboid"
length_mm = 80
width_mm = 60
height_mm = 40
[table]
radius_mm = 70
"""


def test_a_machine_of_ones_own_is_a_few_lines_of_a_set_up(tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(OWN_MACHINE, encoding="utf-8")
    setup = tn.read_setup(path)
    path.write_text(setup.to_toml(comments=True), encoding="utf-8")
    assert tn.read_setup(path) == setup
    pairs = [(t, c) for t in (-50, 40) for c in (20, 110, 200, 290)]
    plan = tn.plan(setup, b_deg=(60, -60), positions_deg=pairs, all_faces=True)
    errors = {"EA0B": 12.0, "EB0B": 8.0, "EC0B": -9.0, "EX0C": 15.0, "EA0C": 7.0}
    data = tn.simulate(plan, setup, errors, {"dx_um": 20.0}, noise_um=0.2, seed=4)
    fit = tn.identify(data, setup)
    for name, value in errors.items():
        if np.isfinite(fit.std_errors[name]):
            assert fit.errors[name] == pytest.approx(value, abs=4 * fit.std_errors[name])
    # A shift of the head is a shift of the table: the pair of X is not distinguished, and is named.
    assert {"EX0B", "EX0C"} <= {name for name, std in fit.std_errors.items() if np.isinf(std)}
    assert {"EA0B", "EB0B", "EC0B"} <= {k for k, std in fit.std_errors.items() if np.isfinite(std)}
    assert tn.diagnose(data, setup).verdict == "consistent"


def test_an_entry_of_the_data_file_has_the_same_keys() -> None:
    text = """
[mine]
meaning = "swivel head B behind a rotary table"
chain = "[w C' Y' b X Z B (C) t]"
table_normal = [0, 0.2, 1]
axes.B = { direction = [0, 1, 0.3], point_mm = [12, 0, 150] }
"""
    machine = descriptions(text)["mine"].core(150.0)
    assert (machine.letters, machine.sides) == ("BC", ["head", "table"])
    with pytest.raises(tn.InputError, match=r"axes\.direction: got"):
        descriptions(text.replace("[0, 1, 0.3]", "[0, 1]"))

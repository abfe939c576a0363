"""Effects of a user's own: where they act, and what is said where they cannot."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from lab_package import install
from trunnion.cli import app
from trunnion.machine.effects import Owner

CYCLE = tn.FormulaEffect(
    "cycle",
    "Touches",
    covariate="time",
    unit="s",
    component="Z",
    shape="wave",
    number=400.0,
    high=1000.0,
    owner=Owner.TIME,
)


class Sun:
    id = "sun"
    parameters = ("b_um",)

    def change(self, data: Any, values: Any) -> Any:
        return values["b_um"] * (np.arange(len(data)) >= 40) * data["dir_z"]


class Bad(Sun):
    id = "bad"

    def change(self, data: Any, values: Any) -> Any:  # noqa: ARG002
        raise ValueError("boom")


def measured(seed: int) -> tuple[tn.Touches, tn.Setup]:
    """Touches with a change of 4 µm in Z after forty of them."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    data = tn.simulate(tn.plan(setup), setup, noise_um=0.2, seed=seed)
    moved = 4e-3 * (np.arange(len(data)) >= 40)
    return data.with_columns(z_mm=data["z_mm"] + moved), setup


def run(tmp_path: Path, *effects: str) -> Any:
    data, setup = measured(3)
    data.to_csv(tmp_path / "t.csv")
    (tmp_path / "s.toml").write_text(setup.to_toml())
    given = [word for one in effects for word in ("--effects", one)]
    return CliRunner().invoke(
        app, ["diagnose", str(tmp_path / "t.csv"), str(tmp_path / "s.toml"), *given]
    )


def test_a_kind_of_data_that_there_is_not_is_refused_at_its_place(tmp_path: Path) -> None:
    path = tn.write_effects(tmp_path / "e.toml", [replace(CYCLE, data="Toches")])
    said = r"e\.toml:\d+:8: data: got 'Toches', expected one of Touches, .*did you mean Touches"
    with pytest.raises(tn.FileFormatError, match=said):
        tn.read_effects(path)
    with pytest.raises(tn.FileFormatError, match=said):
        tn.read_effects(path, measured(1)[0])


def test_a_file_without_an_effect_for_the_data_says_so(tmp_path: Path) -> None:
    path = tn.write_effects(tmp_path / "e.toml", [replace(CYCLE, data="Points")])
    done = run(tmp_path, str(path))
    assert done.exit_code == 0, done.output
    text = " ".join(done.output.split())
    assert "e.toml has no effect on Touches (cycle is for Points): none of it was looked" in text


def test_a_unit_that_the_quantity_does_not_have_is_refused() -> None:
    data, setup = measured(2)
    with pytest.raises(tn.InputError, match="'cycle': unit: got 'min', expected 's', the unit of"):
        tn.diagnose(data, setup, effects=[replace(CYCLE, unit="min")])
    order = replace(CYCLE, covariate="order of measurement", unit="mm")
    with pytest.raises(tn.InputError, match="unit: got 'mm', expected none of order of"):
        tn.diagnose(data, setup, effects=[order])


@pytest.mark.parametrize("name", ["EX0C", "EAOA", "EXX", "dx_um", "rc_arcsec"])
def test_the_name_of_an_error_is_none_of_an_effect(name: str) -> None:
    data, setup = measured(2)
    sun = Sun()
    sun.id = name
    said = f"id: got '{name}', the name of an error or of a placement, expected one of its own"
    with pytest.raises(tn.InputError, match=said):
        tn.diagnose(data, setup, effects=[sun])
    with pytest.raises(tn.InputError, match=said):
        replace(CYCLE, id=name)


def test_it_acts_in_those_of_several_measurements_that_it_is_for() -> None:
    data, setup = measured(4)
    circle = tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))
    sun = Sun()
    sun.data = "Touches"  # type: ignore[attr-defined]
    d = tn.diagnose([data, circle], setup, effects=[sun, CYCLE])
    (cause,) = [c for c in d.causes if c.id == "sun"]
    assert abs(cause.parameters["b_um"] - 4.0) < 4 * cause.std_errors["b_um"] < 1.0
    with pytest.raises(tn.InputError, match="'cycle': got Touches, Ballbar, expected Points"):
        tn.diagnose([data, circle], setup, effects=[replace(CYCLE, data="Points")])


def test_an_effect_that_raises_is_named_with_its_place() -> None:
    data, setup = measured(5)
    said = rf"effect 'bad': change of .*Bad raised ValueError: boom, .*{Path(__file__).name}:\d+"
    with pytest.raises(tn.InputError, match=said):
        tn.diagnose(data, setup, effects=[Bad()])
    with pytest.raises(tn.InputError, match=said):
        tn.identify(data, setup, effects=[Bad()])
    given: Any = Sun
    for use in (tn.diagnose, tn.identify):
        with pytest.raises(
            tn.InputError, match=r"got the class .*Sun, expected an object.*Sun\(\)"
        ):
            use(data, setup, effects=[given])


def test_what_a_package_brings_may_be_bad_a_class_or_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    names = ("bad", "class", "empty", "many")
    code = (
        "import numpy as np\n"
        "class Sun:\n"
        "    id, parameters, label = 'sun', ('b_um',), 'sun on the column'\n"
        "    def change(self, data, values):\n"
        "        return values['b_um'] * (np.arange(len(data)) >= 40) * data['dir_z']\n"
        "class Bad(Sun):\n"
        "    def change(self, data, values):\n"
        "        raise ValueError('boom')\n"
        "BAD, CLASS, EMPTY, MANY = Bad(), Sun, [], [Sun]\n"
    )
    install(site, "our_lab_17", {name: name.upper() for name in names}, code)
    monkeypatch.syspath_prepend(str(site))
    bad, made, empty, many = (run(tmp_path, name) for name in names)
    assert bad.exit_code == many.exit_code == 2
    assert re.search(r"our_lab_17\.Bad raised ValueError: boom, .*our_lab_17\.py:8", bad.stderr)
    assert "got the class our_lab_17.Sun, expected an object of it: Sun()" in many.stderr
    assert made.exit_code == 0
    assert "sun on the column (sun)" in made.output
    assert "empty has no effect on Touches (it has none at all)" in " ".join(empty.output.split())
    sys.modules.pop("our_lab_17", None)


def test_structure_of_several_measurements_is_drafted_for_the_kind_that_has_it() -> None:
    """It then is one effect of the machine in all measurements of this kind."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    plan = tn.plan(setup, c_deg=(0, 60, 120, 180, 240, 300), both_senses=True)
    quiet, *plain = (tn.simulate(plan, setup, noise_um=0.3, seed=seed) for seed in (6, 7, 8))
    wave = 3e-3 * np.cos(2 * np.pi * np.round(2 * plan["y_mm"]) / 2 / 47.0 + 1.0)
    first, other = (one.with_columns(x_mm=one["x_mm"] + wave) for one in plain)
    d = tn.diagnose([quiet, first], setup)
    assert d.structure is not None
    draft = d.draft_effect("rail")
    assert (draft.data, draft.covariate) == ("Touches", "Y place")
    assert "rail" in tn.diagnose([first, other], setup, effects=[draft]).named


@pytest.mark.parametrize("phase", [0.5, 2.0])
def test_structure_that_is_nearly_an_error_of_the_machine_is_fitted(phase: float) -> None:
    """Touches along X at few places of Y: a wave of 20 mm there is nearly an offset of them.

    It is in the model, the error as uncertain as that makes it, and no cause stands in its place.
    """
    setup = tn.Setup(tn.Artefact("cross"))
    plan = tn.plan(
        setup, feeds_mm_min=(300, 600), both_senses=True, c_deg=(0, 45, 90, 135, 180, 225, 270, 315)
    )
    data = tn.simulate(plan, setup, {"EX0C": 10.0}, noise_um=0.3, seed=12)
    wave = 3e-3 * np.cos(2 * np.pi * np.round(2 * plan["y_mm"]) / 2 / 20.0 + phase)
    d = tn.diagnose(data.with_columns(x_mm=data["x_mm"] + wave), setup)
    assert d.verdict == "unexplained"
    assert d.structure is not None
    assert not d.named
    assert d.gain.heldout_rms_after_um < 0.35
    assert abs(d.errors_after["EX0C"] - 10.0) < 2 * d.errors_std["EX0C"]
    assert 0.5 < d.errors_std["EX0C"] < 3.5  # as large as the wave; identify alone would say 0.04
    assert "rail" in tn.diagnose(d.data, setup, effects=[d.draft_effect("rail")]).named


def test_why_structure_is_stated_only_is_said() -> None:
    """Few touches, one after the other: a bump in time is not predicted by those before and after.

    Those of an angle are left out together, and the others say little of what was in between.
    """
    setup = tn.Setup(tn.Artefact("cross"))
    plan = tn.plan(setup)
    data = tn.simulate(plan, setup, {"EX0C": 10.0}, noise_um=0.3, seed=12)
    share = np.arange(len(plan)) / len(plan)
    bump = 5e-3 * np.exp(-(((share - 0.4) / 0.1) ** 2))
    d = tn.diagnose(data.with_columns(z_mm=data["z_mm"] + bump), setup)
    assert d.verdict == "unexplained"
    assert d.structure is None
    (note,) = [n for n in d.notes if "not in the extended model" in n]
    assert "with it readings are predicted worse from the others" in note
    with pytest.raises(tn.InputError, match="readings are predicted worse from the others"):
        d.draft_effect()

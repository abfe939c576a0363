"""Unexplained structure is a part of the model, and an effect that can be named and shared."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from lab_package import install
from power.random_cases import draw
from power.study import ground
from promise import kept, needed_runs
from trunnion.cli import app
from trunnion.diagnosis.formula import SHAPES, SMOOTH
from trunnion.machine.effects import Owner
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

FOUND = 0.95
NOISE_UM = 0.3
PERIOD_MM = 47.0


def with_wave(seed: int, size_um: float = 3.0) -> tuple[tn.Touches, tn.Setup, dict[str, float]]:
    """Touches of the independent generator, X moved by a wave along Y, and the hidden errors."""
    made, twin, _, read = ground("rich")
    rng = np.random.default_rng(seed)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
    m = measure(made, twin, truth, noise_um=NOISE_UM, tick_um=0.1, seed=seed)
    data = tn.Touches(m.columns)
    y = np.round(2 * data.position_mm[:, 1]) / 2
    moved = size_um * np.cos(2 * np.pi * y / PERIOD_MM + rng.uniform(0, 6.28))
    changed = {"x_mm": data.position_mm[:, 0] + 1e-3 * moved}
    return data.with_columns(**changed), read, dict(truth.errors)


@cache
def first() -> tn.Diagnosis:
    data, setup, _ = with_wave(1)
    return tn.diagnose(data, setup)


def test_structure_is_a_part_of_the_extended_model() -> None:
    d = first()
    assert d.verdict == "unexplained"
    assert d.structure is not None
    assert "period" in str(d.unexplained)
    name = d.structure.effect.id
    assert d.structure.parameters["period_mm"] == pytest.approx(PERIOD_MM, rel=0.02)
    assert all(0 < s < 0.5 for s in d.structure.std_errors.values())
    assert d.gain.rms_after_um == pytest.approx(NOISE_UM, rel=0.15)
    assert d.gain.heldout_rms_after_um < 0.4 * d.gain.heldout_rms_before_um
    assert d.contributions[0].id == name
    assert isinstance(d.model, tn.Estimate)
    assert {f"{name}.a_um", f"{name}.b_um"} <= set(d.model.values)
    assert f"{name}.period_mm" in d.model.std_errors
    assert not d.causes  # nobody has named it
    again = tn.Diagnosis.from_json(d.to_json())
    assert again == d
    assert again.model == d.model
    assert d.score(with_wave(1)[0]).rms_after_um == pytest.approx(d.gain.rms_after_um, rel=0.05)


def test_an_id_of_the_catalogue_is_refused_where_it_is_given() -> None:
    d = first()
    with pytest.raises(tn.InputError, match=r"'drift_x', which the catalogue .*has too"):
        d.draft_effect("drift_x")
    assert d.draft_effect("rail_wave").id == "rail_wave"
    two = tn.diagnose([with_wave(1)[0], with_wave(2)[0]], with_wave(1)[1])
    assert two.structure is not None
    with pytest.raises(tn.InputError, match=r"'drift_x', which the catalogue .*has too"):
        two.draft_effect("drift_x")


def test_the_model_predicts_with_it() -> None:
    data, setup, _ = with_wave(1)
    d = first()
    assert tn.identify(data, setup, effects=d.model).rms_um == pytest.approx(
        d.gain.rms_after_um, rel=0.02
    )
    simulated = tn.simulate(data, setup, d.model)
    off = (simulated.position_mm - data.position_mm) * data.direction
    assert np.std(np.sum(off, axis=1)) < 1.3e-3 * NOISE_UM


def test_location_errors_are_free_of_it_and_their_uncertainty_says_so() -> None:
    inside, runs = 0, needed_runs(FOUND)
    for seed in range(runs):
        data, setup, hidden = with_wave(100 + seed)
        d = tn.diagnose(data, setup)
        name = max(hidden, key=lambda k: abs(d.errors_before[k] - d.errors_after[k]))
        inside += abs(d.errors_after[name] - hidden[name]) < 2 * d.errors_std[name]
    assert kept(inside, runs, FOUND)


def test_no_cause_is_named_for_what_a_coarse_period_leaves() -> None:
    """A squareness of 0.1 ± 0.5 arcsec was named at 95 % beside a wave of 5 µm, in 4 of 16 runs."""
    named = []
    for seed in range(40, 56):
        data, setup, _ = with_wave(seed, 5.0)
        d = tn.diagnose(data, setup)
        assert d.structure is not None
        named += [
            max(abs(v) / c.std_errors[k] for k, v in c.parameters.items() if c.std_errors[k] > 0)
            for c in d.causes
        ]
    assert all(size > 2.0 for size in named)
    assert len(named) <= 2


def test_a_named_effect_is_found_on_the_next_machine(tmp_path: Path) -> None:
    named = first().draft_effect("rail_wave", "wave of the Y rail")
    path = tn.write_effects(tmp_path / "effects.toml", [named])
    read = tn.read_effects(path, with_wave(1)[0])
    assert read == (named,)
    found, runs = 0, needed_runs(FOUND)
    for seed in range(runs):
        data, setup, _ = with_wave(300 + seed, 0.6)
        d = tn.diagnose(data, setup, effects=read)
        found += d.verdict != "unexplained" and "rail_wave" in d.named
    assert kept(found, runs, FOUND)
    without, setup, _ = with_wave(5, 0.0)
    assert "rail_wave" not in tn.diagnose(without, setup, effects=read).named


def with_curve(seed: int, size_um: float) -> tuple[tn.Touches, tn.Setup, float]:
    """Touches of the independent generator, Z moving as the cube of time from 0; hidden EZ0A."""
    made, twin, _, read = ground("rich")
    rng = np.random.default_rng(seed)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
    m = measure(made, twin, truth, noise_um=NOISE_UM, tick_um=0.1, seed=seed)
    data = tn.Touches(m.columns)
    moved = size_um * (data["time_s"] / data["time_s"].max()) ** 3
    along = -1e-3 * moved * data["dir_z"]  # what of it a touch reads
    changed = {f"{x}_mm": data[f"{x}_mm"] + along * data[f"dir_{x}"] for x in "xyz"}
    return data.with_columns(**changed), read, truth.errors["EZ0A"]


def test_a_named_curve_of_time_leaves_the_errors_at_its_start() -> None:
    """It was 0 at its mean: EZ0A of the next machine was 2 µm off at 0.07 µm."""
    data, setup, _ = with_curve(7, 12.0)
    named = tn.diagnose(data, setup).draft_effect("warm_column")
    assert named.from_start
    inside, runs = 0, needed_runs(FOUND)
    for seed in range(runs):
        data, setup, hidden = with_curve(600 + seed, -8.0)
        d = tn.diagnose(data, setup, effects=[named])
        assert "warm_column" in d.named
        assert d.errors_std["EZ0A"] < 1.0
        inside += abs(d.errors_after["EZ0A"] - hidden) < 2 * d.errors_std["EZ0A"]
    assert kept(inside, runs, FOUND)


def example(shape: str) -> tn.FormulaEffect:
    every: dict[str, dict[str, Any]] = {
        "harmonic": {"shape": "harmonic", "covariate": "C position", "unit": "deg", "number": 2.0},
        "wave": {
            "shape": "wave",
            "covariate": "Y place",
            "unit": "mm",
            "number": 31.0,
            "low": -50.0,
            "high": 50.0,
            "shortest": 20.0,
        },
        "alternating": {
            "shape": "alternating",
            "covariate": "Y place",
            "unit": "mm",
            "number": 31.0,
            "low": -50.0,
            "high": 50.0,
        },
        "polynomial": {
            "shape": "polynomial",
            "covariate": "time",
            "unit": "s",
            "number": 3.0,
            "high": 900.0,
        },
        "jump": {
            "shape": "jump",
            "covariate": "order of measurement",
            "number": 40.0,
            "owner": Owner.TIME,
        },
        "local": {
            "shape": "local",
            "covariate": "C position",
            "unit": "deg",
            "number": 355.0,
            "width": 50.0,
        },
        "class": {"shape": "class", "covariate": "point", "at": "7"},
    }
    return tn.FormulaEffect(f"my_{shape}", "Touches", component="X", **every[shape])


@pytest.mark.parametrize("from_start", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_code_does_what_the_effect_does(shape: str, from_start: bool, tmp_path: Path) -> None:
    effect = example(shape)
    if from_start and shape not in SMOOTH:
        with pytest.raises(tn.InputError, match="expected a start for polynomial and wave only"):
            replace(effect, from_start=True)
        return
    effect, data = (
        replace(effect, from_start=from_start),
        tn.read_touches(tn.sample_path("cross/touches.csv")),
    )
    values = {p if isinstance(p, str) else p.name: 0.7 + k for k, p in enumerate(effect.parameters)}
    if "period_mm" in values:
        values["period_mm"] = 31.5
    if "place_deg" in values:
        values |= {"place_deg": 357.0, "width_deg": 48.0}
    space: dict[str, Any] = {}
    exec(effect.code(), space)
    places = {
        "C position": data.c_deg,
        "Y place": np.round(2 * data.position_mm[:, 1]) / 2,
        "time": data.time_s,
        "order of measurement": np.arange(len(data)),
        "point": data.point,
    }
    expected = space["change"](places[effect.covariate], data.direction[:, 0], values)
    np.testing.assert_allclose(effect.change(data, values), expected, atol=1e-12)
    assert np.abs(expected).max() > 0.1
    # Its derivative by differences.
    steps = []
    for name in values:
        ends = [effect.change(data, {**values, name: values[name] + h}) for h in (1e-5, -1e-5)]
        steps.append((ends[0] - ends[1]) / 2e-5)
    np.testing.assert_allclose(effect.jacobian(data, values), np.stack(steps, 1), atol=1e-6)
    assert effect.covariate in effect.formula()
    assert tn.read_effects(tn.write_effects(tmp_path / "e.toml", [effect])) == (effect,)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('shape = "spiral"', "7:9: shape: got 'spiral', expected one of harmonic,"),
        ("number = -3.0", "7:10: number: got -3, expected the period, a finite number above 0"),
        ("number = inf", "7:10: number: got inf, expected the period, a finite number above 0"),
        ('number = "long"', "7:10: got 'long', expected a number"),
        ("low = 2", "8:7: low, high: got 2, 1, expected low below high"),
        ("high = -2", "8:8: low, high: got 0, -2, expected low below high"),
        ("width = 0", "8:9: width: got 0, expected a width above 0"),
        ('id = "my wave"', "7:6: id: got 'my wave', expected letters, digits and underscores"),
        ('id = "EX0C"', "7:6: id: got 'EX0C', the name of an error or of a placement, expected"),
        ("colour = 1", "8:1: got key 'colour', expected one of id,"),
        ('owner = "nobody"', "8:9: got 'nobody', expected one of machine,"),
    ],
)
def test_a_wrong_file_is_refused_at_its_place(line: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "effects.toml"
    base = {"id": '"w"', "data": '"Touches"', "covariate": '"Y place"', "shape": '"wave"'}
    rows = [f"{k} = {v}" for k, v in base.items() if not line.startswith(f"{k} =")]
    numbered = [] if line.startswith("number") else ["number = 30.0"]
    path.write_text("\n".join(["# mine", "[[effect]]", *rows, *numbered, line]), encoding="utf-8")
    with pytest.raises(tn.FileFormatError, match=r"effects\.toml") as error:
        tn.read_effects(path)
    assert f"effects.toml:{said}" in str(error.value)


@pytest.mark.parametrize("unit", ["mm", "arcsec", ""])
def test_a_change_in_another_unit_than_the_readings_is_refused(unit: str) -> None:
    """It was a number in µm that was called otherwise."""
    effect, (data, setup) = replace(example("wave"), reading_unit=unit), cross_of(5)
    said = f"'my_wave': reading_unit: got '{unit}', expected 'µm', the unit of the readings"
    with pytest.raises(tn.InputError, match=said):
        tn.diagnose(data, setup, effects=[effect])
    with pytest.raises(tn.InputError, match=said):
        effect.change(data, {"a_mm": 1.0, "b_mm": 0.0, "period_mm": 31.0})


@pytest.mark.parametrize("period", [0.06, 0.7])
def test_a_period_that_the_places_do_not_show_is_refused(period: float) -> None:
    """Places are rounded to 0.5 mm: any wave below 1 mm looks like a longer one."""
    effect, (data, setup) = replace(example("wave"), number=period, shortest=0.0), cross_of(5)
    said = f"'my_wave': number: got a period sought up to {1.25 * period:.4g} mm along Y place, exp"
    with pytest.raises(tn.InputError, match=said + "ected 1 mm at least: its values are 0.5 mm"):
        tn.diagnose(data, setup, effects=[effect])
    effect.at_values({"period_mm": period})[0].change(data, {"a_um": 1.0, "b_um": 0.0})


@pytest.mark.parametrize("period", [1e-9, 0.01])
def test_a_period_is_sought_of_so_many_waves_at_most(period: float) -> None:
    """Each is tried: time grows as 1/period."""
    effect = example("wave")
    said = f"number: got {period:g}, expected a period of at least 0.05: 2000 waves from low to"
    with pytest.raises(tn.InputError, match=said):
        replace(effect, low=-50.0, high=50.0, number=period)


@pytest.mark.parametrize(
    "kind", ["touches", "points", "diameters", "ballbar", "positioning", "levels", "rotarytest"]
)
def test_what_is_drafted_explains_the_data_it_is_of(kind: str) -> None:
    """A kind that takes a set-up refused its own draft: "setup: missing"."""
    drafted = 0
    for number in range(80):
        case = draw(kind, number, seed=77)
        d = tn.diagnose(case.data, case.setup) if case.unknown else None
        if d is None or d.structure is None:
            continue
        draft = d.draft_effect("my_own_shape")
        again = tn.diagnose(case.data, case.setup, effects=[draft])
        assert "my_own_shape" in again.named
        assert again.gain.rms_after_um < 1.05 * d.gain.rms_after_um
        drafted += 1
        if drafted == 3:
            return
    pytest.fail(f"structure in {drafted} cases, expected 3")


def test_an_effect_of_other_data_is_refused_or_left_out(tmp_path: Path) -> None:
    effect, points = example("wave"), tn.read_points(tn.sample_path("plate/first.csv"))
    with pytest.raises(tn.InputError, match="got an effect of Touches for measured Points"):
        tn.diagnose(points, effects=[effect])
    path = tn.write_effects(tmp_path / "effects.toml", [effect])
    assert tn.read_effects(path, points) == ()
    with pytest.raises(tn.InputError, match="draft_effect: got nothing is unexplained"):
        tn.diagnose(*cross_of(5)).draft_effect()


def cross_of(seed: int) -> tuple[tn.Touches, tn.Setup]:
    data, setup, _ = with_wave(seed, 0.0)
    return data, setup


def test_a_package_brings_its_own_catalogue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    install(
        site,
        "our_lab",
        {"our_lab": "CATALOGUE", "broken": "MISSING"},
        "from pathlib import Path\nCATALOGUE = Path(__file__).with_name('lab.toml')\n",
    )
    tn.write_effects(site / "lab.toml", [first().draft_effect("rail_wave")])
    monkeypatch.syspath_prepend(str(site))
    brought = tn.installed_effects("our_lab")
    assert [e.id for e in brought] == ["rail_wave"]
    data, setup, _ = with_wave(7)
    assert "rail_wave" in tn.diagnose(data, setup, effects=brought).named
    with pytest.raises(tn.InputError, match=r"entry point 'broken' of trunnion\.effects"):
        tn.installed_effects()
    with pytest.raises(tn.UnknownNameError, match="catalogue of effects"):
        tn.installed_effects("their_lab")
    data.to_csv(tmp_path / "touches.csv")
    (tmp_path / "setup.toml").write_text(setup.to_toml())
    files = [str(tmp_path / name) for name in ("touches.csv", "setup.toml")]
    for given in ("our_lab", str(site / "lab.toml")):
        run = CliRunner().invoke(app, ["diagnose", *files, "--effects", given])
        assert run.exit_code == 0, run.output
        assert "rail wave (rail_wave)" in run.output
    sys.modules.pop("our_lab", None)

"""Several measurements of one machine, diagnosed together: blind pairs, shares, dates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.core import TyperGroup, TyperOption
from typer.main import get_command
from typer.testing import CliRunner

import model_contract as contract
import trunnion as tn
from ballbar_study import cartesian_cases
from positioning_twin import axis
from power import pairs
from power.pairs import Causes, hidden_cause, settled, stops, touches
from power.study import ground
from promise import kept, needed_runs
from trunnion.cli import app
from trunnion.diagnosis.engine import diagnose as diagnose_model
from trunnion.diagnosis.fit import grid_values
from trunnion.diagnosis.plain import case_of
from trunnion.models.joint import JointModel
from trunnion.models.kinds import model_of
from trunnion.models.parts import Acts

FEWER = 40  # runs of what is only compared


def test_what_touches_alone_leave_open_is_settled_by_positioning() -> None:
    """A cause of the machine is named as such, one of probe or artefact never given to it."""
    setup = ground("paper")[3]
    runs = needed_runs(0.95)
    right = alone = blamed = 0
    for k in range(runs):
        rng = np.random.default_rng([31, k])
        data, hidden = pairs.scaled_or_slack(rng)
        right += settled(tn.diagnose(data, setup), hidden)
        if k >= FEWER:
            continue
        alone += settled(tn.diagnose(data[0], setup), hidden)
        other = tn.diagnose(pairs.of_probe_or_artefact(rng)[0], setup)
        blamed += any(":" not in cause for cause in other.named)
    assert kept(right, runs, 0.95)
    assert alone < 0.6 * FEWER
    assert blamed <= 2


def test_a_long_bar_and_a_long_machine_look_alike_until_the_axes_are_measured() -> None:
    runs, right = needed_runs(0.95), 0
    for k in range(runs):
        of_machine = bool(k % 2)
        data, hidden = pairs.long_bar_or_machine(
            np.random.default_rng([32, k]), of_machine=of_machine
        )
        right += settled(tn.diagnose(data), hidden)
        if k < 6 and of_machine:
            assert tn.diagnose(data[0]).named == {"ballbar_length"}
    assert kept(right, runs, 0.95)


def test_one_value_for_all_measurements_with_its_sign() -> None:
    rng = np.random.default_rng(33)
    effects: Causes = {"scale_x": {"ppm": 20.0}, "backlash_y": {"b_um": 3.0}}
    data = [touches(rng, effects, "rich"), *(stops(rng, a, effects) for a in "xy")]
    d = tn.diagnose(data, ground("rich")[3])
    assert d.named == set(effects)
    for cause in d.causes:
        for name, value in effects[cause.id].items():
            assert abs(cause[name] - value) < 4 * cause.std_errors[name]
    single = tn.diagnose(data[0], ground("rich")[3])
    for cause in single.causes:
        together = next(c for c in d.causes if c.id == cause.id)
        for name, std in cause.std_errors.items():
            assert together.std_errors[name] < std
    assert d.model["scale_x.ppm"] == d.effects["scale_x"]["ppm"]
    again = tn.Diagnosis.from_json(d.to_json())
    assert again.to_dict() == d.to_dict()


def test_what_changed_between_two_dates_is_named() -> None:
    setup = ground("rich")[3]
    rng = np.random.default_rng(34)
    first = touches(rng, {}, "rich", EX0C=10.0)
    errors = tn.identify(first, setup).errors
    second = touches(rng, {}, "rich", **{**errors, "EX0C": errors["EX0C"] + 4.0})
    d = tn.diagnose([first, second], setup)
    (cause,) = d.causes
    assert cause.id == "touches 2:change_EX0C"
    assert cause["change_um"] == pytest.approx(4.0, abs=0.3)
    assert "change of EX0C before touches 2" in d.summary()
    same = tn.diagnose([first, touches(rng, {}, "rich", **errors)], setup)
    assert same.verdict == "consistent"
    assert same.errors_after["EX0C"] == pytest.approx(errors["EX0C"], abs=0.1)


def test_outliers_are_counted_through_all_measurements() -> None:
    rng = np.random.default_rng(35)
    x, y = (stops(rng, a, {}) for a in "xy")
    bad = np.array(y.measured)
    bad[[7, 30]] += 0.05
    d = tn.diagnose([x, y.with_columns(measured_mm=bad)])
    assert d.outliers == (len(x) + 7, len(x) + 30)


def test_the_joint_model_is_a_model() -> None:
    rng = np.random.default_rng(36)
    bars, _ = cartesian_cases(["squareness"], 36)
    data = [touches(rng, {}), stops(rng, "x", {}), stops(rng, "x", {}), bars[::3]]
    model = model_of(data, ground("paper")[3])
    for check in (
        contract.check_shapes,
        contract.check_nuisance_derivative,
        contract.check_effect_derivatives,
        contract.check_zero_at_zero,
        contract.check_bound_to_its_own_data,
        contract.check_pickle,
    ):
        check(model, None)
    ids = {effect.id for effect in model.effects}
    assert {"scale_x", "backlash_x", "positioning 2:change_scale_x"} <= ids
    assert {"touches:probe_radius", "ballbar:ballbar_length", "positioning:drift"} <= ids
    assert sum(x.name == "EX0C" for x in model.nuisance) == 1


def test_a_list_of_one_is_refused() -> None:
    with pytest.raises(tn.InputError, match="at least two"):
        tn.diagnose([axis(np.random.default_rng(1))])


@pytest.mark.parametrize("of", [list, tuple])
def test_a_list_within_the_list_is_refused_by_its_place(of: type) -> None:
    stop = axis(np.random.default_rng(1))
    for data, place in (([of([stop, stop]), stop], 0), ([stop, of([stop])], 1)):
        said = rf"data\[{place}\]: got a {of.__name__} of \d, expected a measurement or a "
        for function in (tn.diagnose, tn.catalogue):
            with pytest.raises(tn.InputError, match=said):
                function(data)


@pytest.mark.parametrize(
    ("option", "given", "expected"),
    [
        ("--probe-log", "probed.log", "trunnion touches plan.csv probed.log setup.toml -o"),
        ("--out", "pages", "expected --html for the report or --output for the result"),
    ],
)
def test_an_option_that_is_none_of_a_joint_diagnosis_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str, given: str, expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("probed.log").touch()
    for letter in "xy":
        stops(np.random.default_rng(1), letter, {}).to_csv(f"{letter}.csv")
    said = CliRunner().invoke(app, ["diagnose", "--joint", "x.csv", "y.csv", option, given])
    assert said.exit_code == 2, said.output
    words = " ".join(said.output.split())
    assert f"{option}: got it with --joint, " in words
    assert expected in words
    assert not Path("pages").exists()


def test_the_help_says_how_many_touches_are_planned_together() -> None:
    every = get_command(app)
    assert isinstance(every, TyperGroup)
    command = every.commands["diagnose"]
    assert "with --joint touches that are chosen for it are always eight" in " ".join(
        str(command.help).split()
    )
    options = (one for one in command.params if isinstance(one, TyperOption))
    option = next(one for one in options if "--next" in one.opts)
    assert "with --joint always eight" in str(option.help)


def test_the_command_diagnoses_together(tmp_path: Path) -> None:
    rng = np.random.default_rng(37)
    effects: Causes = {"backlash_x": {"b_um": 3.0}}
    stops(rng, "x", effects).to_csv(tmp_path / "x.csv")
    stops(rng, "y", effects).to_csv(tmp_path / "y.csv")
    files = [str(tmp_path / "x.csv"), str(tmp_path / "y.csv")]
    said = CliRunner().invoke(app, ["diagnose", "--joint", *files])
    assert said.exit_code == 0, said.output
    assert "backlash_x" in said.output


def test_columns_taken_over_from_the_parts_are_those_made_anew() -> None:
    """Equal at the plain fit of the part; elsewhere they differ in proportion to how far it is."""
    rng = np.random.default_rng([37, 1])
    effects = hidden_cause(rng, "scale_x")
    setup = ground("paper")[3]
    model = model_of([touches(rng, effects), *(stops(rng, a, effects) for a in "xy")], setup)
    assert isinstance(model, JointModel)
    for part in model.parts:
        plain = case_of(part.model).plain.nuisance
        step = part.model.start - plain
        anew = replace(part, linearised=None)
        off = np.zeros(3)
        for effect in part.model.effects:
            values = grid_values(effect)[:2]
            acts = Acts(0, effect, 1.0)
            known = part.white_columns(part.model.start, acts, values)
            for i, share in enumerate((0.0, 0.5, 1.0)):
                made = anew.white_columns(plain + share * step, acts, values)
                off[i] += np.sum((made - known) ** 2) / np.sum(known**2)
        assert off[0] < 1e-20
        assert np.sqrt(off[2]) == pytest.approx(2 * np.sqrt(off[1]), rel=0.1, abs=1e-9)
    assert any(part.linearised for part in model.parts)
    found = diagnose_model(model)
    again = diagnose_model(JointModel([replace(part, linearised=None) for part in model.parts]))
    assert found.alternatives == again.alternatives
    assert found.named == again.named >= {"scale_x"}
    assert found.none_probability == pytest.approx(again.none_probability, abs=0.002)


@pytest.mark.parametrize("given", ["touches.csv", Path("touches.csv"), None, 3.0])
def test_what_is_no_data_is_refused_by_its_place_in_the_list(given: object) -> None:
    table = tn.read(tn.sample_path("plate/first.csv"))
    with pytest.raises(tn.InputError, match=r"^data\[1\]: got ") as caught:
        tn.diagnose([table, given])
    a_file = f"trunnion.read({str(given)!r}) reads the file" in str(caught.value)
    assert a_file == (not isinstance(given, float) and given is not None)

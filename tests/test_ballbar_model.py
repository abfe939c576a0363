"""The ball-bar model that the diagnosis engine asks: derivatives, signs, settings, bad input."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app
from trunnion.hybrid import Mechanism, ballbar_plan

HOME = np.array([0.0, -350.0, -1400.0])


def given(column: np.ndarray | None) -> np.ndarray:
    assert column is not None
    return column


def circle(step: float = 2.0, radius: float = 100.0) -> tn.Ballbar:
    """One counter-clockwise and one clockwise XY circle, exact."""
    angle = np.radians(np.arange(0, 360 + step / 2, step))
    angle = np.concatenate([angle, angle[::-1]])
    half = len(angle) // 2
    return tn.Ballbar(
        setup=np.zeros(len(angle), int),
        x_mm=50 + radius * np.cos(angle),
        y_mm=-20 + radius * np.sin(angle),
        length_mm=np.full(len(angle), radius),
        sense=np.repeat([1, -1], half),
        feed_mm_min=np.full(len(angle), 600.0),
        time_s=np.concatenate([np.arange(half), half + 30 + np.arange(half)]) * 0.35,
    )


def test_signs_on_a_circle() -> None:
    model = tn.BallbarModel(circle(), at_reversals=True)
    effects = {e.id: e for e in model.effects}
    data, bar = model.data, model.bar

    def change(name: str, **values: float) -> np.ndarray:
        return np.asarray(effects[name].change(values))

    x = given(data.x_mm) - 50.0
    y = given(data.y_mm) + 20.0
    assert change("scale_x", ppm=10.0) == pytest.approx(bar[:, 0] * x * 10e-3)
    arcsec = np.pi / 648000
    assert change("squareness_xy", arcsec=3.0) == pytest.approx(-bar[:, 0] * y * 3 * arcsec * 1e3)
    # Counter-clockwise at 90 degrees X travels to minus: the machine is b/2 too far to plus.
    top = 45
    assert bar[top] == pytest.approx([0, 1, 0], abs=1e-12)
    beside = change("backlash_x", b_um=4.0)[top - 5]
    assert beside == pytest.approx(2.0 * bar[top - 5, 0])
    # At 45 degrees, counter-clockwise, X goes back and Y forward: a Y that lags pulls inwards.
    corner = np.argmin(np.abs(bar[:100, 0] - bar[:100, 1]))
    late = change("gain_mismatch", y_x_ms=1.0)
    assert late[corner] == pytest.approx(-10.0 * 0.5, rel=0.01)
    assert change("drift_y", rate_um_h=3600.0) == pytest.approx(
        bar[:, 1] * (given(data.time_s) - given(data.time_s)[0])
    )
    assert change("ballbar_length", dl_um=2.0) == pytest.approx(np.full(len(data), 2.0))


def test_an_uncalibrated_bar_cannot_tell_both_scales() -> None:
    data = circle()
    x, y = given(data.x_mm) - 50.0, given(data.y_mm) + 20.0
    rng = np.random.default_rng(3)
    length = np.hypot(x * (1 + 30e-6), y) + rng.normal(0, 2e-4, len(data))
    measured = data.with_columns(length_mm=length)
    setup = tn.Setup(artefact=tn.Artefact("none"), ballbar={"calibrated": False})
    d = tn.diagnose(measured, setup)
    group = {i for s in d.alternatives for i in s} | {a for c in d.causes for a in c.aliases}
    assert {"scale_x", "scale_y"} <= group
    known = tn.diagnose(measured)
    assert [c.id for c in known.causes] == ["scale_x"]
    assert known.causes[0].parameters["ppm"] == pytest.approx(30.0, abs=1.0)


def test_settings_and_data_that_are_wrong() -> None:
    for table, match in (
        ({"length": 1}, r"ballbar\.length: unknown key"),
        ({"calibrated": "yes"}, "calibrated"),
        ({"wrist": 2}, "wrist"),
        ({"direction": [0, 1]}, "a list of 3 numbers"),
        ({"repeatability_um": -1}, "repeatability_um"),
    ):
        with pytest.raises(tn.InputError, match=match):
            tn.Setup(artefact=tn.Artefact("none"), ballbar=table)
    far = circle()
    wrong = np.array(far.length_mm)
    wrong[7] += 30.0
    with pytest.raises(tn.DataError, match=r"length_mm \(row 7\)"):
        tn.BallbarModel(far.with_columns(length_mm=wrong))
    with pytest.raises(tn.UnknownNameError, match="leg_expansion"):
        tn.diagnose(circle(), effects=["leg_expansion"])


def test_the_hybrid_machine_may_be_commanded_in_coordinates() -> None:
    machine = Mechanism()
    plan = ballbar_plan(machine, HOME, step_deg=10.0)
    tips = machine.forward(given(plan.joints)).tip_mm
    setup = tn.Setup(artefact=tn.Artefact("none"), hybrid={"e4_mm": 350.0})
    same = tn.Ballbar(
        setup=plan.setup,
        x_mm=tips[:, 0],
        y_mm=tips[:, 1],
        z_mm=tips[:, 2],
        length_mm=plan.length_mm,
        sense=given(plan.sense),
        time_s=given(plan.time_s),
    )
    joints = tn.BallbarModel(same, setup).machine.commands
    assert joints is not None
    assert np.abs(joints - given(plan.joints)).max() < 1e-7


def test_the_extended_model_gives_lengths_again() -> None:
    data = circle()
    rng = np.random.default_rng(4)
    x, y = given(data.x_mm) - 50.0, given(data.y_mm) + 20.0
    away = np.where(given(data.sense) > 0, -np.sign(np.round(y, 9)), np.sign(np.round(y, 9)))
    length = np.hypot(x - 2e-3 * away, y) + rng.normal(0, 2e-4, len(data))
    measured = data.with_columns(length_mm=length)
    d = tn.diagnose(measured)
    assert [c.id for c in d.causes] == ["backlash_x"]
    assert d.causes[0].parameters["b_um"] == pytest.approx(4.0, abs=0.1)
    again = d.model.lengths_mm(measured)
    assert np.std(again - length) < 5e-4


def test_command_line(tmp_path: Path) -> None:
    data = circle()
    rng = np.random.default_rng(5)
    noisy = data.with_columns(length_mm=data.length_mm + rng.normal(0, 3e-4, len(data)))
    path = tmp_path / "ballbar.csv"
    noisy.to_csv(path)
    result = CliRunner().invoke(app, ["ballbar", "diagnose", str(path)])
    assert result.exit_code == 0, result.output
    assert "Consistent: " in result.output
    plan = tmp_path / "plan.csv"
    ballbar_plan(Mechanism(), HOME, step_deg=20.0).to_csv(plan)
    result = CliRunner().invoke(app, ["ballbar", "plan", str(plan)])
    assert result.exit_code == 0, result.output
    assert "rank 16 of 17" in result.output


def with_backlash() -> tn.Ballbar:
    """Both circles with 4 µm of backlash of X and 0.3 µm of noise."""
    model = tn.BallbarModel(circle(), at_reversals=True)
    backlash = {e.id: e for e in model.effects}["backlash_x"]
    lost = np.asarray(backlash.change({"b_um": 4.0}))
    noise = np.random.default_rng(3).normal(0, 0.3, len(lost))
    data = circle()
    return data.with_columns(length_mm=data.length_mm + 1e-3 * (lost + noise))


@pytest.mark.parametrize("left_out", [{"sense"}, {"sense", "time_s", "feed_mm_min"}])
def test_without_the_sense_a_way_back_on_the_same_circle_is_a_run_of_its_own(
    left_out: set[str],
) -> None:
    complete = with_backlash()
    columns = {k: v for k, v in complete.columns.items() if k not in left_out}
    data = tn.Ballbar(**columns)
    one, other = tn.BallbarModel(complete), tn.BallbarModel(data)
    assert np.array_equal(one.path.runs, other.path.runs)
    d = tn.diagnose(data)
    assert [c.id for c in d.causes] == ["backlash_x"]
    assert d.causes[0].parameters["b_um"] == pytest.approx(4.0, abs=0.3)


def test_a_place_where_the_machine_stood_takes_no_travel_away() -> None:
    data = with_backlash()
    twice = data[np.sort(np.append(np.arange(len(data)), [40, 40, 260]))]
    path = tn.BallbarModel(twice, at_reversals=True).path
    plain = tn.BallbarModel(data, at_reversals=True).path
    x = given(data.x_mm)
    assert np.count_nonzero(plain.travel(x)) > 350
    once = np.unique(given(twice.time_s), return_index=True)[1]
    assert np.array_equal(path.travel(given(twice.x_mm))[once], plain.travel(x))


def test_readings_out_of_order_and_too_few_are_refused() -> None:
    data = circle()
    mixed = data[np.random.default_rng(5).permutation(len(data))]
    with pytest.raises(tn.DataError, match=r"time_s \(row \d+\): got .* after .*in the order"):
        tn.BallbarModel(mixed)
    for count in (1, 2):
        with pytest.raises(tn.DataError, match=rf"got {count} readings? in set-up 0, expected at"):
            tn.BallbarModel(data[:count])


def test_files_and_options_that_say_nothing_of_the_machine_are_refused(tmp_path: Path) -> None:
    words, bar = tmp_path / "setup.toml", tmp_path / "bar.toml"
    words.write_text('[ballbar]\ndirection = ["down", 0, -1]\n')
    bar.write_text("[ballbar]\ncalibrated = true\n")
    data = str(tn.sample_path("ballbar/circle.csv"))
    other = str(tn.sample_path("cross/setup.toml"))
    for arguments, match in (
        (["hybrid", "sensitivity", other], "no table [hybrid]"),
        (["hybrid", "cube", str(bar)], "no table [hybrid]"),
        (["hybrid", "cube", "--amount", "0"], "amount: got 0.0"),
        (["ballbar", "diagnose", data, other], "neither a table [ballbar] nor [hybrid]"),
        (
            ["ballbar", "diagnose", data, str(words)],
            "toml:2:14: ballbar.direction[0]: got 'down'",
        ),
    ):
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2
        assert match in result.output

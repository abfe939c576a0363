"""Positioning by ISO 230-2: results by the standard's formulas, and what is behind them."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from positioning_twin import HIDDEN, axis
from promise import kept, needed_runs
from trunnion.cli import app

NAMED = ("curve", "cycle_drift", "reversal", "scale")
MEASURED = Path(__file__).parents[2] / "shared" / "measured" / "positioning"


def test_results_are_those_of_the_standard() -> None:
    """Against the formulas of the standard, written as its clauses print them."""
    rng = np.random.default_rng(3)
    data = axis(rng, change=3.0 * rng.standard_normal(110))
    got = data.iso230_2()
    dev = data.deviation
    rows: dict[tuple[float, int], list[float]] = {}
    for t, d, x in zip(data.target, data.direction, dev, strict=True):
        rows.setdefault((float(t), int(d)), []).append(float(x))
    places = sorted({t for t, _ in rows})
    mean = {k: sum(v) / len(v) for k, v in rows.items()}
    s = {k: (sum((x - mean[k]) ** 2 for x in v) / (len(v) - 1)) ** 0.5 for k, v in rows.items()}
    b = [mean[t, 1] - mean[t, -1] for t in places]
    assert got.reversal_um == pytest.approx(max(map(abs, b)))
    assert got.mean_reversal_um == pytest.approx(sum(b) / len(b))
    assert got.repeatability_forward_um == pytest.approx(max(4 * s[t, 1] for t in places))
    assert got.repeatability_um == pytest.approx(
        max(
            max(2 * s[t, 1] + 2 * s[t, -1] + abs(x), 4 * s[t, 1], 4 * s[t, -1])
            for t, x in zip(places, b, strict=True)
        )
    )
    assert got.systematic_um == pytest.approx(max(mean.values()) - min(mean.values()))
    both = [(mean[t, 1] + mean[t, -1]) / 2 for t in places]
    assert got.mean_systematic_um == pytest.approx(max(both) - min(both))
    assert got.accuracy_um == pytest.approx(
        max(mean[k] + 2 * s[k] for k in mean) - min(mean[k] - 2 * s[k] for k in mean)
    )
    assert got.accuracy_backward_um == pytest.approx(
        max(mean[t, -1] + 2 * s[t, -1] for t in places)
        - min(mean[t, -1] - 2 * s[t, -1] for t in places)
    )


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured files are not part of the project")
def test_a_printed_report_comes_out() -> None:
    """ESS target drive, X: the figures that its owner's report prints."""
    data = tn.read_positioning(MEASURED / "ess_b02_x.csv")
    got = data.iso230_2()
    assert got.reversal_um == pytest.approx(33.58, abs=0.005)
    assert abs(got.mean_reversal_um) == pytest.approx(25.37, abs=0.005)
    assert got.mean_systematic_um == pytest.approx(93.65, abs=0.005)
    assert got.accuracy_um == pytest.approx(135.27, abs=0.01)
    causes = {c.id: c.parameters for c in tn.diagnose(data).causes}
    assert abs(causes["reversal"]["b_um"]) == pytest.approx(25.0, abs=1.5)
    assert causes["cycle_drift"]["rate_um_cycle"] == pytest.approx(-1.4, abs=0.3)
    assert "curve" in causes


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured files are not part of the project")
def test_an_axis_measured_against_itself_is_called_so() -> None:
    found = tn.diagnose(tn.read_positioning(MEASURED / "psi_fat_sat.csv"))
    first = found.summary().splitlines()[0]
    assert first.startswith("Too good: ")
    assert "look like the same counter" in first


def ess(name: str) -> tn.Positioning:
    return tn.read_positioning(MEASURED / f"{name}.csv")


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured files are not part of the project")
@pytest.mark.parametrize(
    ("name", "reversal", "drift"), [("ess_b02_z", 1.6, -0.2), ("ess_muts_y_ild50", 10.6, -10.6)]
)
def test_axes_of_a_target_drive(name: str, reversal: float, drift: float) -> None:
    """Reversal and drift a cycle as their owner found them; of the second axis drift dominates."""
    found = tn.diagnose(ess(name))
    causes = {c.id: c.parameters for c in found.causes}
    assert abs(causes["reversal"]["b_um"]) == pytest.approx(reversal, abs=0.1)
    assert any("cycle_drift" in a for a in found.alternatives)
    data = ess(name)
    slope = np.polyfit(data.cycle, data.deviation, 1)[0]
    assert slope == pytest.approx(drift, abs=0.1)
    if "cycle_drift" in causes:
        assert causes["cycle_drift"]["rate_um_cycle"] == pytest.approx(drift, abs=0.1)
        assert found.contributions[0].id == "cycle_drift"


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured files are not part of the project")
def test_a_backlash_that_differs_with_position_is_named() -> None:
    """Rotary axis of a vacuum tank, by its owner's scale of the encoder."""
    rows = np.genfromtxt(
        MEASURED / "vac_tank_rotary.csv", delimiter=",", names=True, dtype=None, encoding=None
    )
    counts = np.where(rows["ssi_raw"] > 2**30, rows["ssi_raw"] - 2**31, rows["ssi_raw"])
    data = tn.Positioning(
        target_deg=rows["position"].astype(float),
        measured_deg=-4.45181345e-05 * counts + 30.73995,
        direction=np.where(rows["approach"] == "above", -1, 1),
        cycle=np.tile([1, 2, 3, 4], 10),
    )
    got = data.iso230_2()
    backlash = (got.mean_backward - got.mean_forward) / 3600
    assert backlash == pytest.approx([0.031, 0.027, 0.021, 0.030, 0.027], abs=6e-4)
    assert max(got.spread_forward.max(), got.spread_backward.max()) / 3600 < 4.5e-4
    found = tn.diagnose(data)
    assert all("reversal_of_position" in a for a in found.alternatives)


def test_a_tolerance_is_decided_with_the_uncertainty() -> None:
    """Over many measurements: one that is kept by nothing passes in at most 5 of 100 cases."""
    rng = np.random.default_rng(3)
    passed = failed = 0
    runs = 200
    for _ in range(runs):
        target = np.tile(np.concatenate([np.arange(5.0), np.arange(5.0)[::-1]]), 5)
        sense = np.tile(np.repeat([1, -1], 5), 5)
        error = 3.0 * sense + 0.5 * rng.standard_normal(50)
        data = tn.Positioning(
            target_mm=target,
            measured_mm=target + 1e-3 * error,
            direction=sense,
            cycle=np.repeat(np.arange(1, 6), 10),
        )
        at_limit = data.iso230_2().conformity(mean_reversal_um=6.0).decision
        passed += at_limit == "pass"
        failed += at_limit == "fail"
    assert max(passed, failed) <= 0.05 * runs + 3 * (0.05 * 0.95 * runs) ** 0.5
    result = data.iso230_2()
    assert result.conformity(mean_reversal_um=9.0).decision == "pass"
    assert result.conformity(mean_reversal_um=9.0, reversal_um=3.0).decision == "fail"
    wide = result.conformity(mean_reversal_um=9.0, standard_uncertainty=5.0)
    assert wide.decision == "undecided"
    # ± 9 µm is narrower than 2 · 1.960 u: both limits can be exceeded
    assert wide.judged[0].guard == pytest.approx(1.960 * 5.0, rel=0.01)
    with pytest.raises(tn.UnknownNameError, match="accuracy"):
        result.conformity(accuracy=20.0)
    with pytest.raises(tn.InputError, match="expected one of"):
        result.conformity()
    with pytest.raises(tn.InputError, match="accuracy_um"):
        result.conformity(accuracy_um="wide")


def test_a_compensation_table_takes_the_deviations_off() -> None:
    rng = np.random.default_rng(5)
    data = axis(rng, change=3.0 * np.tile(np.repeat([1, -1], 11), 5))
    data = data.with_columns(measured_mm=data.measured + 2e-5 * data.target)
    before = data.iso230_2()
    table = before.compensation_table()
    right = np.where(
        data.direction > 0,
        np.interp(data.target, table.targets, table.forward),
        np.interp(data.target, table.targets, table.backward),
    )
    after = data.with_columns(measured_mm=data.measured + 1e-3 * right).iso230_2()
    assert after.systematic_um == pytest.approx(0.0, abs=1e-6)
    assert after.reversal_um == pytest.approx(0.0, abs=1e-6)
    assert after.repeatability_forward_um == pytest.approx(before.repeatability_forward_um)
    at = before.compensation_table(zero_at=float(table.targets[3]))
    assert at.forward[3] + at.backward[3] == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(tn.InputError, match="zero_at"):
        before.compensation_table(zero_at=900.0)


def test_rotary_axes_are_in_arcsec() -> None:
    rng = np.random.default_rng(1)
    target = np.tile(np.concatenate([np.arange(0, 360, 30.0), np.arange(330, -1, -30.0)]), 5)
    sense = np.tile(np.repeat([1, -1], 12), 5)
    error = 4.0 * sense + 0.5 * rng.standard_normal(120)
    data = tn.Positioning(
        target_deg=target,
        measured_deg=target + error / 3600,
        direction=sense,
        cycle=np.repeat(np.arange(1, 6), 24),
    )
    got = data.iso230_2()
    assert got.mean_reversal_arcsec == pytest.approx(8.0, abs=0.3)
    found = tn.diagnose(data)
    assert found.named == {"reversal"}
    assert found.causes[0].parameters["b_arcsec"] == pytest.approx(8.0, abs=0.4)


def test_uncertainties_are_true() -> None:
    """Of the mean reversal, the accuracy and the repeatability, over many measurements."""
    rng = np.random.default_rng(7)
    change = 3.0 * np.tile(np.repeat([1, -1], 11), 5)
    several = [axis(rng, change=change).iso230_2() for _ in range(150)]
    for name in ("mean_reversal_um", "accuracy_um", "systematic_um"):
        spread = np.std([getattr(r, name) for r in several])
        stated = np.median([r.std_errors[name] for r in several])
        assert 0.75 < stated / spread < 1.6, name


@pytest.mark.parametrize("cause", NAMED)
def test_what_is_hidden_is_named(cause: str) -> None:
    runs, good = needed_runs(0.95), 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, len(cause)])
        plain = axis(rng)
        change = HIDDEN[cause](plain, rng)
        data = plain.with_columns(measured_mm=plain.measured + 1e-3 * change)
        good += any(cause in a for a in tn.diagnose(data).alternatives)
    assert kept(good, runs, 0.95)


def test_nothing_is_named_where_nothing_is() -> None:
    runs = needed_runs(0.95)
    calm = [tn.diagnose(axis(np.random.default_rng(5000 + s))).verdict for s in range(runs)]
    assert kept(calm.count("consistent"), runs, 0.95)


@pytest.mark.parametrize("cycles", [1, 2])
def test_few_readings_show_what_they_can(cycles: int) -> None:
    """One cycle of nine targets: the curve of many columns is named, and noise is not."""
    runs, good, calm = needed_runs(0.95), 0, 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, 31])
        plain = axis(rng, targets=9, cycles=cycles)
        change = HIDDEN["curve"](plain, rng)
        data = plain.with_columns(measured_mm=plain.measured + 1e-3 * change)
        good += any("curve" in a for a in tn.diagnose(data).alternatives)
        calm += tn.diagnose(plain).verdict == "consistent"
    assert kept(good, runs, 0.95)
    assert kept(calm, runs, 0.95)


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured files are not part of the project")
def test_one_cycle_shows_the_curve_of_five() -> None:
    whole = tn.read_positioning(MEASURED / "ess_b02_x.csv")
    for cycle in range(1, 6):
        found = tn.diagnose(whole[whole.cycle == cycle])
        assert found.named >= {"curve", "reversal"}
        causes = {c.id: c.parameters for c in found.causes}
        assert causes["reversal"]["b_um"] == pytest.approx(-25.4, abs=5.0)


def test_a_thousand_targets_are_no_thousand_parameters() -> None:
    """An encoder beside the axis, read every half millimetre."""
    rng = np.random.default_rng(12)
    up = np.linspace(0.0, 500.0, 1001)
    target, sense = np.concatenate([up, up[::-1]]), np.repeat([1, -1], 1001)
    error = 20.0 * target / 1e3 + 3.0 * np.sin(target / 60.0) + 1.5 * sense
    error += 0.7 * rng.standard_normal(len(target))
    data = tn.Positioning(
        target_mm=target,
        measured_mm=target + 1e-3 * error,
        direction=sense,
        cycle=np.ones(len(target), dtype=int),
    )
    found = tn.diagnose(data)
    assert found.named == {"scale", "reversal", "curve"}
    assert found.sigma == pytest.approx(0.7, rel=0.1)
    curve = next(c for c in found.causes if c.id == "curve")
    assert len(curve.parameters) == 48
    # deviations from the line through the first and the last target
    at = {float(k.split("_")[1]): v for k, v in curve.parameters.items()}
    bow = 3.0 * (np.sin(up / 60.0) - up / 500.0 * np.sin(500.0 / 60.0))
    assert list(at.values()) == pytest.approx(np.interp(list(at), up, bow), abs=1.0)


def test_targets_that_are_measured_once_are_said_to_be() -> None:
    data = axis(np.random.default_rng(4), cycles=1)
    forward = tn.diagnose(data[data.direction == 1])
    assert "No target is measured twice" in forward.summary()
    assert "No target is measured twice" not in tn.diagnose(data).summary()


def test_another_instrument_on_the_same_stops() -> None:
    data = axis(np.random.default_rng(4))
    both = data.with_columns(laser_mm=data.measured + 0.002)
    assert both.instruments == ("laser",)
    off = both.instrument("laser").deviation - data.deviation
    assert off == pytest.approx(2.0)
    with pytest.raises(tn.UnknownNameError, match="laser"):
        both.instrument("lasr")


def test_useless_stops_are_refused() -> None:
    data = axis(np.random.default_rng(4))
    with pytest.raises(tn.DataError, match="direction -1"):
        data[data.direction == 1].iso230_2()
    with pytest.raises(tn.InputError, match="one of them"):
        tn.Positioning(direction=[1], cycle=[1])
    with pytest.raises(tn.InputError, match="one axis a table"):
        data.with_columns(axis=["X"] * 109 + ["Y"])


def test_the_command_prints_them() -> None:
    path = str(tn.sample_path("positioning/axis.csv"))
    said = CliRunner().invoke(app, ["positioning", "results", path])
    assert said.exit_code == 0, said.output
    assert "accuracy A" in said.output
    held = CliRunner().invoke(
        app, ["positioning", "results", path, "--tolerance", "accuracy_um=60", "--table"]
    )
    assert held.output.startswith("Pass: conformity is proved")
    assert "correction ↑" in held.output
    named = CliRunner().invoke(app, ["diagnose", path])
    assert "reversal" in named.output


def test_the_page_of_results_holds_the_stated_uncertainty(tmp_path: Path) -> None:
    """U of the mean reversal, 2 √(u² + 3²), with a standard uncertainty of 3 µm stated."""
    file, page = tn.sample_path("positioning/axis.csv"), tmp_path / "iso.html"
    words = ["positioning", "results", str(file), "--standard-uncertainty", "3", "--html"]
    assert CliRunner().invoke(app, [*words, str(page)]).exit_code == 0
    found = tn.read_positioning(file).iso230_2()
    u = np.hypot(found.std_errors["mean_reversal_um"], 3.0)
    cells = re.sub(r"<[^>]+>|\s+", " ", page.read_text(encoding="utf-8")).split()
    at = cells.index("B̄")
    assert cells[at + 1 : at + 4] == [f"{found.mean_reversal_um:.1f}", f"{2 * u:.1f}", "µm"]

"""What each cause explains and had biased, against least squares written out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from power.one_machine import drawn
from power.study import ground
from result_examples import diagnosis_of
from trunnion.diagnosis.effect import linear
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.model import Nuisance, Readings
from trunnion.machine.effects import Owner
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Floats = NDArray[np.float64]
N = 120
X = np.linspace(-1.0, 1.0, N)
LINE = np.stack([np.ones(N), X], axis=1)
COLUMNS = {"bow": 300 * X**2, "cubic": 40 * X**3, "wave": 3 * np.cos(14 * X)}


def rms_left(y: Floats, *columns: Floats) -> float:
    """Rms of what a line and some columns leave of readings, by least squares."""
    design = np.column_stack([LINE, *columns])
    left = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def line(y: Floats) -> LinearModel:
    return LinearModel(
        X,
        Readings(y, np.arange(N), "µm"),
        [Nuisance("EX0C", "µm", Owner.MACHINE), Nuisance("EA0A", "arcsec", Owner.MACHINE)],
        LINE,
        effects=[linear(k, ["h_um"], c, f"the {k}") for k, c in COLUMNS.items()],
    )


def readings(seed: int) -> Floats:
    noise = np.random.default_rng(seed).standard_normal(N)
    return np.asarray(2.0 + sum(COLUMNS.values()) + noise)


def test_the_ladder_is_the_one_of_least_squares() -> None:
    y = readings(1)
    d = tn.diagnose(line(y))
    assert d.ladder is not None
    assert d.ladder.causes == ("bow", "cubic", "wave")
    columns = list(COLUMNS.values())
    expected = [rms_left(y, *columns[:k]) for k in range(4)]
    assert d.ladder.rms_um == pytest.approx(expected, rel=1e-6)
    assert d.ladder.rms_um[0] == pytest.approx(d.gain.rms_before_um)
    assert d.ladder.rms_um[-1] == pytest.approx(d.gain.rms_after_um)
    for step, c in enumerate(d.contributions):
        own = COLUMNS[c.id]
        others = [x for name, x in COLUMNS.items() if name != c.id]
        assert c.rms_um == pytest.approx(np.sqrt(expected[step] ** 2 - expected[step + 1] ** 2))
        assert c.share == pytest.approx((c.rms_um / expected[0]) ** 2)
        alone = expected[0] ** 2 - rms_left(y, own) ** 2
        assert c.alone_um == pytest.approx(np.sqrt(alone), rel=1e-5)
        last = rms_left(y, *others) ** 2 - expected[-1] ** 2
        assert c.last_um == pytest.approx(np.sqrt(last), rel=1e-5)
        assert c.last_share == pytest.approx(last / expected[0] ** 2, rel=1e-5)
    assert [c.share for c in d.contributions] == sorted(
        (c.share for c in d.contributions), reverse=True
    )
    total = sum(c.share for c in d.contributions)
    assert total == pytest.approx(1 - (expected[-1] / expected[0]) ** 2)


def test_the_biases_of_the_causes_add_up_to_what_changes() -> None:
    d = tn.diagnose(line(readings(2)))
    for name in ("EX0C", "EA0A"):
        total = sum(c.bias[name] for c in d.contributions)
        assert total == pytest.approx(d.errors_before[name] - d.errors_after[name], abs=1e-6)
    bow = next(c for c in d.contributions if c.id == "bow")
    size = next(c for c in d.causes if c.id == "bow").parameters["h_um"]
    shift = np.linalg.lstsq(LINE, size * COLUMNS["bow"], rcond=None)[0]
    assert bow.bias["EX0C"] == pytest.approx(shift[0], rel=1e-6)


def test_the_table_of_biases_begins_with_the_error_that_moves_the_tool_most() -> None:
    """3 arcsec are 1.5 µm at 100 mm, less than 2 µm, however well the angle is known."""
    y = readings(1)
    d = tn.diagnose(line(y))
    bias = {"EA0A": 3.0, "EX0C": 2.0}
    cause = replace(d.contributions[0], bias=bias)
    known = replace(
        d,
        contributions=(cause,),
        errors_before=bias,
        errors_after=dict.fromkeys(bias, 0.0),
        errors_std={"EA0A": 0.1, "EX0C": 1.5},
    )
    table = next(t for t in known.tables() if t.title.startswith("Bias of the plain model"))
    assert [row[1] for row in table.rows] == ["EX0C", "EA0A"]
    assert "EX0C is biased by 2 µm" in known.summary()
    larger = replace(cause, bias={"EA0A": 3.0, "EX0C": 1.4})
    table = next(t for t in larger.tables() if t.title.startswith("Bias of the plain model"))
    assert [row[1] for row in table.rows] == ["EA0A", "EX0C"]


def test_people_read_labels() -> None:
    d = tn.diagnose(line(readings(3)))
    said = next(s for s in d.sentences() if s.startswith("Residual rms"))
    assert "→" in said
    assert "(the bow)" in said
    assert "What each cause explains" in d.summary()


def test_nothing_is_explained_where_nothing_is_named() -> None:
    d = tn.diagnose(line(np.random.default_rng(4).standard_normal(N)))
    assert d.contributions == ()
    assert d.ladder is not None
    assert d.ladder.causes == ()
    assert d.ladder.rms_um[0] == pytest.approx(d.gain.rms_before_um)


def test_a_drift_of_touches_and_its_bias_in_tolerances(tmp_path: Path) -> None:
    """Data of the independent generator: the bias is the miss of the plain model."""
    plan, setup, _, read = ground("rich")
    rng = np.random.default_rng(5)
    truth = Truth(
        errors=random_errors(rng),
        placement=random_placement(rng),
        effects={
            "drift_z": {"rate_um_h": 8.0},
            "c_positioning": {"a1_arcsec": 9.0, "b1_arcsec": 4.0},
        },
    )
    m = measure(plan, setup, truth, noise_um=0.2, seed=3)
    text = read.to_toml().replace("[machine]", "[machine.tolerance]\nEZ0A = 2.0\n[machine]", 1)
    (tmp_path / "setup.toml").write_text(text, encoding="utf-8")
    d = tn.diagnose(tn.Touches(m.columns), tn.read_setup(tmp_path / "setup.toml"))
    drift = next(c for c in d.contributions if c.id.startswith(("drift_z", "warmup_z")))
    miss = d.errors_before["EZ0A"] - truth.errors["EZ0A"]
    assert drift.bias["EZ0A"] == pytest.approx(miss, abs=0.4)
    assert abs(miss) > 1.0
    assert drift.bias_in_tolerances == {"EZ0A": pytest.approx(drift.bias["EZ0A"] / 2.0)}
    again = tn.Diagnosis.from_json(d.to_json())
    assert again.contributions == d.contributions
    assert again.ladder == d.ladder


def test_each_unit_has_numbers_of_its_own() -> None:
    """Micrometres and arcseconds in one log: a cause of the one explains nothing of the other."""
    d = diagnosis_of("axislog")
    (cause,) = d.contributions
    assert set(cause.by_unit()) == {"µm", "arcsec"}
    assert cause.by_unit()["µm"].share > 0.9
    assert cause.by_unit()["arcsec"].share < 1e-6
    assert d.ladder is not None
    for ladder in (d.ladder, *d.ladder.others):
        gain = d.gain.by_unit()[ladder.unit]
        assert ladder.rms_um[0] == pytest.approx(gain.rms_before_um)
        assert ladder.rms_um[-1] == pytest.approx(gain.rms_after_um)


def test_what_a_cause_does_not_change_it_explains_nothing_of() -> None:
    """A force on a rotary axis changes no lengths: rounding is no contribution."""
    made = drawn(("touches", "ballbar", "axislog", "positioning"), 0, 11)
    found = tn.diagnose(made.data[2], made.setup)
    force = next(c for c in found.contributions if c.id == "offset_a").by_unit()
    assert force["arcsec"].rms_um > 0.1
    assert force["µm"].rms_um == 0.0

"""Several instruments on the same stops: whose error it is."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from positioning_twin import axis
from promise import kept, needed_runs
from test_positioning import MEASURED
from trunnion.cli import app


def stops(seed: int, *, third: bool) -> tn.Positioning:
    """An axis with scale and backlash, which its encoder does not see; scatter 0.5 µm."""
    rng = np.random.default_rng([3, seed])
    plain = axis(np.random.default_rng(5), targets=6, cycles=3)
    actual = plain.target + 1e-3 * (0.02 * plain.target + 0.5 * rng.standard_normal(len(plain)))
    noise = 1e-3 * rng.standard_normal((3, len(plain)))
    lost = 2e-3 * plain.direction
    columns = {"measured_mm": actual + lost + 0.4 * noise[0], "encoder_mm": actual + 0.1 * noise[1]}
    if third:
        columns["laser_mm"] = actual + lost + 0.2 * noise[2]
    return plain.with_columns(**columns)


@pytest.mark.parametrize(("third", "whose"), [(False, "between"), (True, "encoder")])
def test_what_one_does_not_see_is_told(third: bool, whose: str) -> None:
    runs, good = needed_runs(0.95), 0
    for seed in range(runs):
        found = {a.id: a for a in tn.whose_error(stops(seed, third=third)).attributions}
        right = {i: a.whose for i, a in found.items()} == {"scale": "axis", "reversal": whose}
        good += right and "encoder" not in found["reversal"].seen_by
    assert kept(good, runs, 0.95)


@pytest.mark.parametrize(("third", "whose"), [(False, "undecided"), (True, "axis")])
def test_what_an_instrument_is_too_coarse_for_it_does_not_confirm(third: bool, whose: str) -> None:
    """A scale of 3 µm that a laser with 30 µm of noise can neither see nor deny."""
    runs, good = needed_runs(0.9), 0
    for seed in range(runs):
        rng = np.random.default_rng([8, seed])
        plain = axis(np.random.default_rng(5), targets=6, cycles=3)
        actual = plain.target + 1e-5 * (plain.target - 250)
        noise = 1e-3 * rng.standard_normal((3, len(plain)))
        columns = {"measured_mm": actual + 0.2 * noise[0], "laser_mm": actual + 30 * noise[1]}
        if third:
            columns["encoder_mm"] = actual + 0.2 * noise[2]
        found = tn.whose_error(plain.with_columns(**columns))
        scales = [a.whose for a in found.attributions if a.id == "scale"]
        good += scales == [whose] and "not there: laser (" in found.summary()
    assert kept(good, runs, 0.9)


def test_each_has_its_own_scatter() -> None:
    """By differences, which are free of the scatter of the axis."""
    found = [tn.whose_error(stops(s, third=True)).scatter for s in range(12)]
    for name, true in (("measured", 0.4), ("encoder", 0.1), ("laser", 0.2)):
        assert np.mean([f[name] ** 2 for f in found]) ** 0.5 == pytest.approx(true, abs=0.05)


def test_one_instrument_is_not_enough(tmp_path: Path) -> None:
    data = stops(0, third=False)
    with pytest.raises(tn.InputError, match="NAME_mm"):
        tn.whose_error(data.with_columns(encoder_mm=None))
    counter = tn.whose_error(data.with_columns(encoder_mm=data.target + 1e-5))
    assert counter.counters == ("encoder",)
    assert "no two instruments" in counter.summary()
    path = tmp_path / "stops.csv"
    data.to_csv(path)
    said = CliRunner().invoke(app, ["positioning", "instruments", str(path)])
    assert "A third instrument would tell" in said.output


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured files are not part of the project")
def test_a_slit_with_motor_resolver_and_laser() -> None:
    """The counter of the motor is left out; resolver and laser show curves of their own."""
    rows = np.genfromtxt(MEASURED / "ess_bifrost_slit_11360_axis2.csv", delimiter=",", names=True)
    data = tn.Positioning(
        target_mm=rows["target_mm"],
        measured_mm=rows["laser_mm"],
        direction=rows["direction"].astype(int),
        cycle=rows["cycle"].astype(int),
        resolver_mm=rows["resolver_mm"],
        motor_mm=rows["motor_mm"],
    )
    found = tn.whose_error(data)
    assert found.counters == ("motor",)
    whose = {a.id: a.whose for a in found.attributions}
    assert whose["curve"] == "between"
    drift = next(a for a in found.attributions if a.id == "cycle_drift")
    assert drift.seen_by == ("measured",)

"""A servo period that the set-up states wrongly is named, from the file or from the touches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from trunnion.data.linuxcnc_log import probe_log_of
from trunnion.probing.recorded import other_period_ms, servo_period_ms

CUBOID = tn.Setup(tn.Artefact("cuboid", length_mm=80.0, width_mm=60.0, height_mm=30.0))
SIZES = {"EX0C": 30.0, "EY0C": 30.0, "EA0A": 30.0, "EB0C": 40.0, "EZ0A": 30.0}


def with_period(period_ms: float) -> tn.Setup:
    return replace(CUBOID, probe=tn.Probe(servo_period_ms=period_ms))


def touched(seed: int, feeds: tuple[float, ...], period_ms: float = 1.0) -> tn.Touches:
    """Touches of a machine of this seed by a control with a clock."""
    rng = np.random.default_rng(seed)
    errors = {name: float(rng.uniform(-size, size)) for name, size in SIZES.items()}
    control = with_period(period_ms)
    plan = tn.plan(control, feeds_mm_min=feeds)
    return tn.simulate(plan, control, errors, {"dx_um": 130.0}, noise_um=0.3, seed=seed)


def written(data: tn.Touches) -> tn.Touches:
    """With the six decimals of a log."""
    return data.with_columns(**{f"{x}_mm": np.round(data[f"{x}_mm"], 6) for x in "xyz"})


@pytest.mark.parametrize(
    ("given", "asked"),
    [(1000.0, "in µs (1 ms)"), (100.0, "in µs (0.1 ms)"), (0.001, "in s (1 ms)")],
)
def test_a_period_of_no_control_is_refused(given: float, asked: str, tmp_path: Path) -> None:
    file = tmp_path / "setup.toml"
    file.write_text(f'[artefact]\nkind = "cross"\n[probe]\nservo_period_ms = {given}\n')
    with pytest.raises(tn.TrunnionError) as refused:
        tn.read_setup(file)
    assert f":4:19: probe.servo_period_ms: got {given:g}, expected 0, or" in str(refused.value)
    assert f"is it {asked}?" in str(refused.value)
    assert with_period(0.0).probe.servo_period_ms == 0.0


@pytest.mark.parametrize("seed", [4, 57, 811])
@pytest.mark.parametrize("feeds", [(600.0,), (60.0, 600.0)])
@pytest.mark.parametrize("period", [0.5, 1.0, 2.0])
def test_a_wrong_period_is_named_with_the_right_one(
    feeds: tuple[float, ...], period: float, seed: int
) -> None:
    data = written(touched(seed, feeds, period))
    right = f"probe.servo_period_ms = {period:g}"
    for factor in (0.1, 10.0):
        notes = tn.identify(data, with_period(factor * period)).notes
        assert right in notes[0]
        assert f"not every {factor * period:g} ms" in notes[0]
        assert not any("likely cause" in note for note in notes)
    assert not any("looks at the probe" in note for note in tn.identify(data, CUBOID).notes[1:])
    assert right in tn.identify(data, CUBOID).notes[0]
    said = tn.identify(data, with_period(period)).notes
    assert not any("servo_period_ms" in note for note in said)


@pytest.mark.parametrize("seed", [12, 330])
@pytest.mark.parametrize("feeds", [(600.0,), (60.0, 600.0)])
def test_a_coarse_period_without_starts_is_no_other_mistake(
    feeds: tuple[float, ...], seed: int
) -> None:
    data = touched(seed, feeds)
    data = data.with_columns(**{name: None for name in data.columns if name.startswith("start_")})
    for stated in (10.0, 40.0):
        notes = tn.identify(data, with_period(stated)).notes
        assert not any("likely cause" in note for note in notes)


def test_touches_of_a_log_say_what_those_of_a_file_do(tmp_path: Path) -> None:
    control = with_period(1.0)
    plan = tn.plan(control, c_deg=(0, 45, 90), feeds_mm_min=(60.0, 600.0))
    data = tn.simulate(plan, control, {"EX0C": 17.0, "EA0A": 12.0}, noise_um=0.2, seed=9)
    log = tmp_path / "touches.log"
    log.write_text(probe_log_of(plan, data, "plan"))
    read = tn.read_probe_log(log, plan)
    notes = [tn.identify(touches, CUBOID).notes[0] for touches in (data, read)]
    assert notes[0] == notes[1]
    assert "state probe.servo_period_ms = 1." in notes[0]


def test_a_display_is_no_clock() -> None:
    """Coordinates that are rounded; places that are counted, too; and no steps at all."""
    plan = tn.plan(CUBOID)
    exact = tn.simulate(plan, CUBOID, {"EX0C": 17.0, "EA0A": 12.0}, noise_um=3.0, seed=2)
    for step_mm in (1e-6, 1e-3, 1e-2):
        shown = {f"{x}_mm": step_mm * np.round(exact[f"{x}_mm"] / step_mm) for x in "xyz"}
        assert servo_period_ms(exact.with_columns(**shown)) == 0.0
    assert other_period_ms(exact, 1.0) == 0.0


def test_touches_of_two_passes_are_recorded_at_one_feed() -> None:
    """Plan, program and what they are expected to show say the same."""
    once = with_period(1.0)
    twice = replace(once, plan=replace(once.plan, slow_feed_mm_min=30.0))
    plan = tn.plan(once, feeds_mm_min=(60.0, 600.0))
    for refused in (
        lambda: tn.plan(twice, feeds_mm_min=(60.0, 600.0)),
        lambda: tn.probing_program(plan, twice),
        lambda: tn.observability(plan, twice),
    ):
        with pytest.raises(tn.DataError, match=r"feeds of 60, 600 .* slow_feed_mm_min = 30"):
            refused()
    alike = [
        {name for names in tn.observability(seen, setup).alike for name in names}
        for seen, setup in ((plan, once), (tn.plan(twice), twice))
    ]
    assert "trigger_delay" in alike[1] - alike[0]
    noisy = replace(once.probe, repeatability_um=0.1)
    one_feed = tn.plan(twice)
    expected = tn.observability(one_feed, replace(twice, probe=noisy)).noise_um
    assert expected == pytest.approx(np.hypot(0.1, 0.5 / np.sqrt(12)))
    assert len(tn.probing_program(one_feed, twice).cycle.steps) == len(one_feed)


def test_places_of_an_axis_that_nothing_is_probed_along_are_no_digits() -> None:
    data = written(touched(21, (60.0, 600.0)))
    along = np.abs(data["dir_y"]) < 0.5
    some = data[along].with_columns(y_mm=np.round(data[along]["y_mm"], 1))
    assert servo_period_ms(some) == pytest.approx(1.0)


@pytest.mark.parametrize("period", [0.25, 0.75])
@pytest.mark.parametrize("seed", [3, 58, 914])
def test_the_digits_of_a_file_are_no_clock(period: float, seed: int) -> None:
    """A sphere's ways are oblique, and coordinates in steps of 0.1 µm make them steps, too."""
    setup = tn.Setup(
        tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(60.0, 20.0, 60.0)),
        probe=tn.Probe(servo_period_ms=period),
    )
    plan = tn.plan(setup, c_deg=(0, 120, 240), a_deg=(30, -40), feeds_mm_min=(600.0, 60.0))
    data = tn.simulate(plan, setup, {"EX0C": 15.0}, noise_um=0.1, seed=seed)
    short = data.with_columns(**{f"{x}_mm": np.round(data[f"{x}_mm"], 4) for x in "xyz"})
    for one in (data, written(data), short):
        assert servo_period_ms(one) == pytest.approx(period, rel=0.02) or not servo_period_ms(one)
        assert other_period_ms(one, period) == 0.0

"""A warm machine on a bar that is not calibrated: scales that are nearly, and not quite, alike."""

import re

import numpy as np
import pytest

import trunnion as tn


def bar(rng: np.random.Generator, ppm: tuple[float, float], length_um: float) -> tn.Ballbar:
    """A circle of 150 mm in both senses, with 5 µm of backlash of Y."""
    at = np.radians(2.0 * np.arange(180) + 1.0)
    angle = np.concatenate([at, -at])
    sense = np.repeat([1, -1], 180)
    x, y = 150.0 * np.cos(angle), 150.0 * np.sin(angle)
    real = np.column_stack([x * (1 + ppm[0] * 1e-6), y * (1 + ppm[1] * 1e-6)])
    real[:, 1] -= 2.5e-3 * np.sign(sense * np.cos(angle))
    length = np.linalg.norm(real - (0.02, -0.03), axis=1) + 1e-3 * length_um
    length += 1.5e-4 * rng.standard_normal(len(x))
    columns = {"setup": np.ones(len(x)), "x_mm": x, "y_mm": y, "length_mm": length}
    return tn.Ballbar(columns | {"sense": sense, "time_s": 0.3 * np.arange(len(x))})


def run(rng: np.random.Generator, axis: str, ppm: float, reversal_um: float) -> tn.Positioning:
    """Five cycles at eleven targets over 300 mm."""
    up = np.linspace(0.0, 300.0, 11)
    target = np.tile(np.concatenate([up, up[::-1]]), 5)
    direction = np.tile(np.repeat([1, -1], 11), 5)
    measured = target * (1 + ppm * 1e-6) + 3e-3 - 5e-4 * reversal_um * direction
    measured += 4e-4 * rng.standard_normal(len(target))
    columns = {"target_mm": target, "measured_mm": measured, "direction": direction}
    columns |= {"cycle": np.repeat(np.arange(1, 6), 22), "time_s": 8.0 * np.arange(110)}
    return tn.Positioning(columns | ({"axis": [axis] * 110} if axis else {}))


@pytest.mark.parametrize(("x", "y", "bar_um"), [(30, 32, 4), (20, 22, 2), (50, 52, 6)])
def test_scales_that_are_nearly_alike_are_no_contradiction(x: int, y: int, bar_um: int) -> None:
    """One scale of both axes explains most; what it leaves is no other scale of one kind."""
    for seed in (1, 2):
        rng = np.random.default_rng([seed, x])
        data = [bar(rng, (x, y), bar_um), run(rng, "X", x, 0.0), run(rng, "Y", y, 5.0)]
        found = tn.diagnose(data)
        wanted = {"scale_x", "scale_y", "backlash_y", "ballbar:ballbar_length"}
        assert {cause.id for cause in found.causes} == wanted
        sizes = {c.id: next(iter(c.parameters.values())) for c in found.causes}
        assert sizes["scale_x"] == pytest.approx(x, abs=1.5)
        assert sizes["scale_y"] == pytest.approx(y, abs=1.5)


def test_two_runs_of_which_nothing_says_the_axis_are_said_to_be_taken_for_one() -> None:
    rng = np.random.default_rng(3)
    found = tn.diagnose([run(rng, "", 30.0, 0.0), run(rng, "", -20.0, 0.0)])
    (note,) = (note for note in found.notes if "axis" in note)
    assert "the runs are taken for those of one axis" in note
    named = tn.diagnose([run(rng, "X", 30.0, 0.0), run(rng, "Y", -20.0, 0.0)])
    assert not any("there is no column axis" in note for note in named.notes)


def test_an_error_says_in_which_measurement_it_is() -> None:
    rng = np.random.default_rng(4)
    one, other = run(rng, "X", 30.0, 0.0), run(rng, "Y", 30.0, 0.0)
    with pytest.raises(tn.DataError, match=r"^measurement 2: targets: got 2"):
        tn.diagnose([one, other[:2]])
    with pytest.raises(tn.DataError, match=r"^measurement 3: targets: got 2"):
        tn.diagnose([one, one, other[:2]])


def test_what_a_kind_says_of_an_axis_is_all_of_its_scale() -> None:
    """Beside a scale of all axes it was the difference from it: 20 and 0 ppm of 60 and 40."""
    rng = np.random.default_rng(1)
    data = [bar(rng, (40, 60), 0.0), run(rng, "X", 40.0, 0.0), run(rng, "Y", 40.0, 5.0)]
    found = tn.diagnose(data)
    assert {"scale_xy", "ballbar:differs_scale_y"} <= found.named
    said = re.search(r"scale_y is (\S+) ± \S+ ppm in ballbar, (\S+) ± ", found.unexplained or "")
    assert said is not None
    assert [float(x) for x in said.groups()] == pytest.approx([60.0, 40.0], abs=1.5)


def test_the_rms_of_sets_has_the_unit_that_its_column_says() -> None:
    """Of several measurements, each weighed by its own noise, it is relative to that."""
    for seed in range(6, 11):
        rng = np.random.default_rng(seed)
        data = [bar(rng, (20.0, 20.0), 0.0), run(rng, "X", 20.0, 0.0)]
        found = tn.diagnose(data)
        for one in found.evidence:
            assert one.unit == "relative to the noise"
            assert 0.8 < one.rms_um < 1.2
            (table,) = one.tables()
            assert table.columns[-1] == "rms (relative to the noise)"
        for table in found.tables():
            if table.title == "Sets of causes":
                assert table.columns[-1] == "rms (relative to the noise)"
        alone = tn.diagnose(data[0])
        assert alone.evidence[0].unit == "µm"
        assert alone.evidence[0].rms_um == pytest.approx(alone.gain.rms_after_um, rel=0.02)
        assert alone.evidence[0].tables()[0].columns[-1] == "rms (µm)"

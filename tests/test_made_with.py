"""What an estimate was made with travels with it: a set-up with other axes, and a frame of the
control in which errors are none of the joints, are refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from result_examples import SAMPLES, diagnosis_of
from test_cli import run
from trunnion import compensation, controls
from trunnion.compensation import (
    InverseCompensation,
    MachineErrors,
    compensation_forecast,
    volumetric_budget,
)
from trunnion.controls import correct_program
from trunnion.data.frame import COLUMNS
from trunnion.machine.geometry import Geometry

AXES = {"A": tn.AxisSetup(point_mm=(0.0, 0.0, -50.0)), "C": tn.AxisSetup()}
CENTRE = (210.5, 148.2, -301.0)
SETUP = tn.Setup(tn.Artefact("cross"), axes=AXES, control=tn.ControlSetup(centre_mm=CENTRE))
OTHER_POINT = r"^axes.A.point_mm: got \[0, 0, 0\], expected \[0, 0, -50\]"
ERRORS = {"EX0C": 15.0, "EB0A": 12.0, "EY0A": -9.0}


@cache
def touches() -> tn.Touches:
    return tn.simulate(tn.plan(SETUP), SETUP, ERRORS, noise_um=0.2, seed=4)


@cache
def r_test() -> tn.RotaryTest:
    turns = {"A": np.repeat([0.0, 60.0, -60.0], 4), "C": np.tile([0.0, 90.0, 180.0, 270.0], 3)}
    plan = tn.plan_rotary_test(SETUP, (90.0, 20.0, 60.0), turns)
    return tn.simulate_rotary_test(plan, SETUP, (90.0, 20.0, 60.0), ERRORS, noise_um=0.2, seed=4)


def casadi() -> tn.Estimate:
    pytest.importorskip("casadi")
    return tn.casadi_baseline.identify(touches(), SETUP)


def stored(estimate: tn.Estimate) -> tn.Estimate:
    """What comes back from the JSON of an estimate."""
    held = json.loads(estimate.to_json())
    return tn.Estimate.from_dict({k: held[k] for k in ("errors", "geometry", "control_frame")})


MADE: dict[str, Callable[[], Any]] = {
    "identify": lambda: tn.identify(touches(), SETUP),
    "identify, an effect": lambda: tn.identify(touches(), SETUP, effects=("scale_x",)),
    "closed form": lambda: tn.closed_form(touches(), SETUP),
    "closed form, printed": lambda: tn.closed_form(touches(), SETUP, method="printed"),
    "casadi": casadi,
    "diagnosis": lambda: tn.diagnose(touches(), SETUP).model,
    "R-test": lambda: tn.identify_rotary_test(r_test(), SETUP, (90.0, 20.0, 60.0)),
}
"""Everything that makes an estimate of location errors and knows the set-up."""


def points(a_mm: float = 0.0) -> tn.Setup:
    return replace(SETUP, axes={"A": tn.AxisSetup(point_mm=(0.0, 0.0, a_mm))})


PROGRAM = "G21 G90 G94 F100\nG0 X0 Y0 Z0 A0 C0\nG1 X1\nM2\n"
USES: dict[str, Callable[[tn.Setup, Any], Any]] = {
    "volumetric_error": tn.volumetric_error,
    "error_fields": lambda s, e: list(tn.error_fields(s, e, points=(2, 2, 2))),
    "cnc_parameters": tn.cnc_parameters,
    "error_map": partial(tn.error_map, linear_step_mm=150.0, rotary_step_deg=90.0),
    "ModelCompensation": tn.ModelCompensation.of,
    "InverseCompensation": InverseCompensation.of,
    "residual_interval": partial(tn.residual_interval, draws=100),
    "volumetric_budget": volumetric_budget,
    "compensation_forecast": compensation_forecast,
    "remeasure": lambda s, e: tn.remeasure(tn.plan(s), s, None, e),
    "simulate": lambda s, e: tn.simulate(tn.plan(s), s, e),
    "MachineErrors": MachineErrors.of,
    "linuxcnc_files": controls.linuxcnc_files,
    "iso_table": controls.iso_table,
    "siemens_files": controls.siemens_files,
    "heidenhain_files": controls.heidenhain_files,
    "isg_files": partial(
        controls.isg_files, stated={"angle_unit": "rad", "sign": "1", "chain": "XYZCA"}
    ),
    "twincat_files": controls.twincat_files,
    "inverse_compensation": lambda s, e: compensation.inverse_compensation(
        s, e, np.zeros((1, 3)), {"A": [20.0], "C": [0.0]}
    ),
    "correct_program": lambda s, e: correct_program(
        s, e, "G21 G90 G94 F100\nG0 X0 Y0 Z0 A0 C0\nG1 X1\nM2\n"
    ),
}
"""What takes an estimate together with a set-up."""
COMPENSATE = [
    *("cnc_parameters", "error_map", "ModelCompensation", "InverseCompensation"),
    *("inverse_compensation", "compensation_forecast", "correct_program", "linuxcnc_files"),
    *("iso_table", "siemens_files", "heidenhain_files", "isg_files", "twincat_files"),
]
STATED = ("siemens_files", "heidenhain_files", "twincat_files")
"""These ask for more that must be stated, once the errors are taken."""


@pytest.mark.parametrize("made", MADE)
def test_an_estimate_carries_the_axes_that_it_was_made_with(made: str) -> None:
    estimate = MADE[made]()
    assert estimate.geometry == Geometry.of(SETUP)
    again = stored(estimate)
    assert again.geometry == estimate.geometry
    with pytest.raises(tn.DataError, match=OTHER_POINT):
        tn.volumetric_error(points(), estimate)


@pytest.mark.parametrize("kind", SAMPLES)
def test_every_kind_with_location_errors_carries_the_axes(kind: str) -> None:
    model, file = diagnosis_of(kind).model, SAMPLES[kind][1]
    assert (model.geometry is None) == (not model.errors)
    if model.errors:
        assert file is not None
        assert model.geometry == Geometry.of(tn.read_setup(tn.sample_path(file)))


def test_the_centre_of_an_axis_log_refers_to_the_axes_of_its_set_up() -> None:
    setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    model = tn.AxisLogModel(tn.read_axis_log(tn.sample_path("contour/axislog.csv"))[:400], setup)
    found = model.extended(np.zeros(0), {"rotary_centre": {"EX0C_um": 5.0}})
    assert found.errors == {"EX0C": 5.0}
    assert found.geometry == Geometry.of(setup)
    assert model.extended(np.zeros(0), {}).geometry is None


@pytest.mark.parametrize("use", USES)
def test_what_takes_an_estimate_refuses_a_set_up_with_other_axes(use: str) -> None:
    estimate = tn.identify(touches(), SETUP)
    if use not in STATED:
        USES[use](SETUP, estimate)
    with pytest.raises(tn.DataError, match=OTHER_POINT):
        USES[use](points(), estimate)
    plain = estimate.errors  # names with values are meant for whatever they are given with
    if use not in ("residual_interval", "volumetric_budget", *STATED):
        USES[use](points(), plain)


def test_errors_that_were_sorted_keep_their_axes_and_frame() -> None:
    known = MachineErrors.of(SETUP, tn.identify(in_frame(control_corrected=1), SETUP))
    for kept in (known, known.only(())):
        with pytest.raises(tn.DataError, match=r"^axes.A.point_mm"):
            tn.volumetric_error(points(), kept)
        with pytest.raises(tn.DataError, match="corrections were on"):
            tn.cnc_parameters(SETUP, kept)


OTHERS: dict[str, dict[str, Any]] = {
    "machine.preset": {"machine": tn.Machine("trt-bc"), "axes": {}},
    "machine.chain": {"machine": tn.Machine(chain="[w C' B' b X Y Z (C) t]"), "axes": {}},
    "axes.A.direction": {"axes": AXES | {"A": replace(AXES["A"], direction=(1.0, 0.01, 0.0))}},
    "axes.A.point_mm": {"axes": AXES | {"A": tn.AxisSetup(point_mm=(0.0, 0.0, -50.001))}},
    "axes.C.sense": {"axes": AXES | {"C": tn.AxisSetup(sense=-1)}},
}


@pytest.mark.parametrize("key", OTHERS)
def test_the_message_names_the_key_that_differs(key: str) -> None:
    with pytest.raises(tn.DataError) as error:
        Geometry.of(SETUP).refuse_other(replace(SETUP, **OTHERS[key]))
    text = str(error.value)
    assert text.startswith(f"{key}: got ")
    assert "with which the errors were identified" in text


SAME: dict[str, dict[str, Any]] = {
    "another point of the axis": {"axes": {"A": tn.AxisSetup(point_mm=(80.0, 0.0, -50.0))}},
    "another length of its direction": {
        "axes": {"A": replace(AXES["A"], direction=(3.0, 0.0, 0.0))}
    },
    "the chain of the preset": {"machine": tn.Machine(chain="[w C' A' b X Y Z (C) t]")},
    "errors known beforehand": {"machine": tn.Machine(errors={"EX0C": 9.0, "EB0A": 4.0})},
    "tolerances": {"machine": tn.Machine(tolerance={"EX0C": 9.0})},
    "probe": {"probe": tn.Probe(ball_radius_mm=2.0, length_mm=90.0)},
    "artefact": {"artefact": tn.Artefact("none")},
    "sense of a linear axis": {"axes": AXES | {"X": tn.AxisSetup(sense=-1)}},
    "ranges": {"axes": AXES | {"A": replace(AXES["A"], range_deg=(-100.0, 100.0))}},
}


@pytest.mark.parametrize("what", SAME)
def test_what_location_errors_do_not_refer_to_may_differ(what: str) -> None:
    """And leaves the volumetric error as it is: totals include what was known beforehand."""
    estimate, other = tn.identify(touches(), SETUP), replace(SETUP, **SAME[what])
    one, two = (
        tn.volumetric_error(s, estimate, a_deg=(45.0,), c_deg=(30.0,)).max_um
        for s in (SETUP, other)
    )
    assert one == pytest.approx(two, rel=1e-12)


def test_a_geometry_without_a_point_of_an_axis_is_none(tmp_path: Path) -> None:
    held = json.loads(tn.identify(touches(), SETUP).to_json())
    assert held["geometry"]["senses"] == {"A": 1, "C": 1}
    held["geometry"]["points_mm"] = {}
    file = tmp_path / "estimate.json"
    file.write_text(json.dumps(held))
    with pytest.raises(tn.FileFormatError, match=r"points_mm: got axes none, expected A, C"):
        tn.read_estimate(file)


def test_points_of_a_head_count_from_its_pivot() -> None:
    """A set-up with another probe is that of the same head."""

    def head(length_mm: float, y_mm: float = 0.0, x_mm: float = 0.0) -> tn.Setup:
        at = tn.AxisSetup(point_mm=(x_mm, y_mm, length_mm))
        probe = tn.Probe(length_mm=length_mm)
        return tn.Setup(
            tn.Artefact("cross"), tn.Machine("table-c-head-b"), axes={"B": at}, probe=probe
        )

    geometry = Geometry.of(head(100.0))
    for same in (head(180.0), head(100.0, y_mm=30.0), replace(head(180.0), axes={})):
        geometry.refuse_other(same)
        made = tn.volumetric_error(head(100.0), {"EA0B": 20.0}, b_deg=(30.0,)).max_um
    moved = tn.volumetric_error(head(100.0, y_mm=30.0), {"EA0B": 20.0}, b_deg=(30.0,)).max_um
    assert moved == pytest.approx(made, rel=1e-12)
    with pytest.raises(tn.DataError, match=r"^axes.B.point_mm"):
        geometry.refuse_other(head(100.0, x_mm=5.0))


def test_an_estimate_without_axes_is_taken_as_before(tmp_path: Path) -> None:
    """Names with values, and what earlier versions wrote."""
    estimate = tn.identify(touches(), SETUP)
    old = json.loads(estimate.to_json())
    for name in ("geometry", "control_frame"):
        del old[name]
    path = tmp_path / "old.json"
    path.write_text(json.dumps(old))
    for known in (tn.read_estimate(path), tn.Estimate(errors=estimate.errors)):
        assert known.geometry is None
        assert known.control_frame is None
        tn.volumetric_error(points(), known)


def test_measurements_of_several_kinds_carry_the_axes_of_their_set_up() -> None:
    found = tn.diagnose([touches(), in_frame(control_corrected=0)], SETUP).model
    assert found.geometry == Geometry.of(SETUP)
    assert found.control_frame is not None
    assert found.control_frame.corrected is False


def test_estimates_of_other_axes_are_not_compared() -> None:
    of_points = tn.simulate(tn.plan(points()), points(), ERRORS, noise_um=0.2, seed=5)
    one, two = tn.identify(touches(), SETUP), tn.identify(of_points, points())
    tn.compare(one, one)
    with pytest.raises(tn.DataError, match=r"^axes.A.point_mm: got \[0, 0, 0\] with measurement 2"):
        tn.compare(one, two)


# --- the frame of the control


def in_frame(**columns: float) -> tn.Touches:
    """Touches with the frame of a control, that of the set-up unless said."""
    x, y, z = CENTRE
    frame = {"wcs_x_mm": x, "wcs_y_mm": y, "wcs_z_mm": z, "wcs_a_deg": 0.0, "wcs_c_deg": 0.0}
    frame |= {"tool_length_mm": 100.0, "control_corrected": 0} | columns
    count = len(touches())
    return touches().with_columns(**{k: np.full(count, v) for k, v in frame.items()})


BAD_FRAMES: dict[str, tuple[dict[str, float], tuple[str, ...]]] = {
    "corrections": (
        {"control_corrected": 1},
        ("the control's corrections were on", "measure without corrections"),
    ),
    "shift of A": ({"wcs_a_deg": 0.137}, ("shifts A by 0.137 deg", "HOME_OFFSET")),
    "shift of C": ({"wcs_c_deg": -1.5}, ("shifts C by -1.5 deg", "measure again")),
    "work offset": (
        {"wcs_x_mm": 210.9},
        ("210.9, 148.2, -301", "control.centre_mm = [210.5, 148.2, -301]", "state centre_mm"),
    ),
}


@pytest.mark.parametrize("use", COMPENSATE)
@pytest.mark.parametrize("case", BAD_FRAMES)
def test_a_compensation_refuses_a_frame_that_does_not_fit(case: str, use: str) -> None:
    columns, says = BAD_FRAMES[case]
    if use not in STATED:
        USES[use](SETUP, tn.identify(in_frame(), SETUP))
    with pytest.raises(tn.DataError) as error:
        USES[use](SETUP, tn.identify(in_frame(**columns), SETUP))
    for said in says:
        assert said in str(error.value)


@pytest.mark.parametrize("made", [name for name in MADE if name != "R-test"])
def test_every_estimate_of_touches_carries_the_frame(
    made: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    shifted = in_frame(wcs_a_deg=0.2)
    monkeypatch.setitem(globals(), "touches", lambda: shifted)
    estimate = MADE[made]()
    assert estimate.control_frame == shifted.control_frame
    again = tn.Estimate.from_dict(
        {
            k: v
            for k, v in json.loads(estimate.to_json()).items()
            if k in ("errors", "control_frame")
        }
    )
    assert again.control_frame == shifted.control_frame


def test_what_is_left_is_no_compensation() -> None:
    """The errors that corrections leave may be looked at, and simulated."""
    left = tn.identify(in_frame(control_corrected=1), SETUP)
    assert tn.volumetric_error(SETUP, left).max_um > 0
    assert tn.simulate(in_frame(control_corrected=1), SETUP, left).control_frame is None


@pytest.mark.parametrize("made", [name for name in MADE if name not in ("R-test", "casadi")])
def test_errors_that_corrections_leave_are_said_to_be_that(
    made: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    says = "control_corrected is 1: these touches were made with the control's corrections on."
    for on in (0, 1):
        given = in_frame(control_corrected=on)
        monkeypatch.setitem(globals(), "touches", lambda given=given: given)
        found = tn.diagnose(given, SETUP) if made == "diagnosis" else MADE[made]()
        assert any(note.startswith(says) for note in found.notes) is bool(on)
        assert (says in found.summary().replace("\n", " ")) is bool(on)


def test_all_that_keeps_an_estimate_from_being_compensated_is_said_at_once() -> None:
    estimate = tn.identify(in_frame(wcs_x_mm=210.9, wcs_a_deg=0.2, control_corrected=1), SETUP)
    with pytest.raises(tn.DataError, match=r"centre_mm.* Also: .*shifts A .* Also: .*corrections"):
        MachineErrors.to_compensate(SETUP, estimate)


@pytest.mark.parametrize(
    ("frame", "says"),
    [
        ([], r"got \[\], expected the fields of ControlFrame @ \$.control_frame"),
        ("", "got '', expected the fields of ControlFrame"),
        ({"corrected": "no"}, r"got 'no', expected true or false @ \$.control_frame.corrected"),
        ({"corrected": 0}, r"got 0, expected true or false @ \$.control_frame.corrected"),
    ],
)
def test_a_stored_frame_that_is_none_is_refused(frame: object, says: str, tmp_path: Path) -> None:
    """The empty list was read as a frame that says nothing, and "no" as true."""
    path = tmp_path / "stored.json"
    path.write_text(json.dumps({"errors": ERRORS, "control_frame": frame}))
    with pytest.raises(tn.FileFormatError, match=says) as error:
        tn.read_estimate(path)
    assert str(path) in str(error.value)


def test_the_frame_comes_from_the_log_and_stays_in_the_file(tmp_path: Path) -> None:
    from trunnion.data.linuxcnc_log import probe_log_of

    plan = tn.plan(SETUP)
    head, *lines = probe_log_of(plan, touches(), "plan").splitlines()
    state = "; G55 210.5 148.2 -301 tool length 100.25 A 0.137 C 0.0 corrected"
    (tmp_path / "touches.log").write_text("\n".join([head, state, *lines]) + "\n")
    plan.to_csv(tmp_path / "plan.csv")
    (tmp_path / "setup.toml").write_text(SETUP.to_toml())
    files = [str(tmp_path / name) for name in ("plan.csv", "touches.log", "setup.toml")]
    run("touches", *files, "-o", str(tmp_path / "m.csv"))
    frame = tn.read_touches(tmp_path / "m.csv").control_frame
    assert frame is not None
    assert frame.place_mm == CENTRE
    assert frame.turned_deg == {"A": 0.137, "C": 0.0}
    assert frame.tool_length_mm == 100.25
    assert frame.corrected is True


def test_touches_that_follow_have_the_frame_of_those_before() -> None:
    first = in_frame()
    count = len(first)
    time = np.arange(count, dtype=float)
    first = first.with_columns(time_s=time)
    later = first.with_columns(time_s=time + count)
    assert first.followed_by(later).control_frame == first.control_frame
    for name, value in (("wcs_x_mm", 210.9), ("tool_length_mm", 101.0), ("control_corrected", 1)):
        with pytest.raises(tn.InputError, match=rf"^{name}: got {value:g} in the touches that fol"):
            first.followed_by(later.with_columns(**{name: np.full(count, value)}))


def test_a_frame_that_only_one_part_says_is_given_to_no_other(tmp_path: Path) -> None:
    """Rows of a file without a frame were written with that of a log, corrections and all."""
    time = np.arange(len(touches()), dtype=float)
    for one, other, which in (
        (touches(), in_frame(control_corrected=1), "before"),
        (in_frame(control_corrected=1), touches(), "that follow"),
    ):
        first, later = one.with_columns(time_s=time), other.with_columns(time_s=time + len(time))
        with pytest.raises(tn.InputError, match=rf"^wcs_x_mm: got none in the touches {which}, "):
            first.followed_by(later)
        first.to_csv(tmp_path / "first.csv")
        later.to_csv(tmp_path / "later.csv")
        files = [tn.read_touches(tmp_path / f"{name}.csv") for name in ("first", "later")]
        lacking = "first" if which == "before" else "later"
        with pytest.raises(tn.InputError, match=rf"{which} \({lacking}\.csv\), expected"):
            files[0].followed_by(files[1])
    length = in_frame().with_columns(tool_length_mm=None, time_s=time + len(time))
    with pytest.raises(
        tn.InputError, match=r"^tool_length_mm: got none .*add tool_length_mm there"
    ):
        in_frame().with_columns(time_s=time).followed_by(length)
    both = in_frame(control_corrected=1).with_columns(time_s=time)
    plain = touches().with_columns(time_s=time + len(time))
    assert both.with_columns(**dict.fromkeys(COLUMNS)).followed_by(plain).control_frame is None


def test_further_touches_are_planned_for_touches_with_a_frame() -> None:
    """A plan says no frame; which touches are chosen does not depend on that of the control."""
    plain, framed = (tn.diagnose(one, SETUP) for one in (touches(), in_frame()))
    chosen = [tn.next_touches(d, 4) for d in (plain, framed)]
    for column in ("x_mm", "y_mm", "z_mm", "a_deg", "c_deg"):
        assert np.array_equal(chosen[0][column], chosen[1][column])
    asked = [
        [(test.label, test.minutes, test.chance) for test in tn.next_measurement(d, SETUP)]
        for d in (plain, framed)
    ]
    assert asked[0] == asked[1]


def test_one_file_has_one_frame() -> None:
    mixed = np.zeros(len(touches()), dtype=int)
    mixed[5] = 1
    with pytest.raises(tn.InputError, match=r"^control_corrected \(row 5\): got 1, expected 0 "):
        touches().with_columns(control_corrected=mixed)


@pytest.mark.parametrize("name", ["wcs_x_mm", "wcs_c_deg", "control_corrected"])
def test_touches_of_two_frames_share_no_location_errors(name: str) -> None:
    other = in_frame(**{name: {"wcs_x_mm": 210.9, "wcs_c_deg": 0.5, "control_corrected": 1}[name]})
    with pytest.raises(tn.DataError, match=rf"^{name}: got .* in measurement 2, expected"):
        tn.diagnose([in_frame(), other], SETUP)


def test_another_tool_length_is_no_other_machine() -> None:
    """But what it makes of errors along the tool is said, by all that compares two."""
    other, said = in_frame(tool_length_mm=120.0), "tool_length_mm was 100 with the first measure"
    for found in (
        tn.diagnose([in_frame(), other], SETUP),
        tn.compare(in_frame(), other, setup=SETUP),
        tn.compare(tn.identify(in_frame(), SETUP), tn.identify(other, SETUP)),
    ):
        (note,) = (one for one in found.notes if "tool_length_mm" in one)
        assert note.startswith(f"{said}ment, 120 with measurement 2: ")
    same = tn.compare(in_frame(), touches(), in_frame(), setup=SETUP)
    assert not any("tool_length_mm" in one for one in same.notes)
    third = tn.compare(touches(), in_frame(), other, setup=SETUP)
    said = "tool_length_mm was 100 with measurement 2, 120 with measurement 3: "
    assert any(one.startswith(said) for one in third.notes)


def test_a_joint_diagnosis_says_whose_frame_is_not_known() -> None:
    """Its estimate has the frame of the others, and is refused where one of them hinders."""
    on = in_frame(control_corrected=1)
    found = tn.diagnose([touches(), on], SETUP)
    said = [one for one in found.notes if one.startswith("Measurement 1 does not say wcs_x_mm, ")]
    assert "what measurement 2 says of the control" in said[0]
    assert found.model.control_frame == on.control_frame
    part = on.with_columns(tool_length_mm=None)
    said = [one for one in tn.diagnose([on, part], SETUP).notes if "does not say" in one]
    assert [one.partition(":")[0] for one in said] == ["Measurement 2 does not say tool_length_mm"]
    for both in ([touches(), touches()[:-1]], [on, on[:-1]]):
        assert not any("does not say" in one for one in tn.diagnose(both, SETUP).notes)


def test_a_comparison_says_whose_frame_is_another() -> None:
    before, after = in_frame(), in_frame(control_corrected=1)
    for found in (
        tn.compare(before, after, setup=SETUP),
        tn.compare(tn.identify(before, SETUP), tn.identify(after, SETUP)),
    ):
        assert any("corrections make" in note for note in found.notes)
    shifted = tn.compare(before, in_frame(wcs_y_mm=148.9), setup=SETUP)
    assert any(note.startswith("wcs_y_mm was 148.2 with the first") for note in shifted.notes)


def test_all_that_differs_between_two_frames_is_said() -> None:
    """By all that compares two measurements, with the digits in which work offsets differ."""
    first, moved = in_frame(), {"wcs_x_mm": CENTRE[0] + 0.0002, "wcs_a_deg": 0.5}
    other = in_frame(**moved, control_corrected=1)
    after = other.with_columns(time_s=other["time_s"] + 1e6)
    said = (
        r"^wcs_x_mm: got 210\.5002 .*, expected 210\.5 as in .*; wcs_a_deg: got 0\.5, expected 0; "
        "control_corrected: got 1, expected 0: "
    )
    with pytest.raises(tn.InputError, match=said):
        first.followed_by(after)
    with pytest.raises(tn.DataError, match=said):
        tn.diagnose([first, other], SETUP)
    notes = tn.compare(first, other, setup=SETUP).notes
    assert sum("changes are those that the control's corrections make" in one for one in notes) == 1
    (frame,) = (one for one in notes if "about the axes of the work offset" in one)
    assert frame.startswith("wcs_x_mm was 210.5 with the first measurement, 210.5002 with measure")
    assert "; wcs_a_deg was 0, then 0.5: " in frame


def test_the_command_refuses_what_does_not_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """End to end: the fresh user's two findings."""
    monkeypatch.chdir(tmp_path)
    in_frame(control_corrected=1).to_csv("on.csv")
    in_frame().to_csv("off.csv")
    Path("setup.toml").write_text(SETUP.to_toml())
    Path("other.toml").write_text(points().to_toml())
    for name in ("on", "off"):
        run("estimate", f"{name}.csv", "setup.toml", "-o", f"{name}.json")
    for errors, setup, says in (
        ("off.json", "other.toml", "axes.A.point_mm: got [0, 0, 0] in other.toml, expected [0, 0,"),
        ("on.json", "setup.toml", "the control's corrections were on"),
    ):
        for control in ((), ("--control", "linuxcnc")):
            assert says in run("compensate", errors, setup, *control, code=2)
            assert not Path("compensation").exists()
    run("view", "on.json", "setup.toml", "-o", "left.html")  # what corrections leave may be seen
    run("compensate", "off.json", "setup.toml", "--control", "linuxcnc")
    assert Path("compensation/trunnion.hal").exists()


def test_an_origin_is_said_with_as_many_digits_as_tell() -> None:
    """A metre and a tenth of a micrometre: what is said is taken when it is stated."""
    frame = tn.identify(in_frame(wcs_x_mm=1210.1234, wcs_y_mm=1.0, wcs_z_mm=2.0), SETUP)
    with pytest.raises(tn.DataError, match=r"state centre_mm = \[1210.1234, 1, 2\]"):
        MachineErrors.to_compensate(SETUP, frame)
    control = replace(SETUP.control, centre_mm=(1210.1234, 1.0, 2.0))
    MachineErrors.to_compensate(replace(SETUP, control=control), frame)


@pytest.mark.parametrize("kind", ["positioning", "levels", "sweep"])
def test_an_estimate_with_nothing_to_compensate_is_refused(kind: str) -> None:
    model = diagnosis_of(kind).model
    assert isinstance(model, tn.Estimate)
    with pytest.raises(tn.DataError, match="a compensation by it would change nothing"):
        MachineErrors.to_compensate(SETUP, model)


def test_measurements_before_and_after_corrections_are_not_swapped() -> None:
    ball = tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(60.0, 20.0, 60.0))
    setup = tn.Setup(ball)
    plan = tn.plan(setup, c_deg=(0, 120, 240), a_deg=(30, -40))
    free = tn.simulate(plan, setup, ERRORS, noise_um=0.2, seed=4)
    on, off = (free.with_columns(control_corrected=[v] * len(free)) for v in (1, 0))
    tn.verify_ball(on, setup, before=off, draws=200)
    with pytest.raises(tn.DataError, match="were the two files swapped"):
        tn.verify_ball(off, setup, before=on, draws=200)

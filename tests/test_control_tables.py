"""Files for other controls, read back and applied by controls of the tests' own."""

import dataclasses
from itertools import product
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from control_readers import (
    CENTRE,
    Control,
    Heidenhain,
    Isg,
    RealMachine,
    Siemens,
    TwinCat,
    etalon,
    isg_csv,
    left_um,
    nominal_point,
    ssfk,
)
from reference_trt_ca import TABLE_2
from trunnion.controls import (
    ControlFiles,
    heidenhain_files,
    isg_files,
    siemens_files,
    twincat_files,
)
from trunnion.setup.control import ControlSetup

SENSE_A = -1
SETUP = tn.Setup(
    artefact=tn.Artefact("none"),
    axes={
        "X": tn.AxisSetup(range_mm=(-200, 200)),
        "Y": tn.AxisSetup(range_mm=(-250, 250)),
        "Z": tn.AxisSetup(range_mm=(-250, 250)),
        "C": tn.AxisSetup(range_deg=(-180, 180)),
        "A": tn.AxisSetup(range_deg=(-90, 30), sense=SENSE_A),
    },
    control=ControlSetup(centre_mm=(210.5, 148.2, -301.0)),
)
HELD = {
    "scale_x": {"ppm": 55.0},
    "scale_z": {"ppm": -40.0},
    "c_positioning": {"a1_arcsec": 20.0, "b1_arcsec": -12.0},
    "c_positioning_2": {"a2_arcsec": 3.0, "b2_arcsec": 8.0},
    "a_scale": {"k_arcsec": 15.0},
    "backlash_x": {"b_um": 6.0},
    "c_backlash": {"b_arcsec": 30.0},
}
SQUARE = {
    "squareness_xy": {"arcsec": 14.0},
    "squareness_xz": {"arcsec": -9.0},
    "squareness_yz": {"arcsec": 11.0},
}
WOBBLE = {"c_wobble_2": {"ax_arcsec": 9.0, "bx_arcsec": 0.0, "ay_arcsec": 0.0, "by_arcsec": 0.0}}
# The poses of the forecast: its ranges in the same steps.
POSES = list(product(np.linspace(-90, 30, 13), np.linspace(-180, 180, 19)))


def machine(*, square: bool = True, wobble: bool = True, **more: Any) -> RealMachine:
    values: dict[str, Any] = {
        "errors": TABLE_2,
        "scale": (55.0, 0.0, -40.0),
        "squareness": (14.0, -9.0, 11.0) if square else (0.0, 0.0, 0.0),
        "waves_c": (20.0, -12.0, 3.0, 8.0),
        "wobble_c": 9.0 if wobble else 0.0,
        "scale_a": 15.0,
        "backlash": {"X": 6.0, "C": 30.0},
        "sense_a": SENSE_A,
    }
    return RealMachine(**values | more)


def estimate(*, square: bool = True, wobble: bool = True) -> tn.Estimate:
    effects = HELD | (SQUARE if square else {}) | (WOBBLE if wobble else {})
    return tn.Estimate(errors=dict(TABLE_2), effects=effects)


def between(files: ControlFiles) -> float:
    """What tables may leave on top, µm: lengths as they are, angles at 240 mm."""
    left = files.between_nodes or {}
    return sum(v if k[0] in "xyz" else v * 240e3 * np.pi / 648e3 for k, v in left.items())


def check_forecast(control: Control, files: ControlFiles, real: RealMachine) -> float:
    """Largest error left: the forecast's to 1 % and what tables leave between nodes; µm."""
    left = float(np.linalg.norm(left_um(control, real, POSES), axis=-1).max())
    assert abs(left - files.after_um) < 0.01 * files.after_um + between(files), (
        left, files.after_um, between(files),
    )  # fmt: skip
    return left


def check_reversal(control: Control, real: RealMachine) -> None:
    """Both senses of travel come to the same place: reversal is taken off."""
    ends = [
        real.reached(control.motors(np.array([120.0, -90.0, 60.0]), -40.0, 75.0, travel), travel)
        for travel in (1, -1)
    ]
    assert 1e3 * np.linalg.norm(ends[0] - ends[1]) < 0.25  # 30″ at 150 mm would be 22 µm, X 6 µm


@pytest.mark.parametrize(("vector_sign", "cec_sign"), [(1, 1), (-1, -1), (1, -1)])
@pytest.mark.parametrize("wobble", [False, True])
def test_siemens(vector_sign: int, cec_sign: int, wobble: bool) -> None:
    stated = {"vector_sign": str(vector_sign), "cec_sign": str(cec_sign)}
    files = siemens_files(SETUP, estimate(wobble=wobble), stated=stated)
    control = Siemens.read(files.files, vector_sign, cec_sign)
    left = check_forecast(control, files, machine(wobble=wobble))
    assert (left > 3) == wobble
    assert files.before_um > 60
    check_reversal(control, machine())
    assert ("c_wobble_2 (Siemens 840D has no place for it)" in files.left_out) == wobble
    if cec_sign != vector_sign:  # a wrong sign does not pass for a right one
        wrong = Siemens.read(files.files, -vector_sign, cec_sign)
        assert np.abs(left_um(wrong, machine(), POSES[:40])).max() > 1000


def test_siemens_alone_by_location_errors_needs_no_sag_sign() -> None:
    files = siemens_files(SETUP, TABLE_2, stated={"vector_sign": "1"})
    assert set(files.files) == {
        "tc_carr.spf", "kinematic_chain.csv", "frame.spf", "settings.csv"
    }  # fmt: skip
    control = Siemens.read(files.files, 1, 1)
    real = RealMachine(TABLE_2, sense_a=SENSE_A)
    assert np.abs(left_um(control, real, POSES)).max() < 1e-3


@pytest.mark.parametrize(("chain_sign", "com_sign"), [(1, 1), (-1, -1), (-1, 1)])
def test_heidenhain(chain_sign: int, com_sign: int) -> None:
    stated = {"chain_sign": str(chain_sign), "com_sign": str(com_sign)}
    files = heidenhain_files(SETUP, estimate(), stated=stated)
    control = Heidenhain.read(files.files, chain_sign, com_sign)
    assert check_forecast(control, files, machine()) > 3
    check_reversal(control, machine())
    assert "NR X Y Z A C ACTIVE" not in files.files["config.cma"]  # Y has no error of its own ...
    assert "NR X Z A C Y ACTIVE" in files.files["config.cma"]  # ... and displaces X


@pytest.mark.parametrize("layout", ["ISG_CSV", "etalon"])
@pytest.mark.parametrize(("unit", "sign"), [("rad", 1), ("deg", -1)])
def test_isg(layout: Any, unit: str, sign: int) -> None:
    stated = {"angle_unit": unit, "sign": str(sign), "chain": "CAXYZ"}
    files = isg_files(SETUP, estimate(), layout=layout, stated=stated)
    read = isg_csv if layout == "ISG_CSV" else etalon
    text = files.files["location.csv" if layout == "ISG_CSV" else "location.txt"]
    control = Isg(read(text), sign, 1.0 if unit == "rad" else np.pi / 180, screws_of(files))
    assert check_forecast(control, files, machine()) > 3
    check_reversal(control, machine())
    assert f"angle_unit = {unit}" in text
    assert "Chain                    CAXYZ" in files.files["volcomp.lis"]


def screws_of(files: ControlFiles, sense_a: int = SENSE_A, sense_c: int = 1) -> TwinCat:
    tables: dict[int, Any] = {}
    for name, text in files.files.items():
        if name.startswith("axis_"):
            tables |= ssfk(text)
    return TwinCat(tables, sense_a, sense_c)


@pytest.mark.parametrize("senses", [(-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1), (-1, -1, -1)])
@pytest.mark.parametrize("name", ["siemens", "heidenhain", "isg", "twincat"])
def test_axes_that_the_control_counts_the_other_way(
    name: str, senses: tuple[int, int, int]
) -> None:
    """What is written is in the control's own coordinates, left-handed ones, too.

    There an axis turns about +X (+Z) as the machine's does about -X where X (Z) alone counts the
    other way, and so on.
    """
    axes = {
        letter: tn.AxisSetup(range_mm=(-200.0, 400.0), sense=sense)
        for letter, sense in zip("XYZ", senses, strict=True)
    }
    setup = dataclasses.replace(SETUP, axes={**SETUP.axes, **axes})
    square = name != "twincat"
    what = estimate(square=square)
    a, c = (int(np.prod(senses)) * senses[i] for i in (0, 2))
    control: Control
    if name == "siemens":
        files = siemens_files(setup, what, stated={"vector_sign": "1", "cec_sign": "1"})
        control = Siemens.read(files.files, 1, 1)
    elif name == "heidenhain":
        files = heidenhain_files(setup, what, stated={"chain_sign": "1", "com_sign": "1"})
        control = Heidenhain.read(files.files, 1, 1)
    elif name == "isg":
        stated = {"angle_unit": "rad", "sign": "1", "chain": "CAXYZ"}
        files = isg_files(setup, what, stated=stated)
        errors = isg_csv(files.files["location.csv"])
        control = Isg(errors, 1, 1.0, screws_of(files, a * SENSE_A, c))
    else:
        files = twincat_files(setup, what)
        control = screws_of(files, a * SENSE_A, c)
        nodes = {number: rows[0] for number, rows in ssfk(files.files["axis_x.lis"]).items()}[1]
        low, high = sorted(CENTRE[0] + senses[0] * np.array([-200.0, 400.0]))
        assert nodes[0] <= low < nodes[1]
        assert nodes[-2] < high <= nodes[-1]
    real = machine(square=square, senses=senses)
    check_forecast(control, files, real)
    check_reversal(control, real)


def test_twincat_tables_leave_the_location_errors() -> None:
    files = twincat_files(SETUP, estimate(square=False, wobble=False))
    control = screws_of(files)
    left = check_forecast(control, files, machine(square=False, wobble=False))
    assert left > 40  # those of Table 2 have no place in tables of axes
    check_reversal(control, machine(square=False, wobble=False))
    assert sum("no place for location errors" in text for text in files.left_out) == len(TABLE_2)
    # Without location errors, only what lies between nodes and below 0.1 µm, 0.0001° is left.
    plain = tn.Estimate(errors=dict.fromkeys(TABLE_2, 0.0), effects=HELD)
    files = twincat_files(SETUP, plain)
    real = machine(errors={}, square=False, wobble=False)
    left = float(np.linalg.norm(left_um(screws_of(files), real, POSES), axis=-1).max())
    assert left < between(files) + 0.01
    assert files.after_um < 1e-3


def test_what_is_not_documented_is_asked_for() -> None:
    for write, asked in (
        (isg_files, "angle_unit"), (siemens_files, "vector_sign"), (heidenhain_files, "chain_sign"),
    ):  # fmt: skip
        with pytest.raises(tn.InputError, match=rf"got no {asked}, expected what the public"):
            write(SETUP, estimate())
    with pytest.raises(tn.UnknownNameError, match="vector_sign: got '2', expected one of 1, -1"):
        siemens_files(SETUP, TABLE_2, stated={"vector_sign": "2"})
    with pytest.raises(tn.UnknownNameError, match="did you mean vector_sign"):
        siemens_files(SETUP, TABLE_2, stated={"vector_signs": "1"})


def test_tables_have_round_nodes_and_say_their_range() -> None:
    files = twincat_files(SETUP, estimate())
    nodes, _, _ = ssfk(files.files["axis_x.lis"])[1]
    np.testing.assert_allclose(nodes % 50, 0, atol=1e-9)
    assert nodes[0] <= CENTRE[0] - 200 < nodes[1]
    assert nodes[-2] < CENTRE[0] + 200 <= nodes[-1]
    row = next(one for one in files.settings if one.name == "x")
    assert row.holds == "X 0 to 450 mm"
    assert "X 0 to 450 mm" in files.files["settings.csv"]
    bare = tn.Setup(artefact=SETUP.artefact, control=SETUP.control)
    left = twincat_files(bare, estimate()).left_out
    assert "scale_x (its table needs [axes.X] range_mm, or --range)" in left


def test_the_readers_move_a_machine_without_errors_right() -> None:
    """The test's own machine and control agree where nothing is wrong."""
    real = RealMachine({}, sense_a=SENSE_A)
    control = TwinCat({}, SENSE_A)
    assert np.abs(left_um(control, real, POSES)).max() < 1e-9
    assert nominal_point(np.zeros(3), 20, 30, SENSE_A) == pytest.approx(CENTRE)

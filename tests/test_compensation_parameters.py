"""CNC parameters and exact inverse: what they remove, what they cannot, singular poses."""

import numpy as np
import pytest

import trunnion as tn
from reference_trt_ca import NAMES, TABLE_2, displaced_um, shift, table_pose, turn
from trunnion.setup.machines import presets

SETUP = tn.Setup(artefact=tn.Artefact("cross"))
A, C = tuple(range(-90, 91, 30)), tuple(range(0, 360, 30))


def test_printed_equations_at_a_zero() -> None:
    """Item 7 of the notes: C = ±49°, and no turn of C rights what lies in front of it."""
    printed = tn.printed_zeros(TABLE_2)
    assert not printed.singular
    assert printed.a_deg[0] * 3600 == pytest.approx(np.hypot(21.6, 25.2), abs=0.01)
    assert min(abs(c) for c in printed.c_deg) == pytest.approx(49.4, abs=0.1)
    # The normal is the machine's Z in the frame of the erroneous table.
    euler = turn("x", 21.6 * np.pi / 648000) @ turn("y", 25.2 * np.pi / 648000)
    euler = (euler @ turn("z", 10.8 * np.pi / 648000))[:3, :3]
    np.testing.assert_allclose(printed.normal, euler[2], rtol=0, atol=1e-15)
    for branch in (0, 1):
        missed = printed.parameters(branch, turn_work=False)
        assert tn.volumetric_error(SETUP, TABLE_2, compensation=missed).max_um > 1e5


@pytest.mark.parametrize("yaw_arcsec", [0.0, 40.0])
def test_printed_method_is_judged_with_its_origin_offsets(yaw_arcsec: float) -> None:
    """What zeros and origin offsets leave, by matrices of the definitions; with E_CRS too."""
    d = np.array([30.0, -20.0, 5.0]) if yaw_arcsec else np.zeros(3)
    placement = {"dx_um": d[0], "dy_um": d[1], "dz_um": d[2], "rc_arcsec": yaw_arcsec}
    printed = tn.printed_zeros(TABLE_2, setup_yaw_arcsec=yaw_arcsec, placement=placement)
    origin = d + np.array([15.0, 21.0, 12.0])  # EX0C, EY0C, EZ0A of Table 2
    assert list(printed.work.values()) == pytest.approx(origin)
    box = np.array([[x, y, z, 1.0] for x in (-150, 150) for y in (-120, 120) for z in (0, 150)]).T
    placed = shift(*d * 1e-3) @ turn("z", yaw_arcsec * np.pi / 648000)
    before = tn.volumetric_error(SETUP, TABLE_2, placement=placement).max_um
    for branch, better in ((0, True), (1, False)):
        a, c = printed.a_deg[branch], printed.c_deg[branch]
        # The table stands at -A_Comp, -C_Comp; the control knows the turn of C and the origin.
        tool = shift(*origin * 1e-3) @ turn("z", -np.radians(c)) @ box
        on_work = np.linalg.solve(table_pose(TABLE_2, -a, -c) @ placed, tool)
        left = tn.volumetric_error(
            SETUP, TABLE_2, compensation=printed.parameters(branch), placement=placement
        ).max_um
        assert left == pytest.approx(1e3 * np.linalg.norm((on_work - box)[:3], axis=0).max())
        if not yaw_arcsec:
            assert (left < before) == better
            assert left == pytest.approx((34.44, 71.05)[branch], abs=0.01)  # independent numpy
        zeros = tn.volumetric_error(
            SETUP,
            TABLE_2,
            placement=placement,
            compensation=printed.parameters(branch, offsets=False),
        )
        assert abs(zeros.max_um - left) > 0.1


def test_printed_equations_without_a_tilt_are_undefined() -> None:
    printed = tn.printed_zeros({"EX0C": 10.0})
    assert printed.singular
    assert printed.a_deg[0] == printed.c_deg[0] == 0.0
    nearly = tn.printed_zeros({"EA0A": 1e-3, "EB0C": -1e-3})
    assert not nearly.singular
    # A hair of tilt, an eighth of a turn.
    assert min(abs(c) for c in nearly.c_deg) == pytest.approx(45.0, abs=0.1)


def test_parameters_at_one_pose_leave_what_the_notes_say() -> None:
    found = tn.cnc_parameters(SETUP, TABLE_2, a_deg=0, c_deg=0)
    left = tn.volumetric_error(SETUP, TABLE_2, compensation=found)
    # EB0C about the middle of the box: 25.2 arcsec × |(150, 75)| mm.
    assert left.max_um == pytest.approx(25.2 * np.pi / 648 * np.hypot(150, 75), abs=0.02)
    assert abs(found.zeros_arcsec["A"] + 21.6) < 0.02
    assert abs(found.zeros_arcsec["C"] + 10.8) < 0.02


def test_least_squares_is_a_minimum() -> None:
    found = tn.cnc_parameters(SETUP, TABLE_2, a_deg=A, c_deg=C)

    def rms(parameters: tn.CncParameters) -> float:
        # Nodes whose variance is that of the solid box: ±half/√3.
        root = 1 / np.sqrt(3)
        axes = {"x_mm": 150 * root, "y_mm": 120 * root, "z_mm": 75 * root}
        nodes = {k: np.array([-v, 0.0, v]) * np.sqrt(1.5) for k, v in axes.items()}
        nodes["z_mm"] = nodes["z_mm"] + 75
        return tn.volumetric_error(
            SETUP, TABLE_2, a_deg=A, c_deg=C, compensation=parameters, **nodes
        ).rms_um

    best = rms(found)
    for group, step in (("zeros_arcsec", 0.05), ("centres_um", 0.05)):
        values = getattr(found, group)
        for name in values:
            for sign in (-1, 1):
                moved = {
                    "zeros_arcsec": dict(found.zeros_arcsec),
                    "centres_um": dict(found.centres_um),
                }
                moved[group][name] += sign * step
                assert rms(tn.CncParameters(moved["zeros_arcsec"], moved["centres_um"])) > best


def test_what_parameters_can_and_cannot_remove() -> None:
    found = tn.cnc_parameters(SETUP, TABLE_2, a_deg=A, c_deg=C)
    left = {row.name: row.share_left for row in found.removable}
    assert set(left) == set(NAMES)
    for name in ("EA0A", "EX0C", "EY0A", "EZ0A", "EY0C"):
        assert left[name] < 1e-3
    for name in ("EB0A", "EC0A", "EB0C"):
        assert left[name] > 0.5
    # The derivatives agree with the exact model: one arcsec of EB0C, 0.1 µm off at most.
    row = next(row for row in found.removable if row.name == "EB0C")
    only = tn.cnc_parameters(SETUP, {"EB0C": 1.0}, a_deg=A, c_deg=C)
    rms = tn.volumetric_error(SETUP, {"EB0C": 1.0}, a_deg=A, c_deg=C, points=(61, 49, 31)).rms_um
    assert rms == pytest.approx(row.before_um, rel=0.03)
    after = tn.volumetric_error(
        SETUP, {"EB0C": 1.0}, a_deg=A, c_deg=C, points=(61, 49, 31), compensation=only
    ).rms_um
    assert after == pytest.approx(row.left_um, rel=0.03)
    assert "EB0C" in found.summary()


def test_removable_errors_are_removed_everywhere() -> None:
    errors = {k: v for k, v in TABLE_2.items() if k not in ("EB0A", "EC0A", "EB0C")}
    for method in ("least-squares", "direct"):
        found = tn.cnc_parameters(SETUP, errors, a_deg=A, c_deg=C, method=method)
        left = tn.volumetric_error(SETUP, errors, a_deg=A, c_deg=C, compensation=found)
        assert left.max_um < 0.01


def test_direct_parameters_stay_small_and_round() -> None:
    found = tn.cnc_parameters(SETUP, TABLE_2, method="direct")
    assert found.zeros_arcsec == pytest.approx({"A": -21.6, "C": -10.8}, abs=1e-6)
    rounded = found.rounded(SETUP)
    for value in rounded.zeros_arcsec.values():
        assert value / 0.36 == pytest.approx(round(value / 0.36), abs=1e-9)
    other = tn.Setup(artefact=tn.Artefact("cross"), axes={"A": tn.AxisSetup(sense=-1)})
    assert tn.cnc_parameters(other, TABLE_2, method="direct").zeros_arcsec["A"] == pytest.approx(
        21.6
    )


def test_placement_is_taken_up_by_the_work() -> None:
    placement = {"dx_um": 200.0, "dy_um": -50.0, "dz_um": 30.0, "rc_arcsec": 100.0}
    before = tn.volumetric_error(SETUP, {}, placement=placement, a_deg=A, c_deg=C)
    found = tn.cnc_parameters(
        SETUP, {}, placement=placement, a_deg=A, c_deg=C, groups=("zeros", "centres", "work")
    )
    left = tn.volumetric_error(SETUP, {}, placement=placement, a_deg=A, c_deg=C, compensation=found)
    assert before.max_um > 250
    assert left.max_um < 1e-3
    assert found.work["dx_um"] == pytest.approx(200.0, abs=0.2)


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc", "table-c-head-b"])
def test_all_axes_put_point_and_direction_right(preset: str) -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine(preset=preset))
    random = np.random.default_rng(8)
    letter = "A" if preset == "trt-ca" else "B"
    names = [n for n, _ in presets()[preset].core(150.0).location_errors]
    errors = {name: float(random.uniform(-60, 60)) for name in names}
    effects = {"c_positioning": {"a1_arcsec": 5.0, "b1_arcsec": 8.0}, "scale_z": {"ppm": 10.0}}
    points = random.uniform(-100, 100, (200, 3))
    tilt = random.uniform(5, 90, 200) * random.choice([-1, 1], 200)
    rotary = {letter: tilt, "C": random.uniform(-180, 360, 200)}
    made = tn.inverse_compensation(setup, errors, points, rotary, effects)
    assert made.singular is not None
    assert made.direction_left_arcsec is not None
    assert not made.singular.any()
    assert made.direction_left_arcsec.max() < 1e-6
    after = tn.volumetric_error(
        setup, errors, effects, compensation=tn.InverseCompensation.of(setup, errors, effects),
        a_deg=(-60, 45) if letter == "A" else 0, b_deg=(-60, 45) if letter == "B" else None,
        c_deg=(10, 200), points=(3, 3, 3),
    )  # fmt: skip
    assert after.max_um < 1e-6
    assert after.direction_by_pose_arcsec.max() < 1e-6


def test_commands_reach_the_point_by_the_contracts_model() -> None:
    points = np.array([[10.0, -50.0, 70.0], [0.0, 120.0, 3.0]])
    a, c = np.array([30.0, -75.0]), np.array([200.0, 10.0])
    made = tn.inverse_compensation(SETUP, TABLE_2, points, {"A": a, "C": c})
    for i in range(2):
        pose = table_pose(TABLE_2, made.rotary_deg["A"][i], made.rotary_deg["C"][i])
        np.testing.assert_allclose(
            (pose @ np.append(points[i], 1.0))[:3], made.linear_mm[i], rtol=0, atol=1e-11
        )
        meant = table_pose({}, a[i], c[i])[:3, :3].T[:, 2]
        np.testing.assert_allclose(pose[:3, :3].T[:, 2], meant, rtol=0, atol=1e-12)
    only = tn.inverse_compensation(SETUP, TABLE_2, points, {"A": a, "C": c}, axes="linear")
    moved = displaced_um(TABLE_2, points[:1], a[0], c[0])[0]
    plain = (table_pose({}, a[0], c[0]) @ np.append(points[0], 1.0))[:3]
    np.testing.assert_allclose(only.linear_mm[0], plain + 1e-3 * moved, rtol=0, atol=1e-11)


def test_singular_poses_get_an_answer_that_says_so() -> None:
    a = np.array([0.0, 1e-4, 0.005, 0.05, 0.4, 5.0, 90.0])
    made = tn.inverse_compensation(
        SETUP, TABLE_2, np.tile([50.0, 40.0, 30.0], (7, 1)), {"A": a, "C": 30.0}
    )
    assert made.singular is not None
    assert made.direction_left_arcsec is not None
    assert made.singular[:3].all()
    assert not made.singular[-2:].any()
    # At A = 0 the tilt of C about Y stays, whatever A does; the point is right all the same.
    assert made.direction_left_arcsec[0] == pytest.approx(25.2, abs=0.01)
    turned = np.abs(made.rotary_deg["C"] - 30.0)
    assert turned.max() <= 1.0
    free = tn.inverse_compensation(
        SETUP, TABLE_2, [[50.0, 40.0, 30.0]], {"A": 0.05, "C": 30.0}, largest_turn_deg=180
    )
    assert free.singular is not None
    assert free.direction_left_arcsec is not None
    assert not free.singular.any()
    assert free.direction_left_arcsec[0] < 1e-6
    # Near the pole an arcsec of tilt costs degrees of C.
    assert abs(free.rotary_deg["C"][0] - 30.0) > 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points_mm": [[0.0, 0.0]]}, "points_mm: got shape (1, 2)"),
        ({"rotary_deg": {"A": 0.0}}, "c_deg: got none, expected the position of rotary axis C"),
        ({"rotary_deg": {"A": [0.0, 1.0], "C": 0.0}}, "a_deg: got shape (2,)"),
        ({"rotary_deg": {"A": np.nan, "C": 0.0}}, "rotary_deg.A: got nan"),
        ({"axes": "some"}, "axes: got 'some'"),
        ({"largest_turn_deg": 0.0}, "largest_turn_deg: got 0.0"),
    ],
)
def test_bad_input(arguments: dict, message: str) -> None:  # type: ignore[type-arg]
    given = {"points_mm": [[0.0, 0.0, 0.0]], "rotary_deg": {"A": 0.0, "C": 0.0}} | arguments
    with pytest.raises(tn.TrunnionError) as error:
        tn.inverse_compensation(SETUP, TABLE_2, **given)
    assert message in str(error.value)


def test_unknown_method_and_group() -> None:
    with pytest.raises(tn.InputError, match="method: got 'magic'"):
        tn.cnc_parameters(SETUP, TABLE_2, method="magic")
    with pytest.raises(tn.UnknownNameError, match="groups: got 'speeds'"):
        tn.cnc_parameters(SETUP, TABLE_2, groups=("speeds",))

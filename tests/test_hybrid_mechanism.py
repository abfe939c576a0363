"""The hybrid mechanism as its users meet it: inverse, failures, set-up file, cube, command line."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app
from trunnion.hybrid import Mechanism, cube_study, transformed_cube

HOME = (0.0, -350.0, -1400.0)


def poses(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    legs = np.array([1100.0, 1130.0, 1100.0]) + rng.uniform(-60, 60, (count, 3))
    return np.column_stack([legs, rng.uniform(-90, 90, count), rng.uniform(-30, 30, count)])


def test_inverse_undoes_forward_on_both_branches() -> None:
    machine = Mechanism()
    joints = poses(30, 1)
    found = machine.forward(joints)
    for wrist in (1, -1):
        back = machine.inverse(found.tip_mm, found.direction, wrist=wrist)
        assert np.all(np.sign(back[:, 4]) == wrist)
        again = machine.forward(back)
        assert np.abs(again.tip_mm - found.tip_mm).max() < 1e-9
        assert np.abs(again.direction - found.direction).max() < 1e-12
        same = np.sign(joints[:, 4]) == wrist
        assert np.abs(back[same] - joints[same]).max() < 1e-8


def test_inverse_of_the_machine_with_errors_is_exact() -> None:
    machine = Mechanism(errors={"e5_um": 80.0, "e13": -50.0, "e17": 30.0, "base3_y_um": 20.0})
    points = np.array(HOME) + np.random.default_rng(2).uniform(-80, 80, (10, 3))
    tilted = np.array([0.1, 0.2, -np.sqrt(0.95)])
    joints = machine.inverse(points, tilted)
    found = machine.forward(joints)
    assert np.abs(found.tip_mm - points).max() < 1e-8
    assert np.abs(found.direction - tilted).max() < 1e-10
    assert np.abs(joints - machine.nominal.inverse(points, tilted)).max() > 1e-3


def test_rows_are_the_same_on_any_number_of_threads() -> None:
    machine, joints = Mechanism(), poses(200, 3)
    one, two = (machine.sensitivity(joints, threads=n) for n in (1, 2))
    assert np.array_equal(one.tip, two.tip)
    assert np.array_equal(one.passive, machine.sensitivity(joints, threads=None).passive)
    single = machine.sensitivity(joints[17])
    assert np.array_equal(single.tip[0], one.tip[17])


def test_what_cannot_be_reached_says_why() -> None:
    machine = Mechanism()
    with pytest.raises(tn.KinematicsError, match=r"row 1: .*out of reach"):
        machine.forward([[1100, 1150, 1100, 0, 0], [300, 2500, 300, 0, 0]])
    with pytest.raises(tn.InputError, match=r"row 0: leg length L1"):
        machine.forward([-5, 1150, 1100, 0, 0])
    with pytest.raises(tn.InputError, match="finite"):
        machine.forward([np.nan, 1150, 1100, 0, 0])
    with pytest.raises(tn.InputError, match=r"expected \(n, 5\)"):
        machine.forward([[1, 2, 3]])
    with pytest.raises(tn.KinematicsError, match="below the base"):
        machine.inverse([0, 0, 100.0])
    with pytest.raises(tn.InputError, match="length of the tool direction"):
        machine.inverse(HOME, (0, 0, -2))
    with pytest.raises(tn.InputError, match="wrist"):
        machine.inverse(HOME, wrist=0)


def test_poses_and_centres_that_cannot_be_are_refused() -> None:
    machine = Mechanism()
    pose = [1100.0, 1130.0, 1110.0, 20.0, 5.0]
    for centre in ((np.inf, 0, 0), (0, np.nan, 0), (0, 0), [[0, 0, 0]] * 3, "here"):
        with pytest.raises(tn.InputError, match="centres_mm"):
            machine.ballbar([pose, pose], centre)
    for joints in ("abc", [pose, pose[:3]], [[1j] * 5]):
        with pytest.raises(tn.InputError, match="joints"):
            machine.forward(joints)
    for question in (machine.constraint, lambda q: machine.closure_dependence(q, {"e4": 1.0})):
        with pytest.raises(tn.InputError, match=r"joints .*: got shape \(2, 5\)"):
            question([pose, pose])


def test_near_the_edge_of_reach_forward_fails_where_the_loops_become_singular() -> None:
    # Spread the legs until the loops cannot be closed: every pose up to there is solved, and on
    # the branch it came from, the pivot ratio falling towards zero.
    machine = Mechanism()
    last = None
    failure = ""
    for spread in np.arange(0, 800, 10.0):
        try:
            last = machine.forward([1100 + spread, 1150, 1100 - spread, 0, 0])
        except tn.KinematicsError as error:
            failure = str(error)
            break
    assert "out of reach" in failure or "branch" in failure
    assert last is not None
    assert last.pivot_ratio[0] < 0.15
    assert np.abs(last.misfit_arcsec).max() < 1e-6


def test_setup_table_and_its_errors(tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(
        "[hybrid]\ne8_mm = 550.0\ne15_mm = 300.0\nhome_mm = [0, -300, -1400]\n"
        "[hybrid.errors]\ne5_um = 12.0\nbase3_y_um = -3.0\n"
    )
    machine = Mechanism.from_setup(tn.read_setup(path))
    assert machine.errors == {"e5_um": 12.0, "base3_y_um": -3.0}
    assert machine.nominal.inverse(machine.home_mm)[0, :3] == pytest.approx(machine.home_legs_mm)
    again = pickle.loads(pickle.dumps(machine))
    assert again == machine
    assert np.array_equal(again.forward(poses(3, 4)).tip_mm, machine.forward(poses(3, 4)).tip_mm)
    for text, match in (
        ("e18_mm = 1.0", "e18_mm"),
        ("e8_mm = 'wide'", "expected a finite number"),
        ("home_mm = [0, 1]", "expected a list of 3 numbers"),
        ("errors = {e99_um = 1.0}", "e99"),
    ):
        path.write_text(f"[hybrid]\n{text}\n")
        with pytest.raises(tn.TrunnionError, match=match):
            Mechanism.from_setup(tn.read_setup(path))


def test_the_table_of_the_notes_for_the_transformed_cube() -> None:
    # Centre |dr| and largest edge change, µm; 10 µm or 10", cube of 200 mm, tool vertical. The
    # table is of first order, ours exact: 1e-3 µm apart.
    expected = {
        "e1": (26.079, 0.936),
        "e2": (46.458, 3.182),
        "e3": (26.079, 0.936),
        "e4": (21.407, 6.449),
        "e5": (28.080, 0.814),
        "e6": (46.458, 3.176),
        "e7": (28.080, 0.814),
        "e8": (18.468, 3.784),
        "e9": (10.410, 0.965),
        "e10": (8.475, 1.062),
        "e11": (10.410, 0.965),
        "e12": (45.678, 3.446),
        "e13": (10.000, 1.717),
        "e14": (10.000, 6.940),
        "e15": (10.000, 0.0),
        "e16": (3.529, 0.097),
        "e17": (12.120, 8.602),
    }
    study = cube_study(Mechanism())
    for name, (centre, edge) in expected.items():
        assert study[name].shift_um == pytest.approx(centre, abs=1.1e-3), name
        assert study[name].largest_edge_um == pytest.approx(edge, abs=1.1e-3), name
    # The paper's conclusion, and its limit: 13 of 17 below one fifth at this size.
    assert study.below(0.2) == 13
    assert cube_study(Mechanism(), side_mm=50.0).below(0.2) > 13
    assert "13 of 17" in study.summary()
    json.dumps(study.to_dict())


def test_rigid_part_and_remainder_make_up_the_displacement() -> None:
    change = transformed_cube(Mechanism(), "e4", 10.0)
    arms = change.nominal_mm - change.nominal_mm.mean(axis=0)
    turn = change.rotation_arcsec * np.pi / 648000
    rigid = change.translation_um + 1e3 * np.cross(turn, arms)
    total = (change.moved_mm - change.nominal_mm) * 1e3
    assert np.abs(total - rigid - change.remainder_um).max() < 1e-8
    # e15 moves everything alike where the tool keeps its attitude.
    tool = transformed_cube(Mechanism(), "e15", 10.0)
    assert np.abs(tool.edges_um).max() < 1e-8
    assert np.abs(tool.circles_um).max() < 1e-8


def test_pictures_are_drawn_on_the_axes_given() -> None:
    from matplotlib.figure import Figure

    from trunnion.plot.hybrid import plot_ballbar_view, plot_cube

    change = transformed_cube(Mechanism(), "e14")
    solid = Figure().add_subplot(projection="3d")
    assert plot_cube(change, ax=solid) is solid
    assert len(solid.lines) == 24
    polar = Figure().add_subplot(projection="polar")
    assert plot_ballbar_view(change, ax=polar) is polar
    with pytest.raises(tn.InputError, match="3d"):
        plot_cube(change, ax=polar)


def test_command_line() -> None:
    runner = CliRunner()
    arguments = ["hybrid", "sensitivity", "--joints", "1180,1120,1060,25,-15"]
    result = runner.invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "rank 10" in result.output
    result = runner.invoke(app, [*arguments, "--json"])
    assert len(json.loads(result.output)["parameters"]) == 17
    result = runner.invoke(app, ["hybrid", "cube"])
    assert result.exit_code == 0, result.output
    assert "13 of 17" in result.output
    result = runner.invoke(app, ["hybrid", "sensitivity", "--joints", "1,2"])
    assert result.exit_code == 2
    assert "expected 5 numbers" in result.output


def test_batches_of_thousands_come_back_whole_in_few_steps() -> None:
    joints = poses(5000, 7)
    found = Mechanism().sensitivity(joints, threads=2)
    assert np.isfinite(found.tip).all()
    assert found.forward.steps.max() <= 8

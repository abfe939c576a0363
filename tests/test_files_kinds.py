"""Points, sweeps, diameters, axis logs and ball-bar lengths: files in, files out, bad ones refused."""
# ruff: noqa: E501  (a table of cases reads best with one line a case)

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from trunnion.files.table import Table

READERS: dict[str, Callable[[Path], Table]] = {
    "points": tn.read_points,
    "sweep": tn.read_sweep,
    "diameters": tn.read_diameters,
    "axis_log": tn.read_axis_log,
    "ballbar": tn.read_ballbar,
}

POINTS = "nominal_x_mm,nominal_y_mm,x_mm,y_mm"
LOG = "time_s,x_cmd_mm,x_act_mm"
JOINTS = "l1_mm,l2_mm,l3_mm,q4_deg,q5_deg"

GOOD = {
    "plane": ("points", tn.Points, f"{POINTS}\n1,2,1.01,2.01\n"),
    "space": ("points", tn.Points, "nominal_x_mm,nominal_y_mm,nominal_z_mm,x_mm,y_mm,z_mm,time_s,group,bore\n1,2,3,1,2,3,0,first,6.5\n1,2,3,1,2,3,9,second,6.4\n"),
    "sweep": ("sweep", tn.Sweep, "angle_deg,target,x_mm,y_mm,z_mm,time_s\n-30,1,1,2,3,0\n-25,2,1,2,3,1\n"),
    "diameters": ("diameters", tn.Diameters, "z_mm,error_um\n0,1.5\n10,-2\n"),
    "all of diameters": ("diameters", tn.Diameters, "z_mm,error_um,pass,time_s,feed_sign,depth_mm,diameter_mm,spindle_rpm,coolant\n0,1.5,1,0,-1,0.5,30,800,on\n10,2,2,1,1,0,30,800,off\n"),
    "axis log": ("axis_log", tn.AxisLog, f"{LOG},c_cmd_deg,c_act_deg,run\n0,1,1,0,0,a\n1,2,2,0,0,a\n0,1,1,0,0,b\n"),
    "ball-bar": ("ballbar", tn.Ballbar, "setup,x_mm,y_mm,length_mm,sense,feed_mm_min,time_s\n1,1,2,150.01,1,1000,0\n2,1,2,150.01,-1,1000,1\n"),
    "joints": ("ballbar", tn.Ballbar, f"setup,{JOINTS},length_mm\nlow,700,700,700,0,30,150\n"),
}  # fmt: skip

BAD = {
    "points without y": ("points", "nominal_x_mm,nominal_y_mm,x_mm\n1,2,3\n", ":1:1: y_mm: no such column"),
    "points with half a z": ("points", f"{POINTS},z_mm\n1,2,3,4,5\n", ":1:37: z_mm: got the column without nominal_z_mm, expected all or none"),
    "points not a number": ("points", f"{POINTS}\n1,2,3,four\n", ":2:7: y_mm: got 'four', expected a finite number"),
    "group without name": ("points", f"{POINTS},group\n1,2,3,4,\n", ":2:9: group: got an empty field, expected a name or a whole number"),
    "sweep without target": ("sweep", "angle_deg,x_mm,y_mm,z_mm\n0,1,2,3\n", ":1:1: target: no such column"),
    "sweep infinite": ("sweep", "angle_deg,target,x_mm,y_mm,z_mm\n0,1,1,2,inf\n", ":2:9: z_mm: got 'inf'"),
    "feed sign": ("diameters", "z_mm,error_um,feed_sign\n0,1,0\n", ":2:5: feed_sign: got '0', expected one of -1, 1"),
    "depth": ("diameters", "z_mm,error_um,depth_mm\n0,1,-0.5\n", ":2:5: depth_mm: got '-0.5', expected a finite number, 0 or above"),
    "diameter": ("diameters", "z_mm,error_um,diameter_mm\n0,1,0\n", ":2:5: diameter_mm: got '0', expected a finite number above 0"),
    "log without an axis": ("axis_log", "time_s\n0\n", ":1:1: time_s: got no axis among the columns time_s, expected x_cmd_mm and x_act_mm"),
    "log with half an axis": ("axis_log", f"{LOG},y_cmd_mm\n0,1,1,1\n", ":1:26: y_cmd_mm: got the column without y_act_mm"),
    "log back in time": ("axis_log", f"{LOG}\n0,1,1\n1,1,1\n0.5,1,1\n", ":4:1: time_s: got 0.5 after 1, expected a later time in each row of a run"),
    "log at one time": ("axis_log", f"{LOG},run\n0,1,1,a\n0,1,1,b\n0,1,1,b\n", ":4:1: time_s: got 0 after 0"),
    "bar without position": ("ballbar", "setup,length_mm\n1,150\n", ":1:1: setup: got no commanded position among the columns setup, length_mm"),
    "bar with half the joints": ("ballbar", "setup,l1_mm,l2_mm,length_mm\n1,700,700,150\n", ":1:7: l1_mm: got the column without l3_mm, q4_deg, q5_deg"),
    "bar with x only": ("ballbar", "setup,x_mm,length_mm\n1,0,150\n", ":1:7: x_mm: got the column without y_mm"),
    "bar with z only": ("ballbar", f"setup,z_mm,{JOINTS},length_mm\n1,0,7,7,7,0,0,150\n", ":1:7: z_mm: got no column x_mm"),
    "bar of no length": ("ballbar", "setup,x_mm,y_mm,length_mm\n1,0,0,0\n", ":2:7: length_mm: got '0', expected a finite number above 0"),
    "bar's sense": ("ballbar", "setup,x_mm,y_mm,length_mm,sense\n1,0,0,150,0\n", ":2:11: sense: got '0', expected one of -1, 1"),
}  # fmt: skip


@pytest.mark.parametrize("case", GOOD)
def test_a_good_file_reads_and_writes_back_equal(case: str, tmp_path: Path) -> None:
    reader, kind, text = GOOD[case]
    path = tmp_path / "data.csv"
    path.write_text(text)
    data = READERS[reader](path)
    assert isinstance(data, kind)
    assert len(data) == text.count("\n") - 1
    data.to_csv(path)
    assert READERS[reader](path) == data
    assert pickle.loads(pickle.dumps(data)) == data
    assert kind(data.columns) == data
    assert kind(data.to_pandas()) == data
    assert kind.concatenate(list(data)) == data
    assert f"{len(data)} row" in repr(data)
    assert "<table>" in data._repr_html_()


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_with_its_place(case: str, tmp_path: Path) -> None:
    reader, text, message = BAD[case]
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(tn.FileFormatError) as error:
        READERS[reader](path)
    assert str(error.value).startswith(f"{path}:")
    assert message in str(error.value)


def read(case: str, folder: Path) -> Table:
    reader, _, text = GOOD[case]
    path = folder / "data.csv"
    path.write_text(text)
    return READERS[reader](path)


def test_views_of_the_columns(tmp_path: Path) -> None:
    plane, space = read("plane", tmp_path), read("space", tmp_path)
    assert isinstance(plane, tn.Points)
    assert isinstance(space, tn.Points)
    assert (plane.dimension, space.dimension) == (2, 3)
    np.testing.assert_array_equal(plane.measured_mm - plane.nominal_mm, [[1.01 - 1, 2.01 - 2]])
    assert space.nominal_mm.shape == (2, 3)
    assert space.group is not None
    assert space.group.tolist() == ["first", "second"]
    assert space.extra["bore"].tolist() == [6.5, 6.4]
    log = read("axis log", tmp_path)
    assert isinstance(log, tn.AxisLog)
    assert log.axes == ("x", "c")
    np.testing.assert_array_equal(log.commanded("x"), [1.0, 2.0, 1.0])
    np.testing.assert_array_equal(log.actual("c"), np.zeros(3))
    circle, joints = read("ball-bar", tmp_path), read("joints", tmp_path)
    assert isinstance(circle, tn.Ballbar)
    assert isinstance(joints, tn.Ballbar)
    assert circle.position_mm is not None
    assert circle.position_mm.shape == (2, 2)
    assert circle.joints is None
    assert joints.position_mm is None
    assert joints.joints is not None
    assert joints.joints.tolist() == [[700.0, 700.0, 700.0, 0.0, 30.0]]


def test_a_column_named_by_a_word_of_python() -> None:
    diameters = tn.Diameters(z_mm=[0.0, 1.0], error_um=[1.0, 2.0], pass_=[1, 2])
    assert list(diameters.columns) == ["z_mm", "error_um", "pass"]
    assert diameters.pass_ is not None
    assert diameters.pass_.tolist() == [1, 2]
    assert diameters.with_columns(pass_=["a", "b"]).columns["pass"].tolist() == ["a", "b"]


MEASURED = Path(__file__).parents[1] / "../shared/measured"


@pytest.mark.skipif(not MEASURED.is_dir(), reason="no ../shared/measured beside the project")
def test_measured_files_of_others_read() -> None:
    assert len(tn.read_points(MEASURED / "plate1597a_2003.csv")) == 650
    assert len(tn.read_sweep(MEASURED / "meca500_j6.csv")) == 58

"""Any bytes in a file give a result or an error of ours; any table that is made reads back."""
# ruff: noqa: E501

import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import trunnion as tn
from foreign_files import FOREIGN
from trunnion.contouring import Servo
from trunnion.hybrid import Mechanism
from trunnion.models.ballbar import BallbarSettings

PLAN = tn.Touches(
    a_deg=[0.0, 90.0], c_deg=[0.0, 0.0], x_mm=[1.0, 2.0], y_mm=[0.0, 0.0], z_mm=[0.0, 0.0],
    dir_x=[0.0, 0.0], dir_y=[0.0, 0.0], dir_z=[-1.0, -1.0],
)  # fmt: skip

# A valid file each; the fuzzer breaks it.
FILES: dict[str, tuple[Callable[[Path], object], str]] = {
    "setup": (
        tn.read_setup,
        tn.Setup(
            artefact=tn.Artefact("sphere", diameter_mm=20.0, centre_mm=(0, 0, 60)),
            machine=tn.Machine(errors={"EX0C": 1.0}),
            axes={"C": tn.AxisSetup(-1)},
            turning={"overhang_mm": 80.0, "blocks_mm": [10.0, 20.0]},
            report=tn.ReportSetup(machine="'\"", remark='"""'),
        ).to_toml()
        + "[servo]\n\"x\" = {gain_per_s = 80, 'time_constant_ms' = 5}\n"
        + "[servo.'Y'] # y\ngain_per_s = 80\ntime_constant_ms = 5\n"
        + '[rotary_test]\nballs_mm = [\n  [1, 2, 3], # one\n]\n[hybrid]\nerrors . "e5_um" = 3\n',
    ),
    "touches": (tn.read_touches, PLAN.with_columns(note=["a", 'b, "c"'], point=[1, 2]).to_csv()),
    "points": (tn.read_points, "nominal_x_mm,nominal_y_mm,x_mm,y_mm,group\n1,2,3,4,a\n"),
    "sweep": (tn.read_sweep, "angle_deg,target,x_mm,y_mm,z_mm\n1,2,3,4,5\n"),
    "rotary_test": (
        tn.read_rotary_test,
        "a_deg,x_mm,y_mm,z_mm,dx_um,dy_um,dz_um,ball\n1,2,3,4,5,6,7,a\n",
    ),
    "diameters": (tn.read_diameters, "z_mm,error_um,pass,feed_sign\n1,2,3,-1\n"),
    "axis_log": (tn.read_axis_log, "time_s,x_cmd_mm,x_act_mm,run\n0,1,1,a\n1,1,1,a\n"),
    "ballbar": (tn.read_ballbar, "setup,x_mm,y_mm,length_mm,sense\n1,2,3,4,1\n"),
    "probe_log": (
        lambda path: tn.read_probe_log(path, PLAN),
        "1.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0\n2.0 0.0 0.0 90.0 0.0 0.0 0.0 0.0 0.0\n",
    ),
}

for _name, (_text, _columns) in FOREIGN.items():
    FILES[_name] = (partial(tn.read, columns=_columns), _text)

pieces = st.sampled_from(
    [b'"', b"'", b",", b"\n", b"\r", b"#", b"[", b"]", b"{", b"}", b"=", b".", b"\0", b"\xff",
     b"\xc2\x85", b"\xe2\x80\xa8", b"\xd9\xa3", b"nan", b"-inf", b"1e999", b"1_0", b"9" * 30, b" ",
     b"\t", b";", b",5", b"\xff\xfe", b"overrun", b"\xef\xbb\xbf", b"\x0c", b"\x1c", b'"""', b"'''", b"\\", b"0x1", b"true", b"1979-05-27"]
) | st.binary(max_size=4)  # fmt: skip

# A busy machine is no fault of the code.
fuzz = settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def read(name: str, raw: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "file")
        path.write_bytes(raw)
        try:
            FILES[name][0](path)
        except tn.TrunnionError as error:
            assert str(error).startswith(f"{path}:")  # noqa: PT017


@pytest.mark.parametrize("name", FILES)
def test_the_file_to_be_broken_is_good(name: str, tmp_path: Path) -> None:
    reader, text = FILES[name]
    (tmp_path / "file").write_text(text)
    assert reader(tmp_path / "file") is not None


@pytest.mark.parametrize("name", FILES)
@fuzz
@given(st.binary(max_size=200))
def test_random_bytes(name: str, raw: bytes) -> None:
    read(name, raw)


@pytest.mark.parametrize("name", FILES)
@fuzz
@given(st.data())
def test_broken_files(name: str, data: st.DataObject) -> None:
    raw = FILES[name][1].encode()
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(raw)))
        end = start + data.draw(st.integers(0, 6))
        raw = raw[:start] + data.draw(pieces) + raw[end:]
    read(name, raw)


absurd = st.sampled_from(
    ["1e300", "-1e300", "5e-324", "inf", "nan", "-0.0", "0x" + "f" * 9000, "9" * 5000, "[" * 2000,
     "[" * 60 + "]" * 60, "{a = " * 60, "[[[[1]]]]", "{}", "''", "true", "2020-01-01", "'\\u0000'"]
) | st.floats().map(repr) | st.integers().map(str)  # fmt: skip
headers = st.sampled_from(
    ["machine", "machine.errors", "axes", "axes.C", "artefact", "probe", "resolution", "table",
     "plan", "turning", "servo", "servo.X", "ballbar", "hybrid", "hybrid.errors", "x" + ".x" * 60]
)  # fmt: skip
keys = st.sampled_from(
    ["kind", "preset", "errors", "EX0C", "sense", "length_mm", "width_mm", "diameter_mm",
     "centre_mm", "ball_radius_mm", "repeatability_um", "overhang_mm", "gain_per_s", "X",
     "time_constant_ms", "direction", "home_mm", "e8_mm", "a" + ".a" * 60, "'a b'"]
)  # fmt: skip


@fuzz
@given(st.lists(st.tuples(headers, st.lists(st.tuples(keys, absurd), max_size=3)), max_size=4))
def test_absurd_setups_are_refused_or_stay_what_they_are(
    tables: list[tuple[str, list[tuple[str, str]]]],
) -> None:
    text = "artefact.kind = 'cuboid'\n"
    for header, entries in tables:
        text += f"[{header}]\n" + "".join(f"{key} = {value}\n" for key, value in entries)
    with TemporaryDirectory() as folder:
        path = Path(folder, "setup.toml")
        path.write_text(text, encoding="utf-8")
        try:
            setup = tn.read_setup(path)
            for process in (Servo.from_setup, BallbarSettings.from_setup, Mechanism.from_setup):
                with suppress(tn.TrunnionError):
                    process(setup)
        except tn.TrunnionError as error:
            assert str(error).startswith(f"{path}:")  # noqa: PT017
            return
        path.write_text(setup.to_toml(), encoding="utf-8")
        again = tn.read_setup(path)
    assert again.to_toml() == setup.to_toml()  # as text: nan is not equal to itself


finite = st.floats(allow_nan=False, allow_infinity=False)
extra_columns = st.lists(
    st.integers() | st.floats() | st.text() | st.booleans(), min_size=2, max_size=2
)
names = st.text(min_size=1).filter(lambda name: name not in tn.Touches.kinds)


@fuzz
@example([0.0, 0.0], {"id": [0, 10**18]})
@given(st.lists(finite, min_size=2, max_size=2), st.dictionaries(names, extra_columns, max_size=3))
def test_any_table_that_can_be_made_reads_back_equal(
    values: list[float], extra: dict[str, list[object]]
) -> None:
    try:
        touches = tn.Touches({**PLAN.columns, "x_mm": values, **extra})
    except tn.InputError:
        return  # a name or text that does not stay on one line
    with TemporaryDirectory() as folder:
        path = Path(folder, "touches.csv")
        touches.to_csv(path)
        again = tn.read_touches(path)
    assert again == touches
    assert pickle.loads(pickle.dumps(touches)) == touches
    np.testing.assert_array_equal(again.x_mm, values)

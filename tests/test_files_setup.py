"""The set-up file: its defaults, its round trip, and a place in every message."""
# ruff: noqa: E501  (a table of cases reads best with one line a case)

import copy
import dataclasses
import json
import pickle
import re
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import trunnion as tn
from trunnion.base.stored import plain, structured
from trunnion.contouring import LinearAxis
from trunnion.models.ballbar import BallbarSettings
from trunnion.models.diameters import Conditions
from trunnion.probing.rotary_readings import RotaryTestSettings
from trunnion.setup.fields import keys_of
from trunnion.setup.parts import PARTS

CROSS = '[artefact]\nkind = "cross"\n'

BAD_FILES = {
    "no artefact": ("[probe]\n", ':1:1: artefact.kind: missing, expected one of cross, cuboid, sphere, spheres, ring, none'),
    "no kind": ("\n[artefact]\nlength_mm = 3.0\n", ":2:1: artefact.kind: missing"),
    "kind": ('[artefact]\n  kind = "crss"\n', ":2:10: artefact.kind: got 'crss', expected one of cross, cuboid, sphere, spheres, ring, none; did you mean cross?"),
    "unknown table": (f"{CROSS}[prob]\n", ":3:1: prob: unknown key, expected one of machine, artefact, probe"),
    "unknown key": (f"{CROSS}[probe]\n\nball_mm = 1\n", ":5:1: probe.ball_mm: unknown key, expected one of ball_radius_mm"),
    "negative": (f"{CROSS}width_mm = -25 # wide\n", ":3:12: artefact.width_mm: got -25, expected a number from 0.001 to 100000 mm"),
    "infinite": (f"{CROSS}width_mm = inf\n", ":3:12: artefact.width_mm: got inf, expected a number from 0.001 to 100000 mm"),
    "nan": (f"{CROSS}[probe]\ntick_um = nan\n", ":4:11: probe.tick_um: got nan, expected a number from 0 to 10000 µm"),
    "text": (f'{CROSS}[resolution]\nlinear_um = "0.1"\n', ":4:13: resolution.linear_um: got '0.1', expected a number from 0 to 10000 µm"),
    "boolean": (f"{CROSS}[probe]\nball_radius_mm = true\n", ":4:18: probe.ball_radius_mm: got True, expected a number from 0.001 to 100000 mm"),
    "huge": (f"{CROSS}length_mm = 1{'0' * 400}\n", ":3:13: artefact.length_mm: got 1"),
    "wide cross": (f"{CROSS}width_mm = 100\n", ":3:12: artefact.width_mm: got 100.0, expected less than artefact.length_mm = 100"),
    "stem": (f"{CROSS}[probe]\nstem_radius_mm = 2\n", ":4:18: probe.stem_radius_mm: got 2.0, expected at most probe.ball_radius_mm = 1"),
    "sphere without size": ('[artefact]\nkind = "sphere"\ncentre_mm = [0, 0, 60]\n', ":1:1: artefact.diameter_mm: missing, expected a number from 0.001 to 100000: a sphere needs it"),
    "sphere's centre": ('[artefact]\nkind = "sphere"\ndiameter_mm = 20\ncentre_mm = [0, 60]\n', ":4:13: artefact.centre_mm: got [0, 60], expected a list of 3 numbers"),
    "sphere's length": ('[artefact]\nkind = "sphere"\nlength_mm = 3\n', ":3:1: artefact.length_mm: unknown key, expected one of kind, diameter_mm, centre_mm"),
    "cross's diameter": (f"{CROSS}diameter_mm = 3\n", ":3:1: artefact.diameter_mm: unknown key, expected one of kind, length_mm, width_mm, height_mm"),
    "sense": (f"{CROSS}[axes.C]\nsense = 2\n", ":4:9: axes.C.sense: got 2, expected 1 or -1"),
    "axis": (f"{CROSS}[axes.c]\nsense = 1\n", ":3:1: axes.c: unknown key, expected one of X, Y, Z, A, B, C"),
    "axis no table": (f"{CROSS}[axes]\nC = -1\n", ":4:5: axes.C: got -1, expected a table"),
    "error name": (f"{CROSS}[machine]\nerrors = {{ EX0C = 1.0, EXC = 2.0 }}\n", ":4:30: machine.errors: location error: got 'EXC', expected a name of ISO 230-1"),
    "error size": (f"{CROSS}[machine.errors]\nEX0C = 'big'\n", ":4:8: machine.errors.EX0C: got 'big', expected a number from -100000 to 100000 µm"),
    "error twice": (f"{CROSS}[machine.errors]\nEX0C = 1\nexoc = 2\n", ":5:8: machine.errors.EX0C: got 'exoc', expected each error once"),
    "preset": (f"{CROSS}[machine]\npreset = 5\n", ":4:10: machine.preset: got 5, expected one of trt-ca"),
    "unknown preset": (f"{CROSS}[machine]\npreset = 'trt-xy'\n", ":4:10: machine.preset: got 'trt-xy', expected one of trt-ca"),
    "not this machine's": (f"{CROSS}[machine.errors]\nEX0B = 1\n", ":4:8: machine.errors of trt-ca: got 'EX0B', expected one of EA0A"),
    "table is none": ("artefact = 'cross'\n", ":1:12: artefact: got 'cross', expected a table"),
    "syntax": (f"{CROSS}[probe\n", ":3:7: got '[probe', expected TOML: Expected ']' at the end of a table declaration"),
    "key twice": (f"{CROSS}kind = 'cross'\n", ":3:15: got \"kind = 'cross'\", expected TOML: Cannot overwrite a value"),
    "digits": (f"{CROSS}length_mm = {'9' * 5000}\n", ":3:13: got 5000 characters, expected a number of at most 1000"),
    "deep": (f"{CROSS}[servo]\na = {'[' * 5000}\n", ":4:44: got tables or arrays nested too deeply, expected at most 40 levels"),
}  # fmt: skip


# Too large, too deep, out of any range.
HOSTILE = {
    "arrays": (f"{CROSS}[turning]\na = {'[' * 60}{']' * 60}\n", ":4:44: got tables or arrays nested"),
    "inline tables": (f"{CROSS}[turning]\na = {'{a = ' * 60}1{'}' * 60}\n", "nested too deeply"),
    "dotted keys": (f"{CROSS}[turning]\n{'.'.join('a' * 60)} = 1\n", ":4:1: got tables or arrays nested"),
    "headers": (f"{CROSS}[turning.{'.'.join('a' * 60)}]\n", ":3:1: got tables or arrays nested"),
    "array of tables": (f"{CROSS}[[turning.{'.'.join('a' * 60)}]]\n", ":3:1: got tables or arrays"),
    "deep": (f"{CROSS}[turning]\na = {'[' * 9000}\n", ":4:44: got tables or arrays nested"),
    "digits": (f"{CROSS}[probe]\nlength_mm = {'9' * 4400}\n", ":4:13: got 4400 characters"),
    "digits in a list": (f"{CROSS}[servo]\na = [1, {'1_' * 4400}1]\n", ":4:9: got 8801 characters"),
    "hexadecimal": (f"{CROSS}[turning]\na = 0x{'f' * 9000}\n", ":4:5: got 9002 characters"),
    "cuboid": ('[artefact]\nkind = "cuboid"\nlength_mm = 5e48\nwidth_mm = 3e48\nheight_mm = 5e-31\n', ":3:13: artefact.length_mm: got 5e+48, expected a number from 0.001 to 100000 mm"),
    "repeatability": (f"{CROSS}[probe]\nrepeatability_um = 1e300\n", ":4:20: probe.repeatability_um: got 1e+300, expected a number from 0 to 10000 µm"),
    "centre": ('[artefact]\nkind = "sphere"\ndiameter_mm = 9\ncentre_mm = [0, 1e9, 0]\n', ":4:17: artefact.centre_mm[1]: got 1000000000.0, expected a number from -100000 to 100000"),
    "error": (f"{CROSS}[machine]\nerrors.EX0C = 1e300\n", ":4:15: machine.errors.EX0C: got 1e+300, expected a number from -100000 to 100000 µm"),
    "axis that misses the table": (f"{CROSS}[axes.C]\npoint_mm = [3, 0, 0]\n", ":4:12: axes.C.point_mm: got an axis that misses the origin"),
    "axis of another machine": (f"{CROSS}[axes.B]\npoint_mm = [3, 0, 0]\n", ":3:1: axes.B: got an axis that machine trt-ca has not, expected one of X, Y, Z, A, C"),
    "linear axis": (f"{CROSS}[axes.X]\npoint_mm = [3, 0, 0]\n", ":4:12: axes.X.point_mm: got [3.0, 0.0, 0.0], expected none"),
    "key of a vise": (f"{CROSS}vise = {{jaw = 3}}\n", ":3:15: artefact.vise: got 'jaw', expected one of jaw_mm, thickness_mm"),
    "size of a vise": (f"{CROSS}vise = '130'\n", ":3:8: artefact.vise: got '130', expected one of 125, 80, 160"),
    "depth of a grip": (f"{CROSS}[artefact.vise]\ngrip_mm = 200\n", ":4:11: artefact.vise.grip_mm: got 200, expected at most height_mm less bed_mm = 25"),
    "height of a bed": (f"{CROSS}vise.bed_mm = 200\n", ":3:15: artefact.vise.bed_mm: got 200, expected at most height_mm = 100"),
    "opening of a vise": (f"{CROSS}vise.opening_mm = 80\n", ":3:19: artefact.vise.opening_mm: got 80, expected at least 100, the length of the artefact"),
    "vise of a sphere": ('[artefact]\nkind = "sphere"\ndiameter_mm = 9\ncentre_mm = [0, 0, 9]\nvise = true\n', ":5:8: artefact.vise.opening_mm: missing, expected the distance between the jaws"),
    "place in a vise": (f"{CROSS}vise = true\nplace_mm = [0, 0, 20]\n", ":4:12: artefact.place_mm: got (0.0, 0.0, 20.0), expected Z of 0 (where it sits) or of at least 75"),
    "two holders": (f"{CROSS}vise = true\nplate = true\n", ":4:9: artefact.plate: got"),
    "plate twice": (f"{CROSS}plate = true\nbase_mm = [1, 1, 1]\n", ":4:11: artefact.base_mm: got (1.0, 1.0, 1.0), expected none beside artefact.plate: give one of the two"),
    "pivot without a head": (f"{CROSS}[control]\npivot_mm = 80\n", ":4:12: control.pivot_mm: got 80.0, expected none: machine trt-ca has no head"),
    "ball that a head turns": (f"{CROSS}[machine]\npreset = 'head-bc'\n[probe]\noffset_std_um = 1\n", ":6:17: probe.offset_std_um: got 1.0, expected 0: machine head-bc turns the probe"),
    "tolerance of nothing": (f"{CROSS}[control]\ncentre_tolerance_mm = 0.5\n", ":3:1: control.centre_mm: missing, expected the place that centre_tolerance_mm is about"),
    "squareness of a cuboid": ("[artefact]\nkind = 'cuboid'\ncalibration_arcsec = 2\n", ":3:22: artefact.calibration_arcsec: got 2.0, expected 0: no squareness of a cuboid is fitted"),
    "chain beside a preset": (f"{CROSS}[machine]\npreset = 'trt-ca'\nchain = '[w C b X Y Z t]'\n", ":5:9: machine.chain: got"),
    "range twice": (f"{CROSS}[axes.A]\nrange_deg = [-90, 90]\nrange_mm = [0, 1]\n", ":5:12: axes.A.range_mm: got [0.0, 1.0], expected range_deg for axis A"),
    "tick twice": (f"{CROSS}[probe]\ntick_um = 1\nservo_period_ms = 1\n", ":5:19: probe.servo_period_ms: got 1.0, expected 0 beside probe.tick_um = 1"),
    "pivot": (f"{CROSS}[machine]\npreset = 'table-c-head-b'\n[axes.B]\npoint_mm = [3, 0, 0]\n", ":6:12: axes.B.point_mm: z: got 0, expected 150"),
    "place": (f"{CROSS}place_mm = [1, 2]\n", ":3:12: artefact.place_mm: got [1, 2], expected a list of 3 numbers"),
    "stem of a cross": (f"{CROSS}stem_diameter_mm = 3\n", ":3:1: artefact.stem_diameter_mm: unknown key"),
    "stem": ('[artefact]\nkind = "sphere"\ndiameter_mm = 9\ncentre_mm = [0, 0, 9]\nstem_diameter_mm = 9\n', ":5:20: artefact.stem_diameter_mm: got 9.0, expected less than artefact.diameter_mm = 9"),
    "feed": (f"{CROSS}[plan]\nrotary_deg_min = 1e99\n", ":4:18: plan.rotary_deg_min: got 1e+99, expected a number from 0.001 to 1e+07 deg/min"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"), [*BAD_FILES.values(), *HOSTILE.values()], ids=[*BAD_FILES, *HOSTILE]
)
def test_a_bad_file_is_refused_with_its_place(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(text)
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_setup(path)
    assert str(error.value).startswith(f"{path}:")
    assert message in str(error.value)
    assert len(str(error.value)) < 600


def test_defaults(tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(CROSS)
    setup = tn.read_setup(path)
    assert setup == tn.Setup(artefact=tn.Artefact("cross"))
    assert setup.machine == tn.Machine(preset="trt-ca", errors={})
    assert setup.sense("C") == 1
    assert (setup.artefact.length_mm, setup.artefact.width_mm) == (100.0, 25.0)
    assert setup.artefact.height_mm == 25.0
    assert setup.probe == tn.Probe(1.0, 0.0, 0.0)
    assert setup.probe.effective_stem_radius_mm == 0.5
    assert setup.resolution == tn.Resolution(linear_um=0.1, rotary_arcsec=0.36)


def test_spellings_of_errors(tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(f'{CROSS}[machine.errors]\nEXOC = 1\ne_a0a = 2.5\n"E_{{B0C}}" = -3\n')
    assert tn.read_setup(path).machine.errors == {"EX0C": 1.0, "EA0A": 2.5, "EB0C": -3.0}


@pytest.mark.parametrize("text", ["EA0A", "EAOA", "E_A0A", "ea0a", "e_aoa", "E_{AOA}", " EA0A "])
def test_one_name_for_every_spelling(text: str) -> None:
    assert tn.canonical_error_name(text) == "EA0A"


@pytest.mark.parametrize("text", ["", "EAA", "A0A", "EA00", "ED0A", "E_{A0A", "EA0A}", "EB0C-EB0A"])
def test_other_names_are_refused(text: str) -> None:
    with pytest.raises(tn.UnknownNameError, match="expected a name of ISO 230-1"):
        tn.canonical_error_name(text)


def test_tables_of_processes_are_valid_beside_one_another(tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(
        "[turning]\noverhang_mm = 80\n[servo.X]\ngain_per_s = 80\ntime_constant_ms = 5\n"
        "[rotary_test]\nballs_mm = [[90, 20, 60]]\n[ballbar]\n[hybrid.errors]\ne5_um = 3\n"
    )
    setup = tn.read_setup(path)
    assert setup.artefact.kind == "none"
    assert setup.turning == {"overhang_mm": 80}
    assert setup.servo["X"]["gain_per_s"] == 80
    assert setup.rotary_test["balls_mm"] == ((90, 20, 60),)
    path.write_text(setup.to_toml())
    assert tn.read_setup(path) == setup


def test_a_setup_built_in_a_notebook_is_checked_alike() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    probe = dataclasses.replace(setup.probe, ball_radius_mm=3)
    assert probe.effective_stem_radius_mm == 1.5
    with pytest.raises(tn.InputError, match=r"probe.tick_um: got -1, expected a number from 0 to"):
        dataclasses.replace(setup.probe, tick_um=-1)
    with pytest.raises(tn.InputError, match=r"artefact.width_mm: got 3.0, expected none: a sphere"):
        tn.Artefact("sphere", width_mm=3.0, diameter_mm=20.0, centre_mm=(0.0, 0.0, 60.0))
    with pytest.raises(
        tn.InputError, match=r"axes: got 'c', expected one of X, Y, Z, A, B, C; did you mean C"
    ):
        dataclasses.replace(setup, axes={"c": tn.AxisSetup(-1)})
    with pytest.raises(tn.InputError, match=r"artefact: got 'cross', expected an Artefact"):
        tn.Setup(artefact="cross")  # type: ignore[arg-type]
    with pytest.raises(tn.InputError, match=r"machine.errors: location error: got 'EXC'"):
        tn.Machine(errors={"EXC": 1.0})


sizes = st.floats(0.1, 1e4)
artefacts = st.one_of(
    st.builds(
        lambda kind, length, share, height: tn.Artefact(kind, length, share * length, height),
        st.sampled_from(["cross", "cuboid"]), sizes, st.floats(0.01, 0.99), sizes,
    ),
    st.builds(
        lambda d, *centre: tn.Artefact("sphere", diameter_mm=d, centre_mm=centre),
        sizes, sizes, sizes, sizes,
    ),
)  # fmt: skip
setups = st.builds(
    tn.Setup,
    artefact=artefacts,
    machine=st.builds(
        tn.Machine,
        preset=st.just("trt-ca"),
        errors=st.dictionaries(st.sampled_from(["EX0C", "EA0A", "EB0C"]), st.floats(-1e3, 1e3)),
    ),
    axes=st.dictionaries(st.sampled_from("XYZAC"), st.builds(tn.AxisSetup, st.sampled_from([1, -1]))),
    probe=st.builds(tn.Probe, sizes, st.floats(0, 10), st.floats(0, 10), sizes),
    turning=st.just({}) | st.builds(
        lambda overhang, blocks: {"overhang_mm": overhang, "blocks_mm": blocks},
        sizes, st.lists(sizes, max_size=3),
    ),
)  # fmt: skip


@pytest.mark.parametrize("holder", ["vise", "chuck", "plate"])
@pytest.mark.parametrize("comments", [False, True])
def test_a_holder_reads_back_equal(holder: str, comments: bool, tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(f"{CROSS}{holder} = true\n")
    setup = tn.read_setup(path)
    bare = tn.Artefact("cross")
    usual: dict[str, Any] = {holder: {}}
    without: dict[str, Any] = {holder: False}
    assert setup.artefact == dataclasses.replace(bare, **usual)
    assert dataclasses.replace(setup.artefact, **without) == bare != setup.artefact
    path.write_text(setup.to_toml(comments=comments))
    assert tn.read_setup(path) == setup == pickle.loads(pickle.dumps(setup))
    assert hash(tn.read_setup(path)) == hash(setup)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(setups)
def test_written_setup_reads_back_equal(setup: tn.Setup) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "setup.toml")
        path.write_text(setup.to_toml(), encoding="utf-8")
        assert tn.read_setup(path) == setup
    assert pickle.loads(pickle.dumps(setup)) == setup


def test_a_deep_stack_is_no_reason_for_another_error(tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(f"{CROSS}[turning]\noverhang_mm = {'[' * 30}{']' * 30}\n")

    def below(levels: int) -> str:
        if levels:
            return below(levels - 1)
        with pytest.raises(
            tn.FileFormatError, match=r":4:15: turning.overhang_mm: got \("
        ) as error:
            tn.read_setup(path)
        return str(error.value)

    assert below(300) == below(0)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"a": object()}, "turning.a: got object .*, expected a value of TOML"),
        ({"a": [1, None]}, r"turning.a\[1\]: got None, expected a value of TOML"),
        ({1: 2}, "turning: got 1, expected text as key"),
        ({"a": 1 << 9000}, "turning.a: got a whole number of more than 1000 digits"),
    ],
)
def test_a_table_that_no_file_can_hold_is_refused(table: dict[str, Any], message: str) -> None:
    with pytest.raises(tn.InputError, match=message):
        tn.Setup(artefact=tn.Artefact("cross"), turning=table)
    deep: dict[str, Any] = {}
    for _ in range(60):
        deep = {"a": deep}
    with pytest.raises(tn.InputError, match="more than 40 tables in one another"):
        tn.Setup(artefact=tn.Artefact("cross"), turning=deep)


# --- frozen, hashable, readable

FULL = tn.Setup(
    artefact=tn.Artefact("sphere", diameter_mm=20.0, centre_mm=(0.0, 0.0, 60.0)),
    machine=tn.Machine(errors={"EX0C": 1.5, "EA0A": -2.0}),
    axes={"C": tn.AxisSetup(-1)},
    servo={"X": {"gain_per_s": 80.0, "time_constant_ms": 5.0}},
    rotary_test={"balls_mm": [[90.0, 20.0, 60.0]]},
)


def test_a_setup_is_a_value() -> None:
    for part in (FULL, FULL.machine, FULL.artefact, FULL.axes, FULL.servo):
        for other in (copy.deepcopy(part), pickle.loads(pickle.dumps(part))):
            assert other == part
            assert hash(other) == hash(part)
    assert {FULL: 1}[dataclasses.replace(FULL)] == 1
    assert dataclasses.replace(FULL, servo={}) != FULL
    assert tn.Machine(errors={"EX0C": 1.5}) != tn.Machine(errors={"EX0C": 1.5, "EY0C": 0.0})
    for mapping in (FULL.machine.errors, FULL.axes, FULL.servo, FULL.servo["X"]):
        with pytest.raises(TypeError, match="does not support item assignment"):
            mapping["C"] = 1  # type: ignore[index]


def test_a_setup_does_not_change_with_what_it_was_made_from() -> None:
    errors = {"EX0C": 1.0}
    servo = {"X": {"gain_per_s": 80.0, "time_constant_ms": 5.0}}
    setup = tn.Setup(tn.Artefact("cross"), tn.Machine(errors=errors), servo=servo)
    errors["EX0C"] = servo["X"]["gain_per_s"] = 2.0
    assert (setup.machine.errors["EX0C"], setup.servo["X"]["gain_per_s"]) == (1.0, 80.0)


def test_a_setup_reads_well() -> None:
    assert repr(FULL) == "<Setup: trt-ca, sphere 20 mm, ball radius 1 mm, [servo], [rotary_test]>"
    lines = {line.split()[0]: line for line in str(FULL).splitlines() if line.strip()}
    for key in ("machine.errors.EX0C", "axes.C.sense", "probe.stem_radius_mm", "servo.X"):
        assert key in lines
    assert lines["artefact.diameter_mm"].split()[1:3] == ["20", "mm"]
    assert "artefact.length_mm" not in lines
    machine = "Machine(preset='trt-ca', errors={'EX0C': 1.5, 'EA0A': -2.0}, tolerance={}, chain=None, table_normal=None)"
    assert repr(FULL.machine) == machine
    for html in (FULL._repr_html_(), FULL.artefact._repr_html_()):
        assert "<td>" in html
        assert "of the sphere, artefact frame" in html
    tables = FULL.to_dict()
    own = {"kind": "sphere", "diameter_mm": 20.0, "centre_mm": [0, 0, 60]}
    standing = {"place_mm": [0, 0, 0], "turn_deg": 0, "tolerance_mm": 2, "tolerance_deg": 1}
    known = {
        "calibration_um": 0,
        "calibration_arcsec": 0,
        "temperature_c": 20,
        "temperature_std_k": 0,
    }
    assert tables["artefact"] == own | standing | known | {"expansion_ppm_k": 11.5}
    assert tables == tomllib.loads(FULL.to_toml())


@pytest.mark.parametrize(
    "part",
    [*PARTS.values(), tn.AxisSetup, LinearAxis, BallbarSettings, RotaryTestSettings, Conditions],
)
def test_every_key_says_what_it_means(part: type) -> None:
    declared = keys_of(part)
    assert {item.name for item in dataclasses.fields(part) if item.compare} == set(declared)
    for key in declared.values():
        assert key.meaning
        assert key.takes.words


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[turning]\noverhang_mm = 80\nfeed_mm_rew = 1\n", ":3:1: turning.feed_mm_rew: unknown key, .*did you mean feed_mm_rev"),
        ("[turning]\nfeed_mm_rev = 1\n", ":1:1: turning.overhang_mm: missing"),
        ("[turning]\noverhang_mm = 80\nspindle_rpm = 0\n", ":3:15: turning.spindle_rpm: got 0, expected a finite number above 0"),
        ("[ballbar]\ncalibrated = 1\n", ":2:14: ballbar.calibrated: got 1, expected true or false"),
        ("[rotary_test]\nballs_mm = [[1, 2]]\n", ":2:13: rotary_test.balls_mm\\[0\\]: got"),
        ("[rotary_test]\nball_mm = 1\n", ":2:1: rotary_test.ball_mm: unknown key, .*did you mean balls_mm"),
        ("[ballbar]\nwrist = 2\n", ":2:9: ballbar.wrist: got 2, expected 1 or -1"),
        ("[hybrid]\ne8 = 2\n", ":2:1: hybrid.e8: unknown key, .*did you mean e8_mm"),
        ("[hybrid.errors]\ne5_um = nan\n", ":2:9: hybrid.errors.e5_um: got nan, expected a finite"),
        ("[hybrid]\ne4_mm = 3\nerrors.e18_um = 3\n", ":3:17: error parameter: got e18_um, expected e1_um"),
        ("[servo]\nx.gain_per_s = 1\nx.time_constant_ms = 1\nX = {}\n", ":4:5: servo.X: got the axis twice"),
        ("[servo]\nX = 3\n", ":2:5: servo.X: got 3, expected a table"),
        ("[servo]\nX = {gain_per_s = 80, time_constant_ms = 1, pitch_mm = -1}\n", ":2:56: servo.X.pitch_mm: got -1, expected a finite number, 0 or above"),
        ("[turning]\noverhang_mm = 80\nspindle_rpm = 840\n", ":1:1: turning.feed_mm_rev: missing, expected a finite number above 0 beside turning.spindle_rpm = 840"),
        ("[turning]\noverhang_mm = 80\nfeed_mm_rev = 0.1\nspindle_rpm = 840\ncutting_speed_m_min = 150\n", ":4:15: turning.spindle_rpm: got 840.0, expected none beside turning.cutting_speed_m_min = 150: give one of the two"),
        ("[servo]\nX = {gain_per_s = 80, time_constant_ms = 1, coulomb_um = 3}\n", ":2:1: servo.X.breakaway_um: got 0.0, expected at least coulomb_um = 3"),
        ("[servo]\nX = {gain_per_s = 80, time_constant_ms = 1, cyclic_um = 3}\n", ":2:57: servo.X.cyclic_um: got 3.0, expected 0, or pitch_mm above 0"),
        ("[servo.C]\ngain_per_s = 80\ntime_constant_ms = 1\ndamping = 0.1\n", ":4:11: servo.C.damping: got 0.1, expected 0, or resonance_hz above 0"),
        ("[servo]\nfeedback = 'moter'\n", ":2:12: servo.feedback: got 'moter', .*did you mean motor"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("before", ["", CROSS, "[report]\n"])
def test_tables_of_processes_are_checked_when_a_file_is_read(
    text: str, message: str, before: str, tmp_path: Path
) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(text + before)
    with pytest.raises(tn.FileFormatError, match=re.escape(str(path)) + message):
        tn.read_setup(path)


@pytest.mark.parametrize("vise", [True, "80", {"size": "160", "grip_mm": 15.0}])
def test_a_set_up_with_a_vise_is_stored_and_comes_back(vise: Any) -> None:
    setup = tn.Setup(tn.Artefact("cross", vise=vise))
    assert structured(json.loads(json.dumps(plain(setup))), tn.Setup) == setup

"""The set-up file: its defaults, its round trip, and a place in every message."""
# ruff: noqa: E501  (a table of cases reads best with one line a case)

import dataclasses
import pickle
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import trunnion as tn

CROSS = '[artefact]\nkind = "cross"\n'

BAD_FILES = {
    "no artefact": ("[probe]\n", ':1:1: artefact.kind: missing, expected kind = "cross", "cuboid" or "sphere"'),
    "no kind": ("\n[artefact]\nlength_mm = 3.0\n", ":2:1: artefact.kind: missing"),
    "kind": ('[artefact]\n  kind = "crss"\n', ":2:10: artefact.kind: got 'crss', expected one of \"cross\", \"cuboid\", \"sphere\""),
    "unknown table": (f"{CROSS}[prob]\n", ":3:1: prob: unknown key, expected one of machine, artefact, probe"),
    "unknown key": (f"{CROSS}[probe]\n\nball_mm = 1\n", ":5:1: probe.ball_mm: unknown key, expected one of ball_radius_mm"),
    "negative": (f"{CROSS}width_mm = -25 # wide\n", ":3:12: artefact.width_mm: got -25, expected a finite number above 0"),
    "infinite": (f"{CROSS}width_mm = inf\n", ":3:12: artefact.width_mm: got inf, expected a finite number above 0"),
    "nan": (f"{CROSS}[probe]\ntick_um = nan\n", ":4:11: probe.tick_um: got nan, expected a finite number, 0 or above"),
    "text": (f'{CROSS}[resolution]\nlinear_um = "0.1"\n', ":4:13: resolution.linear_um: got '0.1', expected a finite number"),
    "boolean": (f"{CROSS}[probe]\nball_radius_mm = true\n", ":4:18: probe.ball_radius_mm: got True, expected a finite number"),
    "huge": (f"{CROSS}length_mm = 1{'0' * 400}\n", ":3:13: artefact.length_mm: got 1"),
    "wide cross": (f"{CROSS}width_mm = 100\n", ":3:12: artefact.width_mm: got 100.0, expected less than artefact.length_mm = 100"),
    "stem": (f"{CROSS}[probe]\nstem_radius_mm = 2\n", ":4:18: probe.stem_radius_mm: got 2.0, expected at most probe.ball_radius_mm = 1"),
    "sphere without size": ('[artefact]\nkind = "sphere"\ncentre_mm = [0, 0, 60]\n', ":1:1: artefact.diameter_mm: got none, expected one"),
    "sphere's centre": ('[artefact]\nkind = "sphere"\ndiameter_mm = 20\ncentre_mm = [0, 60]\n', ":4:13: artefact.centre_mm: got [0, 60], expected three finite numbers"),
    "sphere's length": ('[artefact]\nkind = "sphere"\nlength_mm = 3\n', ":3:1: artefact.length_mm: unknown key, expected one of kind, diameter_mm, centre_mm"),
    "cross's diameter": (f"{CROSS}diameter_mm = 3\n", ":3:15: artefact.diameter_mm: got 3.0, expected none"),
    "sense": (f"{CROSS}[axes.C]\nsense = 2\n", ":4:9: axes.C.sense: got 2, expected 1 or -1"),
    "axis": (f"{CROSS}[axes.c]\nsense = 1\n", ":3:1: axes.c: unknown key, expected one of X, Y, Z, A, B, C"),
    "axis no table": (f"{CROSS}[axes]\nC = -1\n", ":4:5: axes.C: got -1, expected a table with the key sense"),
    "error name": (f"{CROSS}[machine]\nerrors = {{ EX0C = 1.0, EXC = 2.0 }}\n", ":4:30: machine.errors: location error: got 'EXC', expected a name of ISO 230-1"),
    "error size": (f"{CROSS}[machine.errors]\nEX0C = 'big'\n", ":4:8: machine.errors.EX0C: got 'big', expected a finite number"),
    "error twice": (f"{CROSS}[machine.errors]\nEX0C = 1\nexoc = 2\n", ":5:8: machine.errors.EX0C: got 'exoc', expected each error once"),
    "preset": (f"{CROSS}[machine]\npreset = 5\n", ":4:10: machine.preset: got 5, expected one of trt-ca"),
    "unknown preset": (f"{CROSS}[machine]\npreset = 'trt-xy'\n", ":4:10: machine.preset: got 'trt-xy', expected one of trt-ca"),
    "not this machine's": (f"{CROSS}[machine.errors]\nEX0B = 1\n", ":4:8: machine.errors: got 'EX0B', expected an error that trt-ca has: EA0A"),
    "table is none": ("artefact = 'cross'\n", ":1:12: artefact: got 'cross', expected a table"),
    "syntax": (f"{CROSS}[probe\n", ":3:7: got '[probe', expected TOML: Expected ']' at the end of a table declaration"),
    "key twice": (f"{CROSS}kind = 'cross'\n", ":3:15: got \"kind = 'cross'\", expected TOML: Cannot overwrite a value"),
    "digits": (f"{CROSS}length_mm = {'9' * 5000}\n", "got a file that is not TOML"),
    "deep": (f"{CROSS}[servo]\na = {'[' * 5000}\n", "nested too deeply"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_FILES)
def test_a_bad_file_is_refused_with_its_place(case: str, tmp_path: Path) -> None:
    text, message = BAD_FILES[case]
    path = tmp_path / "setup.toml"
    path.write_text(text)
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_setup(path)
    assert str(error.value).startswith(f"{path}:")
    assert message in str(error.value)


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


def test_sister_machines_read_their_tables_themselves(tmp_path: Path) -> None:
    path = tmp_path / "setup.toml"
    path.write_text(
        "[turning]\noverhang_mm = 80\n[[turning.tool]]\nname = 'a'\n[servo.X]\ngain = 1\n"
    )
    setup = tn.read_setup(path)
    assert setup.artefact.kind == "none"
    assert setup.turning == {"overhang_mm": 80, "tool": [{"name": "a"}]}
    assert setup.servo["X"]["gain"] == 1
    path.write_text(setup.to_toml())
    assert tn.read_setup(path) == setup


def test_a_setup_built_in_a_notebook_is_checked_alike() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    probe = dataclasses.replace(setup.probe, ball_radius_mm=3)
    assert probe.effective_stem_radius_mm == 1.5
    with pytest.raises(
        tn.InputError, match=r"probe.tick_um: got -1, expected a finite number, 0 or"
    ):
        dataclasses.replace(setup.probe, tick_um=-1)
    with pytest.raises(tn.InputError, match=r"artefact.width_mm: got 3.0, expected none: a sphere"):
        tn.Artefact("sphere", width_mm=3.0, diameter_mm=20.0, centre_mm=(0.0, 0.0, 60.0))
    with pytest.raises(tn.InputError, match=r"axes: got 'c', expected an axis name"):
        dataclasses.replace(setup, axes={"c": tn.AxisSetup(-1)})
    with pytest.raises(tn.InputError, match=r"artefact: got 'cross', expected an? Artefact"):
        tn.Setup(artefact="cross")  # type: ignore[arg-type]
    with pytest.raises(tn.InputError, match=r"machine.errors: location error: got 'EXC'"):
        tn.Machine(errors={"EXC": 1.0})


sizes = st.floats(1e-3, 1e4)
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
raw = st.recursive(
    st.booleans() | st.integers(-(10**12), 10**12) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
setups = st.builds(
    tn.Setup,
    artefact=artefacts,
    machine=st.builds(
        tn.Machine,
        preset=st.just("trt-ca"),
        errors=st.dictionaries(st.sampled_from(["EX0C", "EA0A", "EB0C"]), st.floats(-1e3, 1e3)),
    ),
    axes=st.dictionaries(st.sampled_from("XYZABC"), st.builds(tn.AxisSetup, st.sampled_from([1, -1]))),
    probe=st.builds(tn.Probe, sizes, st.floats(0, 10), st.floats(0, 10), sizes),
    turning=st.dictionaries(st.text(), raw, max_size=3),
)  # fmt: skip


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(setups)
def test_written_setup_reads_back_equal(setup: tn.Setup) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "setup.toml")
        path.write_text(setup.to_toml(), encoding="utf-8")
        assert tn.read_setup(path) == setup
    assert pickle.loads(pickle.dumps(setup)) == setup

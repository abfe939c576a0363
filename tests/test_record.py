"""JSON is a record: the same from a command and from Python, with checksums, and it comes back."""

from __future__ import annotations

import hashlib
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from test_cli import run

TOUCHES, SETUP = tn.sample_path("hidden/touches.csv"), tn.sample_path("hidden/setup.toml")
BAR = tn.sample_path("ballbar/circle.csv")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """JSON by the command line and by Python."""
    folder = tmp_path_factory.mktemp("record")
    run("diagnose", str(TOUCHES), str(SETUP), "-o", str(folder / "cli.json"))
    made = tn.diagnose(tn.read(TOUCHES), tn.read_setup(SETUP))
    made.save(folder / "python.json")
    return folder / "cli.json", folder / "python.json"


def test_the_command_line_and_python_write_the_same(written: tuple[Path, Path]) -> None:
    held = [json.loads(path.read_text("utf-8")) for path in written]
    cli, python = ({k: v for k, v in one.items() if k != "record"} for one in held)
    assert python.items() <= cli.items()
    assert set(cli) - set(python) <= {"recognised"}


@pytest.mark.parametrize("which", [0, 1])
def test_it_names_software_call_date_and_files_with_checksums(
    written: tuple[Path, Path], which: int
) -> None:
    record = json.loads(written[which].read_text("utf-8"))["record"]
    assert record["software"] == f"trunnion {tn.__version__}"
    assert record["by_command"] == (which == 0)
    assert "diagnose" in record["made_by"]
    assert record["written"][:2] == "20"
    sums = {one["file"]: one["sha256"] for one in record["files"]}
    files = (TOUCHES, SETUP)
    assert sums == {str(f): hashlib.sha256(Path(f).read_bytes()).hexdigest() for f in files}


@pytest.mark.parametrize("which", [0, 1])
def test_it_comes_back_whole(written: tuple[Path, Path], which: int, tmp_path: Path) -> None:
    made = tn.diagnose(tn.read(TOUCHES), tn.read_setup(SETUP))
    back = tn.Diagnosis.from_json(written[which])
    assert back == made
    assert back.budget() == made.budget()
    assert back.data == made.data
    back.plot()
    page = back.to_html(tmp_path / "back.html").read_text("utf-8")
    stored = json.loads(written[which].read_text("utf-8"))["record"]
    assert stored["written"] in page
    assert stored["files"][0]["sha256"] in page


def test_a_file_that_changed_since_does_not_change_the_record(tmp_path: Path) -> None:
    data = tmp_path / "bar.csv"
    data.write_bytes(Path(BAR).read_bytes())
    text = tn.diagnose(tn.read(data)).to_json()
    data.write_text("other", encoding="utf-8")
    back = tn.Diagnosis.from_json(text)
    assert back.to_json() == text
    page = back.to_html(tmp_path / "back.html").read_text("utf-8")
    assert json.loads(text)["record"]["files"][0]["sha256"] in page
    assert hashlib.sha256(b"other").hexdigest() not in page


def test_what_printed_json_lacks_is_said_plainly(tmp_path: Path) -> None:
    printed = tmp_path / "printed.json"
    printed.write_text(run("diagnose", str(TOUCHES), str(SETUP), "--json"), encoding="utf-8")
    back = tn.Diagnosis.from_json(printed)
    needs: list[Any] = [back.plot, back.budget, back.rebuilt_model]
    needs.append(lambda: back.to_html(tmp_path / "page.html"))
    for use in needs:
        with pytest.raises(tn.TrunnionError, match=r"without its measured data .*--output"):
            use()


def test_older_json_is_read_and_a_broken_record_is_refused() -> None:
    made = tn.diagnose(tn.read(TOUCHES), tn.read_setup(SETUP))
    values = json.loads(made.to_json())
    old = {k: v for k, v in values.items() if k not in ("record", "formulas")}
    assert tn.Diagnosis.from_json(json.dumps(old)) == made
    with pytest.raises(tn.FileFormatError, match="Record"):
        tn.Diagnosis.from_json(json.dumps({**values, "record": 5}))


def test_effects_of_a_file_come_back() -> None:
    effect = tn.FormulaEffect("once", "Points", covariate="Y position", unit="mm", component="X",
                              shape="polynomial", number=3, low=0.0, high=300.0)  # fmt: skip
    rng, grid = np.random.default_rng(1), np.linspace(0.0, 300.0, 9)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    s = y / 150.0 - 1.0
    off = 6e-3 * (5.0 * s**3 - 3.0 * s) / 2.0
    noise = rng.normal(0.0, 3e-4, (2, len(x)))
    data = tn.Points(nominal_x_mm=x, nominal_y_mm=y, x_mm=x + off + noise[0], y_mm=y + noise[1])
    made = tn.diagnose(data, effects=[effect])
    back = tn.Diagnosis.from_json(made.to_json())
    assert back == made
    assert back.candidates == (effect,)
    assert back.rebuilt_model().effects[-1].id == "once"


def of(path: Path | str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def recorded(made: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(made.to_json())["record"]
    return found


@pytest.mark.parametrize("then", ["changed", "gone", "elsewhere"])
def test_the_checksum_is_of_what_was_read(
    then: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("touches.csv").write_bytes(TOUCHES.read_bytes())
    Path("setup.toml").write_bytes(SETUP.read_bytes())
    made = tn.diagnose(tn.read("touches.csv"), tn.read_setup("setup.toml"))
    for name in ("touches.csv", "setup.toml"):
        if then == "changed":
            Path(name).write_text("other", encoding="utf-8")
        elif then == "gone":
            Path(name).unlink()
    if then == "elsewhere":
        monkeypatch.chdir("/")
    files = {one["file"]: one for one in recorded(made)["files"]}
    assert {name: one["sha256"] for name, one in files.items()} == {
        "touches.csv": of(TOUCHES),
        "setup.toml": of(SETUP),
    }
    assert files["touches.csv"]["bytes"] == len(TOUCHES.read_bytes())
    page = made.to_html(tmp_path / "page.html").read_text("utf-8")
    assert of(TOUCHES) in page


def test_data_that_come_back_by_themselves_keep_the_checksum() -> None:
    data = tn.Touches.from_json(tn.read_touches(TOUCHES).to_json())
    both = pickle.loads(pickle.dumps(data))[3:]
    made = tn.diagnose(both, tn.read_setup(SETUP))
    assert [one["sha256"] for one in recorded(made)["files"]] == [of(TOUCHES), of(SETUP)]
    old = json.loads(tn.read_touches(TOUCHES).to_json())
    del old["origin"]["read"]  # of an older version: what the file was then is not known
    made = tn.diagnose(tn.Touches.from_json(json.dumps(old)), tn.read_setup(SETUP))
    assert [one["sha256"] for one in recorded(made)["files"]] == ["", of(SETUP)]


def test_results_without_data_record_their_files(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    for name in ("a.csv", "b.csv"):
        made = axis.with_columns(measured_mm=axis.measured + rng.normal(0, 1e-4, len(axis)))
        made.to_csv(tmp_path / name)
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    sums = [of(path) for path in paths]
    both = [tn.read(path) for path in paths]
    bar = tn.read_ballbar(BAR)
    identified = tn.identify(tn.read_touches(TOUCHES), tn.read_setup(SETUP))
    batch = tn.diagnose_many([*map(str, paths), str(tmp_path / "none.csv")], workers=1)
    for path in paths:
        path.write_text("other", encoding="utf-8")
    for found, call, expected in (
        (tn.compare(*both), "trunnion.compare(", sums),
        (tn.compare(*map(tn.diagnose, both)), "trunnion.compare(", sums),
        (tn.iso230_4(bar)[0], "trunnion.iso230_4(", [of(BAR)]),
        (identified, "trunnion.identify(", [of(TOUCHES), of(SETUP)]),
        (tn.compare(identified, identified), "trunnion.compare(", [of(TOUCHES), of(SETUP)]),
        (both[0].iso230_2(), "iso230_2(", sums[:1]),
        (batch, "trunnion.diagnose_many([", [*sums, ""]),
    ):
        record = recorded(found)
        assert [one["sha256"] for one in record["files"]] == expected, call
        assert record["made_by"].startswith(call)
        assert all(f'"{one["file"]}"' in record["made_by"] for one in record["files"])
        back = type(found).from_json(found.to_json())
        assert recorded(back) == record


def test_a_file_of_effects_is_recorded(tmp_path: Path) -> None:
    effect = tn.FormulaEffect("third", "Ballbar", covariate="angle in the XY plane", unit="deg",
                              component="", shape="harmonic", number=3)  # fmt: skip
    path = tn.write_effects(tmp_path / "e.toml", [effect])
    record = recorded(tn.diagnose(tn.read_ballbar(BAR), effects=tn.read_effects(path)))
    assert [(one["what"], one["sha256"]) for one in record["files"]] == [
        ("data", of(BAR)),
        ("effects", of(path)),
    ]
    assert f'effects=["{path}"]' in record["made_by"]
    run("diagnose", str(BAR), "--effects", str(path), "-o", str(tmp_path / "d.json"))
    assert (
        json.loads((tmp_path / "d.json").read_text("utf-8"))["record"]["files"] == record["files"]
    )


def test_stored_results_and_data_that_are_read_as_measured_data_are_named(tmp_path: Path) -> None:
    d, data = tmp_path / "d.json", tmp_path / "data.json"
    tn.diagnose(tn.read_ballbar(BAR)).to_json(d, indent=2)
    tn.read_ballbar(BAR).to_json(data)
    with pytest.raises(
        tn.FileFormatError, match=r"a stored result \(Diagnosis\).*from_json\("
    ) as e:
        tn.read(d)
    assert 'to_html("report.html")' in str(e.value)
    with pytest.raises(tn.FileFormatError, match=r"stored data \(Ballbar\).*Ballbar.from_json\("):
        tn.read(data)
    assert "from_json" in run("diagnose", str(d), code=2)

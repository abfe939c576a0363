"""What a user meets first: wrong units, exchanged columns, no set-up, long names in tables."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.base.report import Table
from trunnion.base.units import unit_of
from trunnion.cli import app

ROOT = Path(__file__).parents[1]
AXIS = tn.read_positioning(tn.sample_path("positioning/axis.csv"))


def run(*words: object, code: int = 0) -> str:
    found = CliRunner().invoke(app, [str(w) for w in words])
    assert found.exit_code == code, found.output
    return found.output


@pytest.mark.parametrize(
    ("factor", "likely"),
    [
        (1000.0, "are these µm, or the targets m?"),
        (1 / 25.4, "are these inches?"),
        (-1.0, "does the instrument count the other way?"),
        (0.3, "another unit, or other columns?"),
    ],
)
def test_measured_positions_in_another_unit_are_refused(factor: float, likely: str) -> None:
    other = AXIS.with_columns(measured_mm=factor * AXIS.measured)
    for judge in (other.iso230_2, lambda: tn.diagnose(other)):
        with pytest.raises(tn.DataError, match=re.escape(likely)):
            judge()


def test_an_offset_of_the_instrument_is_no_other_unit() -> None:
    moved = AXIS.with_columns(measured_mm=AXIS.measured + 100.0)
    expected = AXIS.iso230_2().accuracy_um
    assert moved.iso230_2().accuracy_um == pytest.approx(expected, abs=1e-6)


def test_exchanged_columns_are_named() -> None:
    swapped = AXIS.with_columns(measured_mm=AXIS.target, target_mm=AXIS.measured)
    with pytest.raises(tn.DataError, match="are the two columns exchanged"):
        swapped.iso230_2()


def test_instruments_without_a_measured_column_are_listed(tmp_path: Path) -> None:
    file = tmp_path / "stops.csv"
    file.write_text("target_mm,direction,cycle,motor_mm,laser_mm\n0,1,1,0.001,0.002\n")
    said = run("positioning", "instruments", file, code=2)
    assert "no measured_mm beside motor_mm, laser_mm" in said
    options = "--column", "measured_mm=motor_mm", "--column", "laser_mm=laser_mm"
    out = tmp_path / "own.csv"
    run("read", file, *options, "-o", out)
    assert tn.read_positioning(out).instruments == ("laser",)


def test_letters_of_the_standard_are_tolerances_and_labels_stand_in_the_table() -> None:
    found = AXIS.iso230_2()
    by_letter = found.conformity(A=40.0, B=5.0)
    assert by_letter == found.conformity(accuracy_um=40.0, reversal_um=5.0)
    assert [row[0] for row in by_letter.tables()[0].rows] == ["accuracy A", "reversal B"]


def test_targets_are_shown_as_they_were_given_and_means_to_their_uncertainty() -> None:
    results = AXIS.iso230_2()
    first = results.tables()[1].cells()[0]
    assert first[0] == "8.2"
    assert results.tables()[1].columns[0] == "target, mm"
    std = results.std_errors["mean_reversal_um"]
    decimals = [len(cell.partition(".")[2]) for cell in first[1:]]
    assert all(1 <= std * 10**d / 10 < 10 for d in decimals)


@pytest.mark.parametrize("length", [20, 70])
def test_no_column_of_a_table_is_clipped(length: int) -> None:
    heads = ("", "before", "after", "change", "standard error", "unit", "p", "changed")
    row = ("word " * (length // 5), "142.6", "−36.52", "−179.2", "4.4", "µm/m per m", "0.1", "last")
    text = Table.of("Changes", heads, [row]).text()
    assert all(cell in text for cell in row[1:])
    assert text.count("word") == length // 5


def test_a_log_without_a_set_up_says_what_to_write() -> None:
    said = run("diagnose", tn.sample_path("contour/axislog.csv"), code=2)
    assert "[servo.X] with gain_per_s and time_constant_ms" in said


def test_messages_of_commands_name_the_command_the_files_and_the_folder(tmp_path: Path) -> None:
    log = tmp_path / "bed.csv"
    log.write_text("trigger,raw_x_mm_per_m\n1,0.1\n2,0.2\n")
    assert f'trunnion read {log} --column "COLUMN=trigger"' in run("read", log, code=2)
    setup = tmp_path / "own.toml"
    setup.write_text("")
    assert "got none as data and" in run("diagnose", setup, code=2)
    page = tmp_path / "nowhere" / "page.html"
    axis = tn.sample_path("positioning/axis.csv")
    assert "there is no folder" in run("diagnose", axis, "--html", page, code=2)
    assert "Ref [m]" in " ".join(run("read", "--help").split())


def test_comparison_calls_quantities_by_their_labels() -> None:
    grown = AXIS.with_columns(measured_mm=AXIS.measured + 0.01 * (AXIS.direction < 0))
    found = tn.compare(AXIS, grown)
    assert "mean_reversal_um" in found.changed
    said = found.summary()
    assert "mean reversal B̄ 6.17 → −3.83" in said
    assert "reversal_um" not in said


def test_shares_have_their_unit() -> None:
    assert unit_of("gain_x.gain_percent") == "%"


def test_the_page_on_positioning_does_as_it_says() -> None:
    text = (ROOT / "docs/how-to/positioning.md").read_text(encoding="utf-8")
    code = re.findall(r"```python\n(.*?)```", text, re.S)
    assert code
    names: dict[str, object] = {}
    for block in code:
        exec(block, names)
    assert np.isfinite(names["plate"].flatness().flatness_um)  # type: ignore[attr-defined]


def test_tables_of_the_readme_have_one_number_of_columns() -> None:
    for table in re.findall(r"(?:^\|.*\n)+", (ROOT / "README.md").read_text("utf-8"), re.M):
        counts = {len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}
        assert len(counts) == 1, table

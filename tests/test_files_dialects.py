"""Text dialects of CSV files: what is recognised is said, what is ambiguous is refused."""
# ruff: noqa: E501  (a table of cases reads best with one line a case)

import codecs
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openpyxl
import pytest

import trunnion as tn

TEXT = "nominal_x_mm,nominal_y_mm,x_mm,y_mm,note\n1.5,2.25,1.501,2.249,left\n-3.0,4.0,-2.9995,4e0,right\n"
EUROPE = TEXT.replace(",", ";").replace(".", ",")

DIALECTS: dict[str, tuple[bytes, str]] = {
    "as written": (TEXT.encode(), "UTF-8, commas."),
    "semicolons, points": (TEXT.replace(",", ";").encode(), "UTF-8, semicolons."),
    "European Excel": (codecs.BOM_UTF8 + EUROPE.replace("\n", "\r\n").encode(), "UTF-8, semicolons and decimal commas."),
    "Excel's Unicode text": (codecs.BOM_UTF16_LE + EUROPE.replace(";", "\t").encode("utf-16-le"), "UTF-16, tabs and decimal commas."),
    "big end first": (codecs.BOM_UTF16_BE + TEXT.encode("utf-16-be"), "UTF-16, commas."),
    "tabs": (TEXT.replace(",", "\t").encode(), "UTF-8, tabs."),
    "quotes": (EUROPE.replace("left", '"left"').encode(), "semicolons and decimal commas."),
    "empty lines at the end": ((TEXT + ",,,,\n , ,,,\n\n").encode(), "2 empty lines at the end were left out."),
    "index of pandas": (("," + TEXT.replace("\n1.5", "\n0,1.5").replace("\n-3", "\n4,-3")).encode(), "counts rows: it was left out."),
    "case of letters": (TEXT.replace("nominal_x_mm", "Nominal_X_MM").replace("y_mm,note", "Y_mm,note").encode(), "UTF-8, commas."),
}  # fmt: skip

AMBIGUOUS = {
    "thousands": ("nominal_x_mm;nominal_y_mm;x_mm;y_mm\n1,234;2;1,234;2\n", ":2:1: nominal_x_mm: got '1,234', which may be 1.234 or 1234, expected a decimal mark that is sure (tn.read with decimal=\",\" or \".\" decides)"),
    "two marks": ("nominal_x_mm;nominal_y_mm;x_mm;y_mm\n1,5;2;1,5;2\n1;2;1;2.5\n", ":2:1: nominal_x_mm: got '1,5', but '2.5' in column y_mm, line 3, expected one decimal mark in the file"),
    "thousands with points": ("nominal_x_mm;nominal_y_mm;x_mm;y_mm\n1,5;2;1.234,5;2\n", ":2:7: x_mm: got '1.234,5', expected a finite number"),
    "commas twice": ("nominal_x_mm,nominal_y_mm,x_mm,y_mm\n1,5,2,5,1,5,2,5\n", "got 8 fields, expected 4: nominal_x_mm, nominal_y_mm, x_mm, y_mm (decimal commas? then"),
    "quoted thousands": ('nominal_x_mm,nominal_y_mm,x_mm,y_mm\n"1,234",2,1,2\n', ":2:1: nominal_x_mm: got '1,234', which may be 1.234 or 1234, expected a decimal mark that is sure"),
    "two separators": ("nominal_x_mm,nominal_y_mm,x_mm,y_mm,a;b\n1,2,1,2,3;4\n", "header: got commas and semicolons, either of which could separate the columns, expected one (separator= decides)"),
    "index with a gap in it": (",nominal_x_mm,nominal_y_mm,x_mm,y_mm\n0,1,2,1,2\n0,1,2,1,2\n", ":1:1: header: got an empty field"),
    "both cases": ("nominal_x_mm,nominal_y_mm,x_mm,X_MM,y_mm\n1,2,1,1,2\n", ":1:32: x_mm: got the column twice"),
}  # fmt: skip


@pytest.mark.parametrize("case", DIALECTS)
def test_a_dialect_reads_as_the_same_and_is_said(case: str, tmp_path: Path) -> None:
    raw, said = DIALECTS[case]
    (tmp_path / "plain.csv").write_text(TEXT)
    (tmp_path / "data.csv").write_bytes(raw)
    plain = tn.read_points(tmp_path / "plain.csv")
    readers: tuple[Callable[[Path], tn.Points], ...] = (tn.read_points, tn.read)
    for reader in readers:
        data = reader(tmp_path / "data.csv")
        assert data == plain
        assert data.recognised is not None
        assert said in data.recognised.summary()
        assert data[1:].recognised == data.recognised
        assert tn.Points.from_json(data.to_json()).recognised == data.recognised
        assert data.recognised.as_written == (case in ("as written", "case of letters"))


@pytest.mark.parametrize("case", AMBIGUOUS)
def test_what_can_be_read_in_two_ways_is_refused(case: str, tmp_path: Path) -> None:
    text, message = AMBIGUOUS[case]
    path = tmp_path / "data.csv"
    path.write_text(text)
    for reader in (tn.read_points, tn.read):
        with pytest.raises(tn.FileFormatError) as error:
            reader(path)
        assert str(error.value).startswith(f"{path}:")
        assert message in str(error.value)


def test_the_argument_that_is_named_decides(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text(AMBIGUOUS["thousands"][0])
    assert tn.read(path, decimal=",").x_mm.tolist() == [1.234]
    with pytest.raises(tn.FileFormatError, match="got '1,234', expected a finite number"):
        tn.read(path, decimal=".")
    path.write_text(AMBIGUOUS["two separators"][0])
    assert tn.read(path, separator=",").columns["a;b"].tolist() == ["3;4"]
    with pytest.raises(tn.UnknownNameError, match="separator"):
        tn.read(path, separator="|")


def test_errors_of_a_dialect_have_their_place(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(codecs.BOM_UTF16_LE + EUROPE.replace("2,249", "two").encode("utf-16-le"))
    with pytest.raises(tn.FileFormatError, match=r":2:16: y_mm: got 'two', expected a finite"):
        tn.read_points(path)
    path.write_bytes(codecs.BOM_UTF16_LE + EUROPE.encode("utf-16-le")[:-1])
    with pytest.raises(tn.FileFormatError, match="expected UTF-16 text"):
        tn.read_points(path)


def test_inches_are_an_explicit_option(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("z_mm,error_um,diameter_mm\n1,2,3\n")
    data = tn.read(path, units="inch")
    assert data.z_mm.tolist() == [25.4]
    assert data.error_um.tolist() == [2.0]
    assert data.recognised.units == {"z_mm": "inch → mm", "diameter_mm": "inch → mm"}
    path.write_text("target_mm,measured_mm,direction,cycle,feed_mm_min\n1,1,1,1,10\n")
    run = tn.read(path, units="inch")
    assert run.recognised.units["feed_mm_min"] == "inch/min → mm/min"
    assert run["feed_mm_min"].tolist() == [254.0]
    with pytest.raises(tn.UnknownNameError, match="expected one of mm, inch"):
        tn.read(path, units="feet")


def test_a_sheet_of_a_workbook(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.title = "Points"
    for row in (
        ["nominal_x_mm", "nominal_y_mm", "x_mm", "y_mm", "note"],
        [1.5, 2.25, 1.501, 2.249, "a, b"],
        [-3, 4, -2.9995, 4.0, None],
    ):
        sheet.append(row)
    path = tmp_path / "data.xlsx"
    book.save(path)
    data = tn.read(path)
    np.testing.assert_array_equal(data.measured_mm, [[1.501, 2.249], [-2.9995, 4.0]])
    assert data.columns["note"].tolist() == ["a, b", ""]
    assert "xlsx, sheet 'Points'" in data.recognised.summary()
    assert tn.read_points(path) == data
    book.create_sheet("More").append([1])
    book.save(path)
    with pytest.raises(tn.FileFormatError, match="got the sheets Points, More, expected one"):
        tn.read(path)
    assert tn.read(path, sheet="Points") == data
    path.write_bytes(b"PK\x03\x04")
    with pytest.raises(tn.FileFormatError, match="cannot be read as a workbook"):
        tn.read(path)

"""Touches: what is read is what was written, and a bad file or array is refused with its place."""
# ruff: noqa: E501  (a table of cases reads best with one line a case)

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn

HEADER = "a_deg,c_deg,x_mm,y_mm,z_mm,dir_x,dir_y,dir_z"
ROW = "0,90,1,2,26,0,0,-1"

BAD_FILES = {
    "text": (f"{HEADER}\n{ROW}\n0,0,1,2,abc,0,0,-1\n", ":3:9: z_mm: got 'abc', expected a finite number"),
    "nan": (f"{HEADER}\n0,0,nan,2,3,0,0,-1\n", ":2:5: x_mm: got 'nan', expected a finite number"),
    "infinite": (f"{HEADER}\n0,0,1,-inf,3,0,0,-1\n", ":2:7: y_mm: got '-inf', expected"),
    "overflow": (f"{HEADER}\n0,0,1,1e999,3,0,0,-1\n", ":2:7: y_mm: got '1e999', expected"),
    "underscore": (f"{HEADER}\n0,0,1,1_0,3,0,0,-1\n", ":2:7: y_mm: got '1_0', expected"),
    "other digits": (f"{HEADER}\n0,0,1,٣,3,0,0,-1\n", ":2:7: y_mm: got '٣', expected"),
    "empty field": (f"{HEADER}\n# c\n\n0,0,1, ,3,0,0,-1\n", ":4:8: y_mm: got an empty field, expected"),
    "decimal comma": (f"{HEADER}\n0,0,1,5,2,3,0,0,-1\n", ":2:17: after the last column: got 9 fields, expected 8"),
    "too few": (f"{HEADER}\n0,0,1,2,3,0,0\n", ":2:14: dir_z: got 7 fields, expected 8"),
    "semicolons": (f"{HEADER.replace(',', ';')}\n", ":2:1: got no line of data, expected at least one"),
    "column twice": (f"{HEADER},a_deg\n{ROW},0\n", ":1:46: a_deg: got the column twice"),
    "nameless": (f"{HEADER},\n{ROW},0\n", ":1:46: header: got an empty field, expected the name of a column"),
    "missing": (f"{HEADER[:-6]}\n0,0,1,2,3,0,0\n", ":1:1: dir_z: no such column"),
    "empty file": ("", ":1:1: got an empty file, expected a header line and data"),
    "only comments": ("# a\n\n# b\n", ":1:1: got an empty file"),
    "only a header": (f"{HEADER}\n", ":2:1: got no line of data, expected at least one"),
    "open quote": (f'{HEADER},note\n{ROW},"a\n', ":2:20: got '\"a', expected quotes that close"),
    "not unit": (f"{HEADER}\n0,0,1,2,3,0,0.1,-1\n", ":2:11: dir_x: got the approach direction (0.0, 0.1, -1.0) of length 1.00498756, expected a unit vector"),
    "barely not unit": (f"{HEADER}\n0,0,1,2,3,0,0,1.0000011\n", "expected a unit vector (to 1e-06)"),
    "sense": (f"{HEADER},c_dir\n{ROW},2\n", ":2:20: c_dir: got '2', expected one of -1, 0, 1"),
    "sense of no axis": (f"{HEADER},b_dir\n{ROW},1\n", ":1:46: b_dir: got no column b_deg"),
    "point": (f"{HEADER},point\n{ROW},1.5\n", ":2:20: point: got '1.5', expected a whole number"),
    "feed": (f"{HEADER},feed_mm_min\n{ROW},0\n", ":2:20: feed_mm_min: got '0', expected a finite number above 0"),
    "half a start": (f"{HEADER},start_x_mm\n{ROW},1\n", ":1:46: start_x_mm: got the column without start_y_mm, start_z_mm, expected all or none"),
}  # fmt: skip


@pytest.fixture
def touches() -> tn.Touches:
    return tn.Touches(
        a_deg=[0, 90, -90],
        c_deg=[0.0, 180.0, 0.1 + 0.2],
        x_mm=[1.0, 2.0, 3.0],
        y_mm=[0.0, 0.0, 1e-7],
        z_mm=[26.0, 26.0, 26.0],
        dir_x=[0, 0, 0.6],
        dir_y=[0, -1, 0],
        dir_z=[-1, 0, 0.8],
        cycle=["C", "A", "A"],
        point=[1, 18, 19],
        c_dir=[0, 1, -1],
        note=["plain", 'a, "b"', "# no comment"],
        batch=[1.5, 2.5, 3.5],
    )


@pytest.mark.parametrize("case", BAD_FILES)
def test_a_bad_file_is_refused_with_its_place(case: str, tmp_path: Path) -> None:
    text, message = BAD_FILES[case]
    path = tmp_path / "touches.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_touches(path)
    assert str(error.value).startswith(f"{path}:")
    assert message in str(error.value)


def test_not_utf8(tmp_path: Path) -> None:
    path = tmp_path / "touches.csv"
    path.write_bytes(b"\xef\xbb\xbf" + HEADER.encode() + b"\r\n# \xb5m\r\n")
    with pytest.raises(tn.FileFormatError, match=r":2:3: got the byte 0xb5, expected UTF-8 text"):
        tn.read_touches(path)


def test_any_order_comments_blank_lines_mark_and_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "touches.csv"
    text = "\ufeff# measured\r\n\r\n z_mm, y_mm ,x_mm,dir_z,dir_y,dir_x,c_deg,id\r\n# 1\r\n"
    path.write_bytes((text + ' 3, 2,1,"-1",0,0,90,007\r\n\r\n').encode())
    read = tn.read_touches(path)
    np.testing.assert_array_equal(read.position_mm, [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(read.direction, [[0.0, 0.0, -1.0]])
    assert list(read.rotary_deg) == ["c"]
    assert read.a_deg is None
    assert read.extra["id"].tolist() == ["007"]


def test_written_touches_read_back_equal(touches: tn.Touches, tmp_path: Path) -> None:
    touches.to_csv(tmp_path / "touches.csv")
    assert tn.read_touches(tmp_path / "touches.csv") == touches
    assert (tmp_path / "touches.csv").read_text() == touches.to_csv()
    assert pickle.loads(pickle.dumps(touches)) == touches
    assert tn.Touches(touches.to_pandas()) == touches


def test_rows_are_chosen_by_slice_mask_and_numbers(touches: tn.Touches) -> None:
    assert touches.cycle is not None
    chosen = touches[touches.cycle == "A"]
    assert isinstance(chosen, tn.Touches)
    assert chosen == touches[1:] == touches[[1, 2]] == touches[np.array([-2, -1])]
    assert chosen.extra["note"].tolist() == ['a, "b"', "# no comment"]
    assert len(touches[0]) == 1
    assert len(touches[[]]) == len(touches[:0]) == 0
    assert tn.Touches.concatenate([touches[0], chosen]) == touches
    with pytest.raises(IndexError):
        touches[3]
    with pytest.raises(tn.InputError, match="got a mask of 2, expected 3"):
        touches[[True, False]]


def test_a_column_is_found_by_name(touches: tn.Touches) -> None:
    assert touches["x_mm"] is touches.x_mm
    assert "note" in touches
    with pytest.raises(tn.UnknownNameError, match=r"got 'x_mmm', expected .*did you mean x_mm"):
        touches["x_mmm"]


def test_rows_keep_the_line_of_their_file(tmp_path: Path) -> None:
    for folder, rows in (("one", 3), ("two", 2)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "touches.csv").write_text(
            f"# by hand\n{HEADER}\n" + f"{ROW}\n\n" * rows
        )
    first, second = (tn.read_touches(tmp_path / f / "touches.csv") for f in ("one", "two"))
    assert [first.place(row) for row in range(3)] == [f"line {n} of touches.csv" for n in (3, 5, 7)]
    assert first[[False, False, True]].place(0) == "line 7 of touches.csv"
    assert first[1:][1].with_columns(c_deg=[0.0]).place(0) == "line 7 of touches.csv"
    assert pickle.loads(pickle.dumps(first)).place(2) == "line 7 of touches.csv"
    assert tn.Touches.from_json(first.to_json()).place(2) == "line 7 of touches.csv"
    made = tn.Touches(first.columns)
    assert made.place(2) == "row 2"
    joined = tn.Touches.concatenate([first, made, second])
    assert joined.place(2) == f"line 7 of {tmp_path / 'one' / 'touches.csv'}"
    assert joined.place(4) == "row 4"
    assert joined.place(7) == f"line 5 of {tmp_path / 'two' / 'touches.csv'}"


def test_frozen(touches: tn.Touches) -> None:
    with pytest.raises(ValueError, match="read-only"):
        touches.x_mm[0] = 1.0
    with pytest.raises(AttributeError):
        setattr(touches, "x_mm", np.zeros(3))  # noqa: B010  (mypy knows that it cannot be set)
    with pytest.raises(AttributeError):
        setattr(touches, "anything", 1)  # noqa: B010


def test_a_callers_array_is_neither_kept_nor_locked(touches: tn.Touches) -> None:
    x = np.array([1.0, 2.0, 3.0])
    moved = touches.with_columns(x_mm=x)
    x[0] = 7.0
    assert moved == touches


def test_bad_arrays_name_the_row(touches: tn.Touches) -> None:
    with pytest.raises(tn.InputError, match=r"z_mm \(row 2\): got nan, expected a finite number"):
        touches.with_columns(z_mm=[1.0, 2.0, float("nan")])
    with pytest.raises(tn.InputError, match=r"z_mm: got 2 values, expected 3"):
        touches.with_columns(z_mm=[1.0, 2.0])
    with pytest.raises(tn.InputError, match=r"dir_z: got no such column"):
        touches.with_columns(dir_z=None)
    with pytest.raises(tn.InputError, match=r"dir_x \(row 1\): got the approach direction"):
        touches.with_columns(dir_y=[0.0, 0.5, 0.0])
    with pytest.raises(tn.InputError, match=r"x_mm: got an array of shape \(3, 1\)"):
        touches.with_columns(x_mm=np.zeros((3, 1)))
    with pytest.raises(
        tn.InputError, match=r"x_mm: got rows of different lengths, expected one value"
    ):
        touches.with_columns(x_mm=[[1.0], [1.0, 2.0], []])
    with pytest.raises(tn.InputError, match=r"x_mm \(row 0\): got True, expected a finite number"):
        touches.with_columns(x_mm=[True, False, True])
    with pytest.raises(tn.InputError, match=r"x_mm \(row 1\): got None, expected a finite number"):
        touches.with_columns(x_mm=[1.0, None, 2.0])  # type: ignore[arg-type]
    with pytest.raises(
        tn.InputError, match=r"cycle \(row 2\): got nan, expected a name or a whole"
    ):
        touches.with_columns(cycle=[1.0, 2.0, float("nan")])
    with pytest.raises(
        tn.InputError, match=r"note \(row 1\): got 'a\\nb', expected text on one line"
    ):
        touches.with_columns(note=["a", "a\nb", "c"])


def test_labels_and_extra_columns_lose_nothing(touches: tn.Touches) -> None:
    def kept(values: Any, name: str) -> list[object]:
        column: list[object] = touches.with_columns(**{name: values}).columns[name].tolist()
        return column

    assert kept([1.0, 2.0, 3.0], "cycle") == [1, 2, 3]
    assert kept(["1", "2", "3"], "cycle") == [1, 2, 3]
    assert kept(["1.0", "2", "3"], "cycle") == ["1.0", "2", "3"]
    assert kept([0.5, 1.0, 2.0], "cycle") == ["0.5", "1.0", "2.0"]
    assert kept(["1.50", "2", "3e1"], "id") == [1.5, 2.0, 30.0]
    assert kept(["007", "2", "3"], "id") == ["007", "2", "3"]
    assert kept(["12345678901234567890", "2", "3"], "id") == ["12345678901234567890", "2", "3"]
    assert kept(np.array([2**63, 1, 2], np.uint64), "id") == [str(2**63), "1", "2"]
    assert kept([str(2**63 - 1), "1", "-2"], "id") == [2**63 - 1, 1, -2]
    assert kept([1.0, float("nan"), 2.0], "id") == ["1.0", "nan", "2.0"]
    assert kept([None, True, ""], "id") == ["None", "True", ""]


def test_positions_of_rotary_axes_are_those_of_the_machine(tmp_path: Path) -> None:
    """A file without any is that of a machine without rotary axes; another one refuses it."""
    path = tmp_path / "touches.csv"
    path.write_text(f"{HEADER[12:]}\n1,2,3,0,0,-1\n", encoding="utf-8")
    touches = tn.read_touches(path)
    assert not touches.rotary_deg
    with pytest.raises(
        tn.DataError, match="a_deg: got none, expected the position of rotary axis A"
    ):
        tn.identify(touches, tn.Setup(artefact=tn.Artefact("cross")))

"""Mutated files through every public reader: an error of the package that names the file, or data.

Good files of each format are broken by bytes and by pieces that the formats know. Those of every
kind of data are diagnosed, too: a result, all of it text and JSON, or an error that names the file.
"""

import codecs
import faulthandler
import json
import random
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import openpyxl

import trunnion as tn
from foreign_files import FOREIGN
from hostile import MAX_SECONDS, holds_nan
from result_examples import EXAMPLES, SAMPLES
from trunnion import nc
from trunnion.base.report import Result
from trunnion.data.linuxcnc_log import probe_log_of
from trunnion.models.kinds import Kind, kinds
from trunnion.studies.study_file import sweep_file

__all__ = ["diagnoses", "formats", "mutations"]

Format = tuple[Callable[[Path], object], bytes]

WATCHED = 100
"""Files read within `MAX_SECONDS`; to arm the watchdog for each one costs a third of the time."""

PIECES = [
    *(b'"', b"'", b",", b";", b"\n", b"\r", b"#", b"[", b"]", b"{", b"}", b"=", b":", b".", b"-"),
    *(b"\0", b"\xff", b"\xc2\x85", b"\xe2\x80\xa8", b"\xd9\xa3", b"\xef\xbb\xbf", b"\x0c", b" "),
    *(b"nan", b"NaN", b"inf", b"-inf", b"Infinity", b"1e999", b"1e300", b"5e-324", b"1_0", b"0x1"),
    *(b"9" * 30, b"9" * 5000, b"[" * 2000, b'{"a":' * 2000, b"null", b"true", b"{}", b"[]", b'""'),
    *(b"1979-05-27", b"-1", b"0", b"G2", b"M30", b"X", b"(", b")", b"%", b"\\", b'"""', b"'''"),
]

STUDY = """study = "calibration"
samples = 1
seed = 1
[grid]
noise_um = [0.1, 0.3]
[fixed]
length_mm = 150.0
"""

SHAPE = "# a part\nz_mm,x_mm,type,radius_mm\n80,10,,\n60,20,3,2\n30,20,8,1\n\n0,30,,\n"

EFFECTS = """[[effect]]
id = "rail_wave"
data = "Touches"
covariate = "Y place"
shape = "wave"
number = 31.0
component = "X"
unit = "mm"
low = -50.0
high = 50.0
"""


PROGRAMS = {
    "paper-um": "N10 G00 X40000 Z100000\nN20 G01 Z50000 F100\nN30 X60000\n",
    "linuxcnc": "G21 G90 G94\nG0 X1 Y2 Z3\n(text)\nG1 X10 F100 ; remark\nG2 X20 Y2 I5 J0\nM2\n",
    "linuxcnc-lathe": "G7 G90\nG0 X60 Z100\nG1 Z0 F0.1\nG3 X70 Z-5 R5\nM30\n",
    "fanuc-lathe": "O1000\nG00 X40. Z100.\nG01 Z50. F0.2\nX60.\nM30\n",
}


class _TakenError(Exception):
    """A study was taken: it would run now."""


class _NoRun:
    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        raise _TakenError


def _study(path: Path) -> object:
    try:
        return sweep_file(path, executor=_NoRun(), progress=False)
    except tn.DataError as error:
        if "_TakenError" not in str(error):
            raise
        return None


def _result(kind: type[Result]) -> Callable[[Path], object]:
    return lambda path: kind.from_json(path).summary()


def _program(dialect: str) -> Callable[[Path], object]:
    def read(path: Path) -> object:
        try:
            return nc.follow(nc.Program.parse(path.read_bytes().decode("latin-1"), dialect))
        except tn.ProgramError as error:
            raise tn.FileFormatError(f"{path}: {error}") from error  # as the commands do

    return read


def _part(path: Path) -> object:
    """An unfinished sweep: the description and the blocks in it are broken, not SQLite's own."""
    raw = path.read_bytes()
    part = path.with_name("sweep.nc.part")
    with sqlite3.connect(part) as base:
        base.executescript(_whole_part()[0])
        base.execute("INSERT INTO sweep VALUES (?)", (raw.decode("utf-8", "replace"),))
        for block in _whole_part()[1]:
            base.execute("INSERT INTO block VALUES (?, ?, ?, ?, ?, ?)", block)
    base.close()
    try:
        return tn.open_sweep(path.with_name("sweep.nc"))
    except tn.TrunnionError as error:
        raise tn.DataError(str(error).replace(str(part), str(path))) from error
    finally:
        part.unlink()


@cache
def _whole_part() -> tuple[str, list[Any]]:
    schema = (
        "CREATE TABLE sweep (described TEXT); CREATE TABLE block (node INTEGER, first INTEGER, "
        "count INTEGER, columns BLOB, width INTEGER, failures TEXT, PRIMARY KEY (node, first));"
    )
    return schema, [(0, 0, 1, b"\0" * 8, 1, "[]")]


@cache
def formats() -> dict[str, Format]:
    """A good file and the reader of each format, by name."""
    found: dict[str, Format] = {}
    for kind in kinds():
        path = tn.sample_path(SAMPLES[kind.name][0])
        lines = path.read_bytes().split(b"\n")[:12]
        found[kind.name] = (kind.read, b"\n".join(lines) + b"\n")
    found |= dialects()
    plan = tn.read_touches(tn.sample_path("cross/touches.csv"))[:2]
    log = "".join(
        f"{x:.4f} {y:.4f} {z:.4f} {a} 0 {c} 0 0 0\n"
        for (x, y, z), a, c in zip(plan.position_mm, plan["a_deg"], plan["c_deg"], strict=True)
    )
    found["probe log"] = (lambda path: tn.read_probe_log(path, plan), log.encode())
    slow = plan.with_columns(feed_mm_min=np.full(2, 60.0))
    numbered = probe_log_of(slow, slow, "plan.csv")
    found["numbered log"] = (lambda path: tn.read_probe_log(path, slow), numbered.encode())
    for name in ("cross", "contour", "turning"):
        setup = tn.sample_path(f"{name}/setup.toml").read_bytes()
        found[f"set-up {name}"] = (tn.read_setup, setup)
    for dialect, text in PROGRAMS.items():
        found[f"program {dialect}"] = (_program(dialect), text.encode())
    found["study"] = (_study, STUDY.encode())
    found["shape"] = (tn.turning.read_shape, SHAPE.encode())
    found["effects"] = (tn.read_effects, EFFECTS.encode())
    found["error map"] = (tn.read_error_map, (EXAMPLES["ErrorMap"]().to_csv() or "").encode())
    found["estimate"] = (tn.read_estimate, tn.identify(*_cross()).to_json().encode())
    for name in (
        "diagnosis sweep",
        "Margins",
        "IdentificationResult",
        "NextMeasurement",
        "NextPass",
        "ExpectedDiscrimination",
    ):
        made = EXAMPLES[name]()
        found[f"JSON {name}"] = (_result(type(made)), made.to_json().encode())
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "sweep.nc")
        tn.sweep(_half, {"x": [1.0, 2.0]}, samples=2, path=target, progress=False)
        found["netCDF"] = (tn.open_sweep, target.read_bytes())
        described = tn.open_sweep(target).attrs["described"]
    found["unfinished sweep"] = (_part, described.encode())
    return found


def dialects() -> dict[str, Format]:
    """Files of other programs, and of one kind of data in other dialects of CSV."""
    found: dict[str, Format] = {
        f"read {name}": (partial(tn.read, columns=columns), text.encode())
        for name, (text, columns) in FOREIGN.items()
    }
    lines = tn.sample_path("plate/first.csv").read_text().splitlines()[:6]
    europe = "\n".join([*lines, ",,,", ""]).replace(",", ";").replace(".", ",")
    found["semicolons"] = (tn.read_points, europe.encode())
    found["tabs"] = (tn.read, codecs.BOM_UTF16_LE + europe.replace(";", "\t").encode("utf-16-le"))
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("points")
    for line in lines:
        sheet.append(line.split(","))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "points.xlsx")
        book.save(path)
        found["workbook"] = (tn.read, path.read_bytes())
        path = Path(folder, "touches.parquet")
        _cross()[0][:4].to_pandas().to_parquet(path)
        found["parquet"] = (tn.read, path.read_bytes())
    return found


def _cross() -> tuple[tn.Touches, tn.Setup]:
    folder = tn.sample_path("cross")
    return tn.read_touches(folder / "touches.csv"), tn.read_setup(folder / "setup.toml")


def _half(_: Any, x: float) -> float:
    return x / 2


def mutated(good: bytes, rng: random.Random) -> bytes:
    """Return a file with one to four places broken."""
    raw = good
    for _ in range(rng.choice((1, 1, 2, 4))):
        start = rng.randrange(len(raw) + 1)
        end = start + rng.choice((0, 0, 1, 2, 6, 40))
        way = rng.random()
        piece = rng.choice(PIECES) if way < 0.5 else rng.randbytes(rng.randrange(5))
        if way > 0.8 and raw:  # a piece of the file again, elsewhere
            begin = rng.randrange(len(raw))
            piece = raw[begin : begin + rng.randrange(60)]
        raw = raw[:start] + piece + raw[end:]
    return raw[: rng.randrange(len(raw) + 1)] if rng.random() < 0.05 else raw


def mutations(count: int, seed: int) -> Iterator[str]:
    """Read so many mutated files, from memory where the system allows; yield what went wrong."""
    rng = random.Random(seed)
    table = list(formats().items())
    with _folder() as folder:
        path = Path(folder, "file")
        for number in range(count):
            if number % WATCHED == 0:
                faulthandler.dump_traceback_later(MAX_SECONDS, exit=True)
            name, (reader, good) = table[number % len(table)]
            path.write_bytes(mutated(good, rng))
            yield from _wrong(f"{name}({number})", partial(_read, reader, name), path, str(path))
    faulthandler.cancel_dump_traceback_later()


def _read(reader: Callable[[Path], object], name: str, path: Path) -> None:
    found = reader(path)
    # keys of a set-up are checked when they are used
    if not isinstance(found, tn.Setup) and not name.startswith("netCDF") and holds_nan(found):
        raise _NanError


class _NanError(Exception):
    """A result that holds nan."""


def _folder() -> tempfile.TemporaryDirectory[str]:
    """Return a folder in memory where the system allows."""
    return tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None)


def _wrong(what: str, call: Callable[[Path], None], path: Path, place: str) -> Iterator[str]:
    """Yield what a call on a file does but return or refuse it with a place."""
    try:
        call(path)
    except tn.TrunnionError as error:
        if place not in str(error):
            yield f"{what}: without a place: {error!s:.150}"
    except _NanError:
        yield f"{what}: nan"
    except BaseException as error:
        yield f"{what}: {type(error).__name__}: {error!s:.150}"


# --- mutated data, diagnosed

MAX_ROWS = 60
MAX_ROWS_OF_LOG = 30
"""Rows of a file that is diagnosed; an axis log takes a second."""

CELLS = (
    *("0", "-0.0", "1", "-1", "1e-9", "-1e-9", "5e-324", "1e-300", "0.5", "1000", "-1000"),
    *("1e6", "-1e6", "1e5", "999999.999", "360", "-360", "1e8", "1e300", "-1e300"),
)
"""Numbers that a cell may hold: readers refuse some of them in some columns."""


@cache
def measurements() -> dict[str, tuple[Kind, Any, list[list[str]]]]:
    """A small file of each kind of data, in cells, with its set-up."""
    found = {}
    for kind in kinds():
        for example in kind.examples:
            data, setup = resolve_name(example)()[:2]
            rows = MAX_ROWS_OF_LOG if kind.name == "axislog" else MAX_ROWS
            lines = data[:rows].to_csv().splitlines()
            found[example.split(":")[1]] = kind, setup, [line.split(",") for line in lines]
    return found


def changed(cells: list[list[str]], rng: random.Random) -> list[list[str]]:
    """Return a file of which one to three cells, rows or columns are others, all well formed."""
    head, *rows = [list(row) for row in cells]
    for _ in range(rng.choice((1, 1, 2, 3))):
        column, at, way = rng.randrange(len(head)), rng.randrange(len(rows)), rng.randrange(9)
        some = rng.sample(range(len(rows)), rng.randrange(1, len(rows) + 1))
        if way == 0:
            rows[at][column] = rng.choice(CELLS)
        elif way == 1:  # a column, or a part of it, all alike
            value = rng.choice([*CELLS, rows[at][column]])
            for i in some if rng.random() < 0.5 else range(len(rows)):
                rows[i][column] = value
        elif way == 2:  # in another unit, or shifted
            factor, shift = rng.choice((-1.0, 1e3, 1e-3, 25.4, 1e-9)), rng.choice((0.0, 1e5))
            for each in rows:
                with suppress(ValueError):
                    each[column] = repr(factor * float(each[column]) + shift)
        elif way == 3:  # rounded
            for each in rows:
                with suppress(ValueError):
                    each[column] = repr(float(round(float(each[column]), rng.choice((0, 1, 3)))))
        elif way == 4:
            rows = [rows[i] for i in sorted(some)]
        elif way == 5:
            rows += [list(rows[i]) for i in some]
        elif way == 6 and len(head) > 1:
            head, rows = (
                [name for i, name in enumerate(head) if i != column],
                [[cell for i, cell in enumerate(each) if i != column] for each in rows],
            )
        elif way == 7:
            rng.shuffle(rows)
        else:  # two columns for each other
            other = rng.randrange(len(head))
            for each in rows:
                each[column], each[other] = each[other], each[column]
    return [head, *rows[: 2 * MAX_ROWS]]


def diagnoses(count: int, seed: int) -> Iterator[str]:
    """Diagnose so many mutated files of all kinds of data; yield what went wrong.

    Half of them are broken by bytes, as those that are only read; the others are well formed.
    """
    rng = random.Random(seed)
    table = list(measurements().items())
    with _folder() as folder:
        path = Path(folder, "mutated.csv")
        for number in range(count):
            name, (kind, setup, cells) = table[number % len(table)]
            well_formed = rng.random() < 0.7
            cells = changed(cells, rng) if well_formed else cells
            raw = "\n".join(",".join(row) for row in cells).encode()
            path.write_bytes(raw if well_formed else mutated(raw, rng))
            faulthandler.dump_traceback_later(MAX_SECONDS, exit=True)
            call = partial(_diagnose, kind, setup)
            yield from _wrong(f"{name}({number})", call, path, path.name)
    faulthandler.cancel_dump_traceback_later()


def _diagnose(kind: Kind, setup: Any, path: Path) -> None:
    """Diagnose a file: everything that is said of it is text, and JSON that others read."""
    found = tn.diagnose(kind.read(path), setup)
    said = json.loads(found.to_json(), parse_constant=_no_json)
    del said["data"]  # labels may be any text
    if holds_nan(found) or "nan" in map(str.lower, _texts(said)):
        raise _NanError
    if any(word in found.summary().split() for word in ("nan", "inf", "-inf", "±inf")):
        raise _NanError


def _no_json(constant: str) -> None:
    raise AssertionError(f"{constant} is no JSON")


def _texts(value: Any) -> Iterator[str]:
    """Yield every text in plain values."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)

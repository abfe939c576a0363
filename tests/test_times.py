"""Times that stand still or run backwards are said wherever a change with time is looked for."""

from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.models.kinds import Kind, kinds

CASES = [
    pytest.param(kind, example, id=example.split(":")[1])
    for kind in kinds()
    for example in kind.examples
]
MUST_RISE = ("ballbar", "axislog")
"""Kinds whose rows are taken in the order of time: falling times are errors."""


def measured(example: str) -> tuple[Any, Any]:
    """A small measurement of a kind with every column, and its set-up."""
    return tuple(resolve_name(example)()[:2])


def read_with(data: Any, time_s: Any, kind: Kind, tmp_path: Path) -> Any:
    """Data with other times, from a file."""
    path = tmp_path / "times.csv"
    lines = data.to_csv().splitlines()
    column = lines[0].split(",").index("time_s")
    rows = [line.split(",") for line in lines[1:]]
    for row, time in zip(rows, time_s, strict=True):
        row[column] = repr(float(time))
    path.write_text("\n".join([lines[0], *(",".join(row) for row in rows)]))
    return kind.read(path)


def test_every_kind_has_times() -> None:
    assert all("time_s" in measured(example)[0] for kind in kinds() for example in kind.examples)


@pytest.mark.parametrize(("kind", "example"), CASES)
def test_times_that_stand_still_are_said(kind: Kind, example: str, tmp_path: Path) -> None:
    data, setup = measured(example)
    still = np.full(len(data), 7.0)
    if kind.name == "axislog":  # a position loop needs time
        with pytest.raises(tn.FileFormatError, match=r"times\.csv:3:\d+: time_s: got 7 after 7"):
            read_with(data, still, kind, tmp_path)
        return
    found = tn.diagnose(read_with(data, still, kind, tmp_path), setup)
    assert found.notes[0] == "time_s is 7 in every row: no change with time can be found."
    rising = tn.diagnose(data, setup)
    assert not any("time_s" in note for note in rising.notes)


@pytest.mark.parametrize(("kind", "example"), CASES)
def test_times_that_fall_are_said_or_refused(kind: Kind, example: str, tmp_path: Path) -> None:
    data, setup = measured(example)
    falling = np.arange(len(data))[::-1] * 10.0
    if kind.name in MUST_RISE:
        with pytest.raises(tn.TrunnionError, match=r"time_s.*got \d+ after") as error:
            tn.diagnose(read_with(data, falling, kind, tmp_path), setup)
        assert "times.csv" in str(error.value)
        return
    found = tn.diagnose(read_with(data, falling, kind, tmp_path), setup)
    # rows of a turned part may be in any order
    assert ("time_s falls from every row" in " ".join(found.notes)) == (kind.name != "diameters")


def test_times_that_stand_still_within_each_pass_are_said() -> None:
    data, setup = measured("trunnion.models.examples:diameters")
    passes = np.unique(data["pass"], return_inverse=True)[1]
    (note,) = tn.diagnose(data.with_columns(time_s=60.0 * passes), setup).notes[:1]
    assert note == (
        "time_s is the same in all rows of each pass: no change with time within a pass can be "
        "found."
    )


def test_times_that_stand_still_are_said_of_each_of_several() -> None:
    data, setup = measured("trunnion.models.examples:touches")
    off = 1e-4 * np.random.default_rng(1).standard_normal(len(data))
    still = data.with_columns(time_s=np.full(len(data), 7.0), x_mm=data["x_mm"] + off)
    notes = " ".join(tn.diagnose([data, still], setup).notes)
    assert notes.count("time_s is 7 in every row") == 1


def test_an_effect_of_time_on_times_that_stand_still_is_said() -> None:
    data, setup = measured("trunnion.models.examples:touches")
    still = data.with_columns(time_s=np.full(len(data), 7.0))
    said = "time_s is 7 in every row: no change with time can be found."
    assert said in tn.identify(still, setup, ["drift_z"]).notes
    assert said not in tn.identify(still, setup).notes
    assert said not in tn.identify(data, setup, ["drift_z"]).notes


@pytest.mark.parametrize(("kind", "example"), CASES)
def test_times_that_begin_again_are_said_with_the_row(
    kind: Kind, example: str, tmp_path: Path
) -> None:
    """A logger that was started again counts from zero; rows of a turned part are in any order."""
    data, setup = measured(example)
    rows = np.arange(len(data))
    again = 10.0 * (rows % (2 * len(data) // 3))
    if kind.name in MUST_RISE:  # refused within a run, of which each may have its own clock
        return
    notes = " ".join(tn.diagnose(read_with(data, again, kind, tmp_path), setup).notes)
    line = 2 + 2 * len(data) // 3
    said = f"to 0 at line {line} of times.csv: was the recording started again there?"
    assert (said in notes) == (kind.name != "diameters")

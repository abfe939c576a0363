"""Times as instruments and spreadsheets write them: dates with times of day."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import trunnion as tn

SAMPLE = tn.sample_path("positioning/axis.csv")
START = datetime(2026, 3, 29, 1, 59, 30)  # the day on which many clocks are set


def with_stamps(
    folder: Path, said: Callable[[datetime, int], str], column: str = "time_s"
) -> tuple[Path, tn.Positioning]:
    table = tn.read_positioning(SAMPLE)
    frame = table.to_dataframe()
    stamps = [said(START + timedelta(seconds=s), row) for row, s in enumerate(frame["time_s"])]
    frame = frame.drop(columns="time_s").assign(**{column: stamps})
    frame.to_csv(folder / "axis.csv", index=False)
    return folder / "axis.csv", table


@pytest.mark.parametrize("column", ["time_s", "Zeitstempel"])
@pytest.mark.parametrize("style", ["{:%Y-%m-%dT%H:%M:%S.%f}", "{:%Y-%m-%d %H:%M:%S.%f}+01:00"])
def test_stamps_are_seconds_since_the_first(tmp_path: Path, style: str, column: str) -> None:
    path, table = with_stamps(tmp_path, lambda time, _: style.format(time), column)
    found = tn.read_positioning(path)
    assert table.time_s is not None
    assert found.time_s is not None
    np.testing.assert_allclose(found.time_s, table.time_s - table.time_s[0], atol=2e-6)
    assert found.recognised is not None
    assert "seconds since 2026-03-29" in found.recognised.clock
    assert dict(found.recognised.columns) == ({} if column == "time_s" else {"time_s": column})


def test_of_a_data_frame() -> None:
    table = tn.read_positioning(SAMPLE)
    frame = table.to_dataframe()
    frame["time_s"] = pd.Timestamp(START) + pd.to_timedelta(frame["time_s"], unit="s")
    assert table.time_s is not None
    found = tn.Positioning(frame).time_s
    assert found is not None
    np.testing.assert_allclose(found, table.time_s - table.time_s[0], atol=2e-6)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (lambda t, row: t.isoformat() + "+01:00" * (row == 7), "9:.*a time zone in every row"),
        (lambda t, row: t.isoformat() if row else "2026-13-40T10:00:00", "2:.*a time that there"),
        (lambda t, row: t.isoformat() if row != 4 else "3.5", "6:.*in every row"),
        (lambda t, _: f"{t:%d.%m.%Y %H:%M:%S}", "2:.*as in 2026-11-22T10:30:00"),
    ],
)
def test_what_is_no_time_is_refused_with_its_place(
    tmp_path: Path, said: Callable[[datetime, int], str], expected: str
) -> None:
    path, _ = with_stamps(tmp_path, said)
    with pytest.raises(tn.FileFormatError, match=f"axis.csv:{expected}"):
        tn.read_positioning(path)

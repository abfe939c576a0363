"""Measurements of a list are in the order of time; where their dates are known, this is checked."""

from __future__ import annotations

import pickle
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app

EXPECTED = (
    r"^measurements: got new\.csv, which ended 2025-05-01 \d\d:\d\d:\d\d, after old\.csv, which "
    r"began 2026-05-01 00:00:00, expected them in the order of time: .* By their dates: "
    r"new\.csv, old\.csv$"
)


def stops(seed: int, scale_ppm: float) -> tn.Positioning:
    """Two cycles there and back over 500 mm, in 10 s a stop."""
    target = np.tile(np.r_[np.arange(11) * 50.0, np.arange(10, -1, -1) * 50.0], 2)
    off = 1e-6 * scale_ppm * target + np.random.default_rng(seed).normal(0, 4e-4, len(target))
    return tn.Positioning(
        target_mm=target,
        measured_mm=target + off,
        direction=np.tile(np.repeat([1, -1], 11), 2),
        cycle=np.repeat([1, 2], 22),
        time_s=10.0 * np.arange(len(target)),
    )


def dated(measured: tn.Positioning, date: str) -> pd.DataFrame:
    """The same with dates."""
    frame = measured.to_dataframe()
    frame["time_s"] = pd.Timestamp(date) + pd.to_timedelta(frame["time_s"], unit="s")
    return frame


def saved(folder: Path, name: str, date: str, scale_ppm: float = 30.0) -> Path:
    frame = dated(stops(sum(map(ord, name)), scale_ppm), date)
    frame["time_s"] = frame["time_s"].map(lambda time: time.isoformat())
    frame.to_csv(folder / name, index=False)
    return folder / name


def test_files_whose_dates_fall_are_refused(tmp_path: Path) -> None:
    old, new = saved(tmp_path, "old.csv", "2026-05-01"), saved(tmp_path, "new.csv", "2025-05-01")
    both = tn.read(old), tn.read(new)
    for evaluate in (lambda: tn.diagnose(list(both)), lambda: tn.compare(*both)):
        with pytest.raises(tn.InputError, match=EXPECTED):
            evaluate()
    assert tn.diagnose(list(both[::-1])).verdict
    assert tn.compare(*both[::-1])
    for command in (["diagnose", "--joint"], ["compare"]):
        done = CliRunner().invoke(app, [*command, str(old), str(new)])
        assert done.exit_code != 0
        assert "expected them in the order of time" in " ".join(done.output.split())


def test_frames_with_dates_are_checked_too() -> None:
    late, early = dated(stops(1, 30.0), "2026-05-01"), dated(stops(2, 41.0), "2025-05-01")
    with pytest.raises(tn.InputError, match=r"got measurement 2, which ended 2025.* after measu"):
        tn.diagnose([tn.Positioning(late), tn.Positioning(early)])


@pytest.mark.parametrize("second", ["2026-05-01T00:02:00", "2026-05-01", "2026-06-01"])
def test_dates_that_overlap_or_are_equal_are_taken(second: str) -> None:
    one, other = (
        tn.Positioning(dated(stops(i, 30.0), d)) for i, d in ((1, "2026-05-01"), (2, second))
    )
    assert tn.diagnose([one, other]).verdict


def test_one_without_a_date_and_zones_that_cannot_be_compared_are_taken() -> None:
    plain, early = stops(3, 30.0), tn.Positioning(dated(stops(4, 30.0), "2025-05-01"))
    frame = dated(stops(5, 30.0), "2026-05-01T00:00:00+02:00")
    zoned = tn.Positioning(frame.assign(time_s=[time.isoformat() for time in frame["time_s"]]))
    assert tn.diagnose([plain, early]).verdict
    assert tn.diagnose([zoned, early]).verdict


def test_the_date_goes_with_the_data(tmp_path: Path) -> None:
    read: Any = tn.read(saved(tmp_path, "old.csv", "2026-05-01"))
    when = datetime(2026, 5, 1)
    for made in (read, read[4:], read.with_columns(axis=["X"] * len(read))):
        assert made.began == when
        assert pickle.loads(pickle.dumps(made)).began == when
    assert read.with_columns(time_s=np.arange(float(len(read)))).began is None
    assert stops(1, 30.0).began is None

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


@pytest.mark.parametrize("zone", ["", "+00:00", "+02:00"])
def test_dates_come_back_from_files(zone: str, tmp_path: Path) -> None:
    read: Any = tn.read(saved(tmp_path, "old.csv", "2026-05-01T00:00:00.25" + zone))
    for name in ("a.csv", "a.parquet", "a.xlsx", "a.json"):
        path = read.save(tmp_path / name)
        again = tn.Positioning.from_json(path) if path.suffix == ".json" else tn.read(path)
        assert again.began == read.began, name
        np.testing.assert_array_equal(again.time_s, read.time_s)
        assert again == read or path.suffix == ".xlsx"  # which has 16 digits
    part: Any = read[4:]
    part.to_csv(tmp_path / "part.csv")
    again = tn.read(tmp_path / "part.csv")
    assert (again.began - read.began).total_seconds() == part.time_s[0]
    assert again.time_s == pytest.approx(part.time_s - part.time_s[0])
    plain = stops(1, 30.0)
    plain.to_csv(tmp_path / "plain.csv")
    assert tn.read(tmp_path / "plain.csv") == plain
    assert "began" not in plain.to_json()


def test_dates_come_back_with_a_diagnosis() -> None:
    data = tn.Positioning(dated(stops(6, 30.0), "2026-05-01"))
    found = tn.Diagnosis.from_json(tn.diagnose(data).to_json())
    assert found.data.began == data.began


def test_tables_that_are_joined_have_one_clock() -> None:
    old: Any = tn.Positioning(dated(stops(7, 30.0), "2025-05-01"))
    new: Any = tn.Positioning(dated(stops(7, 30.0), "2026-05-01"))
    whole: Any = tn.Positioning.concatenate([old, new])
    year = 365 * 86400.0
    assert whole.began == old.began
    np.testing.assert_array_equal(whole.time_s, np.r_[old.time_s, new.time_s + year])
    back = tn.Positioning.concatenate([new, old])
    np.testing.assert_array_equal(back.time_s, np.r_[new.time_s, old.time_s - year])
    halves = tn.Positioning.concatenate([old[:9], old[9:]])
    assert halves == old
    assert halves.began == old.began
    plain = stops(7, 30.0)
    zoned = tn.Positioning(dated(stops(7, 30.0), "2026-05-01T00:00:00+02:00"))
    for pair in ([old, plain], [plain, new], [old, zoned]):
        mixed = tn.Positioning.concatenate(pair)
        assert mixed.began is None
        np.testing.assert_array_equal(mixed.time_s, np.r_[plain.time_s, plain.time_s])


def test_a_frame_with_a_time_zone_is_taken() -> None:
    frame = dated(stops(8, 30.0), "2026-05-01T00:00:00+02:00")
    made = tn.Positioning(frame)
    assert made == stops(8, 30.0)
    assert made.began == datetime.fromisoformat("2026-05-01T00:00:00+02:00")
    assert tn.Positioning(frame.assign(time_s=[t.to_pydatetime() for t in frame["time_s"]])) == made
    assert tn.diagnose(frame).verdict
    frame.loc[3, "time_s"] = pd.NaT
    with pytest.raises(
        tn.InputError, match=r"^time_s \(row 3\): got .* expected a date with a time"
    ):
        tn.Positioning(frame)

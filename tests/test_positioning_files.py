"""What files of positioning data get wrong, and what is said of it."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from positioning_twin import axis
from trunnion.cli import app


def text_of(data: tn.Positioning) -> str:
    rows = zip(data.cycle, data.direction, data.target, data.measured, strict=True)
    lines = [f"{c},{d},{t:.4f},{m:.5f}\n" for c, d, t, m in rows]
    return "cycle,direction,target_mm,measured_mm\n" + "".join(lines)


def said(*words: str | Path) -> str:
    return " ".join(CliRunner().invoke(app, list(map(str, words))).output.split())


def test_pasted_rows_count_once(tmp_path: Path) -> None:
    data = axis(np.random.default_rng(4))
    pasted = tn.Positioning.concatenate([data[:44], data[22:44], data[44:]])
    once, twice = data.iso230_2(), pasted.iso230_2()
    assert twice.accuracy_um == once.accuracy_um
    assert twice.repeatability_um == once.repeatability_um
    assert twice.notes == (
        "22 of 132 rows repeat others in every column (pasted twice, or alike in steps?): "
        "each counts once.",
    )
    path = tmp_path / "stops.csv"
    pasted.to_csv(path)
    assert "22 of 132 rows repeat others" in said("positioning", "results", path)
    assert "repeat others" not in once.summary()


def test_repeats_that_look_alike_count_where_nothing_numbers_them() -> None:
    """One number for all cycles, and a display in steps of 2 µm: rows are alike by chance."""
    data = axis(np.random.default_rng(4)).with_columns(time_s=None)
    coarse = np.round(data.measured / 2e-3) * 2e-3
    one = data.with_columns(measured_mm=coarse, cycle=np.ones(len(data), dtype=int))
    many = data.with_columns(measured_mm=coarse)
    assert one.iso230_2().repeatability_um == many.iso230_2().repeatability_um
    assert not one.iso230_2().notes


def test_a_cycle_copied_to_another_number_counts_once() -> None:
    """A copy has no scatter of its own: with it repeatability would come out too small."""
    data = axis(np.random.default_rng(4)).with_columns(time_s=None)
    last = data[data.cycle == 5]
    copied = tn.Positioning.concatenate(
        [data, *(last.with_columns(cycle=np.full(len(last), k)) for k in (6, 7, 8))]
    )
    once, again = data.iso230_2(), copied.iso230_2()
    assert again.repeatability_um == once.repeatability_um
    assert again.std_errors == once.std_errors
    assert again.notes == (
        "66 of 176 rows repeat others to the last digit under another cycle (copied, or alike in "
        "steps?): each counts once.",
    )
    # Honest repeats in steps agree in many stops, and stay.
    coarse = data.with_columns(measured_mm=np.round(data.measured / 2e-3) * 2e-3)
    assert not coarse.iso230_2().notes


def test_cycles_that_are_all_alike_show_no_repeatability() -> None:
    data = axis(np.random.default_rng(4)).with_columns(time_s=None)
    first = data[data.cycle == 1]
    copied = tn.Positioning.concatenate(
        [first.with_columns(cycle=np.full(len(first), k)) for k in (1, 2, 3)]
    )
    found = copied.iso230_2()
    assert found.spread_forward == pytest.approx(0.0, abs=1e-9)
    assert "Every cycle repeats the first to the last digit" in found.notes[0]


@pytest.mark.parametrize("cut", [2, 5, 6, 7])
def test_a_file_cut_in_its_last_number(cut: int, tmp_path: Path) -> None:
    """The last target is near 0: its number has 7 characters or 8, of 500.00200 it has 9."""
    data = axis(np.random.default_rng(3))
    data = data.with_columns(
        target_mm=data.target + 100, measured_mm=data.measured + 100, time_s=None
    )
    path, whole = tmp_path / "stops.csv", text_of(data)
    last = whole.rsplit(",", 1)[1].strip()
    path.write_text(whole[: -1 - cut])
    expected = f"Line 111 has no end, and its last number '{last[:-cut]}' is shorter"
    shortest = min(len(line.rsplit(",", 1)[1]) for line in whole.split()[1:-1])
    assert (expected in said("read", path)) == (len(last) - cut < shortest)
    assert expected in said("positioning", "results", path)
    assert expected in said("diagnose", path)
    path.write_text(whole[:-1])
    assert "has no end" not in said("read", path)


def test_a_number_for_all_rows(tmp_path: Path) -> None:
    data = axis(np.random.default_rng(3))
    forward = data[data.direction > 0]
    path, out = tmp_path / "stops.csv", tmp_path / "out.csv"
    path.write_text(text_of(forward).replace(",direction", ",1"))
    words: list[str | Path] = ["read", path, "--column", "direction=1", "--column", "cycle=cycle"]
    words += ["--column", "target_mm=target_mm", "--column", "measured_mm=measured_mm"]
    said(*words, "-o", out)  # a channel of this name comes first
    assert tn.read(out).direction.tolist() == forward.direction.tolist()
    words[3] = "direction=-1"
    said(*words, "-o", out, "--force")
    assert set(tn.read(out).direction.tolist()) == {-1}
    with pytest.raises(tn.UnknownNameError, match="sense"):
        tn.read(path, columns={"direction": "sense", "target_mm": "target_mm"})

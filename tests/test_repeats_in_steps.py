"""Readings in steps that were taken several times: what is a copy, and what is found in noise."""

import numpy as np
import pytest

import trunnion as tn
from power.steps import RATIOS, ROWS, Read, plate, stops, tally
from promise import kept, needed_runs
from trunnion.base.repeats import within_groups
from trunnion.data.distinct import distinct_rows


def plates(noise: float, step: float, seed: int = 3) -> tn.Points:
    """A plate measured three times; nothing is rounded where the step is small."""
    return plate(Read(np.random.default_rng(seed), noise / step, step), placed_once=True)


def together(*tables: tn.Points) -> tn.Points:
    return tn.Points({k: np.concatenate([t.columns[k] for t in tables]) for k in tables[0].columns})


# --- copies


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.3, 1.0])
def test_repeats_that_agree_in_steps_are_kept_where_others_differ(noise: float) -> None:
    partly = 0
    for seed in range(6):
        data = plates(noise, 1.0, seed)
        own = len(np.unique(np.stack([*data.columns.values()]), axis=1).T)
        found = distinct_rows(data)
        assert len(found.data) == (49 if own == 49 else len(data))  # placed far from all edges
        assert bool(found.notes) == (own == 49)
        partly += 49 < own < len(data)
    assert partly > 2


def test_rows_pasted_twice_are_copies_beside_honest_repeats() -> None:
    """To 1 nm no repeats agree by chance; in steps of a tenth of the noise hardly so many."""
    for step in (1e-3, 0.1):
        data = plates(1.0, step)
        found = distinct_rows(together(data, data[:60]))
        assert len(found.data) == len(data)
        assert "60 of 207 rows repeat others in every column" in found.notes[0]


@pytest.mark.parametrize("digits", [3, 4])
@pytest.mark.parametrize("shuffled", [False, True])
def test_rows_pasted_from_a_rounded_table_are_copies(digits: int, shuffled: bool) -> None:
    """They were repeats that agree far better than the model misses them: unexplained."""
    data = plates(1.5, 1e-6)
    order = np.random.default_rng(2).permutation(len(data)) if shuffled else np.arange(len(data))
    copy = {k: np.round(v, digits) if v.dtype.kind == "f" else v for k, v in data.columns.items()}
    both = together(data, tn.Points(copy)[order])
    found = distinct_rows(both)
    assert found.rows is not None
    assert found.rows.tolist() == list(range(len(data)))
    assert "rows repeat others with fewer digits" in found.notes[-1]
    assert tn.diagnose(both).errors_std == tn.diagnose(data).errors_std


@pytest.mark.parametrize("rows", [12, 147])
def test_a_few_rows_with_one_digit_fewer_are_copies(rows: int) -> None:
    """Two digits had to be missing, of 20 rows: two readings of a row agree by chance as seldom."""
    data = plates(1.5, 1e-2)
    copy = {k: np.round(v, 4) if v.dtype.kind == "f" else v for k, v in data.columns.items()}
    found = distinct_rows(together(data, tn.Points(copy)[:rows]))
    assert len(found.data) == len(data)
    assert f"{rows} of {rows + 147} rows repeat others with fewer digits" in found.notes[-1]


@pytest.mark.parametrize("noise", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("digits", [1, 2, 3])
def test_honest_repeats_of_a_rounded_instrument_are_no_copies(noise: float, digits: int) -> None:
    """The second half of a session was noted with fewer digits; or numbers end in zeros."""
    for seed in range(4):
        data = plates(noise, 1e-6, seed)
        again = plates(noise, 1e-6, seed + 50)
        rounded = {k: np.round(v, digits) for k, v in again.readings.items()}
        if noise >= 10.0 ** (3 - digits):  # else they say no more than the others
            found = distinct_rows(together(data, again.with_columns(**rounded)))
            assert "fewer digits" not in " ".join(found.notes)
        steps = {k: np.round(v * 20, digits) / 20 for k, v in data.readings.items()}
        found = distinct_rows(data.with_columns(**steps))
        assert "fewer digits" not in " ".join(found.notes)


def test_repeats_that_all_agree_count_once() -> None:
    found = distinct_rows(plates(0.0, 1.0))
    assert len(found.data) == 49
    assert "98 of 147 rows" in found.notes[0]


@pytest.mark.parametrize(("noise", "step", "kept_rows"), [(0.1, 1.0, 110), (1.0, 0.1, 88)])
def test_a_cycle_that_is_another_is_a_copy_where_the_others_differ(
    noise: float, step: float, kept_rows: int
) -> None:
    """Of five cycles the third is the second: of those that agree row by row, by chance."""
    made = stops(Read(np.random.default_rng(0), noise / step, step), off_grid=False)
    measured = np.array(made.measured_mm)
    measured[44:66] = measured[22:44]
    found = distinct_rows(made.with_columns(measured_mm=measured))
    assert len(found.data) == kept_rows


def test_cycles_alike_before_and_after_a_change_are_no_copies() -> None:
    """Noise moves as many readings up as down, a machine that drifts moves all one way."""
    made = stops(Read(np.random.default_rng(0), 0.0, 1.0), off_grid=False)
    measured = np.array(made.measured_mm)
    drifted = measured - 1e-3 * (np.arange(110) > 50)  # in the third of five cycles
    assert len(distinct_rows(made.with_columns(measured_mm=drifted)).data) == 110
    noisy = measured + 1e-3 * np.random.default_rng(1).standard_normal(110)
    noisy[44:66] = noisy[22:44]
    found = distinct_rows(made.with_columns(measured_mm=noisy))
    assert len(found.data) == 88


@pytest.mark.parametrize(("noise", "kept_rows"), [(0.0, 110), (1.0, 22), (3.0, 22)])
def test_cycles_that_are_all_alike_are_copies_where_one_shows_noise(
    noise: float, kept_rows: int
) -> None:
    """An axis whose noise no step shows repeats to the last digit: 7 of 30 curves were missed."""
    made = stops(Read(np.random.default_rng(4), noise, 1.0), off_grid=False)
    measured = np.array(made.target) + np.tile(made.deviation[:22] * 1e-3, 5)
    found = distinct_rows(made.with_columns(measured_mm=np.round(measured, 3)))
    assert len(found.data) == kept_rows
    assert "to the last digit" in found.notes[0]


def test_a_curve_of_less_than_a_step_that_repeats_is_a_curve() -> None:
    made = stops(Read(np.random.default_rng(4), 0.0, 1.0), off_grid=False)
    curve = np.where(np.abs(made.target - 200.0) < 80.0, 1.0, 0.0)
    d = tn.diagnose(made.with_columns(measured_mm=made.target + 1e-3 * curve))
    assert any("curve" in causes for causes in d.alternatives)
    assert any("show no repeatability" in note for note in d.notes)


# --- what repeats share


def test_labels_within_groups() -> None:
    label, groups = np.array([0, 0, 0, 1, 1, -1]), np.array([0, 0, 1, 0, 1, 1])
    found = within_groups(label, groups)
    assert found[0] == found[1] >= 0
    assert np.all(found[2:] == -1)


def test_nothing_is_found_in_repeats_in_steps() -> None:
    """All kinds and ratios of noise and step together; each by itself is in `make power-steps`."""
    cells = [(name, ratio) for name in ROWS for ratio in RATIOS]
    each = -(-needed_runs(0.95) // len(cells))
    seen = [tally(name, ratio, each, seed=11) for name, ratio in cells]
    runs = sum(t.runs for t in seen)
    assert kept(runs - sum(t.false for t in seen), runs, 0.95)
    assert kept(runs - sum(t.loud for t in seen), runs, 0.95)


@pytest.mark.power
@pytest.mark.parametrize("name", list(ROWS))
def test_nothing_is_found_in_repeats_of_a_kind(name: str) -> None:
    each = -(-needed_runs(0.95) // len(RATIOS))
    seen = [tally(name, ratio, each, seed=12) for ratio in RATIOS]
    runs = sum(t.runs for t in seen)
    assert kept(runs - sum(t.false for t in seen), runs, 0.95)

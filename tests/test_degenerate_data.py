"""Data that hardly say anything get no cause, and never one with a vanishing standard error."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from promise import kept, needed_runs

PROMISE = 0.95
RUNS = needed_runs(PROMISE)


def ballbar(tip_mm: np.ndarray, noise_um: float, seed: int) -> tn.Ballbar:
    """A bar about the origin at these places, in one turn of one sense."""
    n = len(tip_mm)
    noise = 1e-3 * np.random.default_rng([3, seed]).normal(0.0, noise_um, n)
    return tn.Ballbar(
        {f"{axis}_mm": tip_mm[:, i] for i, axis in enumerate("xyz")},
        setup=np.zeros(n, dtype=int),
        length_mm=np.linalg.norm(tip_mm, axis=1) + noise,
        sense=np.ones(n, dtype=int),
        feed_mm_min=np.full(n, 600.0),
        time_s=1.0 * np.arange(n),
    )


def circle(count: int) -> np.ndarray:
    turn = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    return np.column_stack([100 * np.cos(turn), 100 * np.sin(turn), 0 * turn])


LINE = np.column_stack([np.linspace(99.0, 101.0, 60), np.zeros(60), np.zeros(60)])


@pytest.mark.parametrize(
    ("tip_mm", "noise_um"),
    [
        pytest.param(circle(12), 0.5, id="12 readings"),
        pytest.param(circle(144), 1e-9, id="noise of 1e-9 um, rounding of the file"),
        pytest.param(LINE, 0.5, id="along a line"),
        pytest.param(LINE, 0.0, id="along a line, exact"),
    ],
)
def test_a_ballbar_that_says_little_has_no_cause(
    tip_mm: np.ndarray,
    noise_um: float,
) -> None:
    found = [tn.diagnose(ballbar(tip_mm, noise_um, seed)) for seed in range(RUNS)]
    assert kept(sum(d.verdict == "consistent" for d in found), RUNS, PROMISE)
    for cause in (cause for d in found for cause in d.causes):
        size = max(map(abs, cause.parameters.values()))
        assert all(std > 1e-6 * size for std in cause.std_errors.values())


KINDS = ["ballbar/circle", "levels/bed", "plate/first", "axis/sweep", "positioning/axis"]


@pytest.mark.parametrize("file", KINDS)
def test_the_first_rows_of_any_kind_give_a_diagnosis_or_a_refusal(file: str) -> None:
    """Rounded readings with next to no freedom ended in an error that was not the package's."""
    data = tn.read(tn.sample_path(f"{file}.csv"))
    for count in range(1, 13):
        for rows in (np.arange(count), np.random.default_rng(count).permutation(len(data))[:count]):
            with suppress(tn.TrunnionError):
                assert tn.diagnose(data[np.sort(rows)]).sentences()


def test_an_error_of_the_ballbar_is_found_where_there_are_readings_enough() -> None:
    """The other side: what leaves twelve readings alone is named on a circle of 144."""
    tip = circle(144)
    data = ballbar(tip, 0.5, 1)
    off_mm = 50e-6 * tip[:, 0] ** 2 / 100.0  # X is 50 ppm long
    d = tn.diagnose(data.with_columns(length_mm=data.length_mm + off_mm))
    assert d.verdict == "explained"


TURNED = tn.sample_path("turning")


def test_diameters_with_negative_z_are_refused() -> None:
    """Z counts from the chuck outward; mirrored data had a cause of their own without a doubt."""
    data = tn.read_diameters(TURNED / "diameters.csv")
    setup = tn.read_setup(TURNED / "setup.toml")
    row = int(np.argmax(data.z_mm))
    where = (
        rf"line {row + 2} of diameters\.csv\): got -{data.z_mm[row]:g}.*, expected 0 \(the chuck"
    )
    with pytest.raises(tn.DataError, match=where):
        tn.diagnose(data.with_columns(z_mm=-data.z_mm), setup)


def test_every_row_of_a_pass_given_five_times_counts_once() -> None:
    """In blocks or row by row: the verdict, the causes and their sizes are those of one."""
    data = tn.read_diameters(TURNED / "diameters.csv")
    setup = tn.read_setup(TURNED / "setup.toml")
    once = tn.diagnose(data, setup)
    for five in (data[np.tile(np.arange(len(data)), 5)], data[np.repeat(np.arange(len(data)), 5)]):
        d = tn.diagnose(five, setup)
        assert d.notes[0].startswith(f"{4 * len(data)} of {5 * len(data)} rows repeat others")
        assert (d.verdict, d.named, d.alternatives) == (once.verdict, once.named, once.alternatives)
        for cause, same in zip(d.causes, once.causes, strict=True):
            assert cause.std_errors == pytest.approx(same.std_errors, rel=1e-6)


def test_what_a_diagnosis_of_rows_pasted_twice_leads_to_is_that_of_once(tmp_path: Path) -> None:
    """Further touches, what they would tell, the gain elsewhere, the page and the file of it."""
    setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    touches = tn.read_touches(tn.sample_path("hidden/touches.csv"))
    once, twice = (tn.diagnose(touches[np.tile(np.arange(len(touches)), n)], setup) for n in (1, 2))
    assert twice.outliers == once.outliers
    found, same = (tn.expected_discrimination(d, 4) for d in (twice, once))
    np.testing.assert_array_equal(found.plan.position_mm, same.plan.position_mm)
    assert found.std_after == pytest.approx(same.std_after, rel=1e-9)
    between = tn.diagnose(touches[np.repeat(np.arange(len(touches)), 2)], setup)
    assert between.outliers == tuple(2 * row for row in once.outliers)
    assert between.residuals is not None
    assert once.residuals is not None
    np.testing.assert_array_equal(between.residuals.rows, 2 * once.residuals.rows)
    page = tmp_path / "twice.html"
    twice.to_html(page)
    assert "504 rows repeat others" in page.read_text(encoding="utf-8")
    read = tn.Diagnosis.from_dict(twice.to_dict())
    assert read.model.errors == pytest.approx(once.model.errors, rel=1e-9)
    other = touches[np.arange(0, len(touches), 2)]
    many = other[np.concatenate([np.arange(len(other)), np.repeat([0, 1, 2], 20)])]
    assert once.score(many) == once.score(other)


def test_noise_in_the_diameters_of_a_pass_given_five_times_is_no_cause() -> None:
    data = tn.read_diameters(TURNED / "diameters.csv")
    setup = tn.read_setup(TURNED / "setup.toml")
    good = 0
    for seed in range(RUNS):
        noise = np.random.default_rng([4, seed]).normal(0.0, 0.5, len(data))
        made = data.with_columns(error_um=noise)
        good += tn.diagnose(tn.Diameters.concatenate([made] * 5), setup).verdict == "consistent"
    assert kept(good, RUNS, PROMISE)


def test_a_pass_that_was_copied_under_other_labels_counts_once() -> None:
    """Random errors of one cycle, in five: as causes they would repeat to the last digit."""
    rng = np.random.default_rng(5)
    targets = np.tile(np.linspace(8.0, 500.0, 12), 2)
    measured = targets + 1e-3 * rng.standard_normal(24)
    way = np.repeat([1, -1], 12)

    def run(cycles: int, noise_mm: float = 0.0) -> tn.Positioning:
        again = np.tile(measured, cycles) + noise_mm * rng.standard_normal(24 * cycles)
        return tn.Positioning(
            target_mm=np.tile(targets, cycles),
            measured_mm=again,
            direction=np.tile(way, cycles),
            cycle=np.repeat(np.arange(1, cycles + 1), 24),
            time_s=np.arange(24.0 * cycles),
        )

    once, copied = tn.diagnose(run(1)), tn.diagnose(run(5))
    assert copied.verdict == once.verdict == "consistent"
    assert "96 of 120 rows repeat others to the last digit under another cycle" in copied.notes[0]
    assert copied.sigma == once.sigma
    real = tn.diagnose(run(5, 1e-6))  # measured again, of a machine that repeats to 1 nm
    assert not any("repeat others" in note for note in real.notes)


def repeated_touches(seed: int, runs: int, again_um: float, step_um: float) -> tn.Touches:
    """Touches in runs that differ by so much noise, recorded in steps, each later than the last."""
    setup, rng = tn.Setup(tn.Artefact("cross")), np.random.default_rng(seed)
    once = tn.simulate(tn.plan(setup), setup, noise_um=0.3, seed=seed)
    columns = {k: np.tile(np.array(v), runs) for k, v in once.columns.items()}
    columns["time_s"] = np.cumsum(rng.uniform(5.0, 15.0, len(once) * runs))
    off_um = again_um * rng.standard_normal(len(once) * runs)
    for axis in "xyz":
        moved = columns[f"{axis}_mm"] + 1e-3 * off_um * columns[f"dir_{axis}"]
        columns[f"{axis}_mm"] = np.round(moved / (step_um * 1e-3)) * (step_um * 1e-3)
    return tn.Touches(columns)


@pytest.mark.parametrize("seed", [1, 2])
def test_touches_that_were_pasted_with_other_times_count_once(seed: int) -> None:
    setup = tn.Setup(tn.Artefact("cross"))
    five = repeated_touches(seed, 5, 0.0, 1e-4)
    count = len(five) // 5
    once, d = tn.diagnose(five[:count], setup), tn.diagnose(five, setup)
    said = f"{4 * count} of {5 * count} rows repeat others in every column but time_s"
    assert d.notes[0].startswith(said)
    assert d.errors_std == pytest.approx(once.errors_std, rel=1e-6)
    fit = tn.identify(five, setup)
    assert fit.notes[0].startswith(said)
    assert fit.std_errors == pytest.approx(tn.identify(five[:count], setup).std_errors)
    # a part of a measurement, behind one that was made again
    real = repeated_touches(seed, 2, 0.3, 0.1)
    part = real[:40].with_columns(time_s=np.asarray(real.time_s)[:40] + 1e4)
    both = tn.Touches.concatenate([real, part])
    assert tn.diagnose(both, setup).notes[0].startswith(f"40 of {len(both)} rows repeat others")


@pytest.mark.parametrize("step_um", [0.01, 0.1, 1.0])
def test_touches_that_were_made_again_are_readings_of_their_own(step_um: float) -> None:
    """Of readings in steps of three times their noise most agree by chance."""
    setup = tn.Setup(tn.Artefact("cross"))
    for seed in range(4):
        d = tn.diagnose(repeated_touches(seed, 3, 0.3, step_um), setup)
        assert not any("repeat others" in note for note in d.notes)


@pytest.mark.parametrize("method", [tn.identify, tn.closed_form, tn.diagnose])
def test_no_touches_are_refused(method: Callable[..., object]) -> None:
    setup = tn.Setup(tn.Artefact("cross"))
    with pytest.raises(tn.DataError, match=r"got (no rows|0 touches)"):
        method(tn.plan(setup)[:0], setup)


@pytest.mark.parametrize("method", [tn.identify, tn.diagnose])
@pytest.mark.parametrize(
    ("found", "said"),
    [
        (np.zeros(3), r"change gave shape \(3,\), expected finite numbers of shape \(72,\)"),
        (np.full(72, np.nan), "change gave nan, expected finite"),
        (np.zeros(72, dtype=complex), "change gave array.*, expected finite"),
        ("x", "change gave 'x', expected finite"),
        (np.zeros((72, 2)), r"change gave shape \(72, 2\)"),
    ],
)
def test_an_effect_of_ones_own_that_gives_something_else_is_refused(
    method: Callable[..., object], found: object, said: str
) -> None:
    class Own:
        id = "own"
        parameters = ("k_um",)

        def change(self, data: object, values: object) -> object:  # noqa: ARG002
            return found

    setup = tn.Setup(tn.Artefact("cross"))
    data = tn.simulate(tn.plan(setup), setup, noise_um=0.3, seed=1)
    with pytest.raises(tn.DataError, match=f"effect 'own': {said}"):
        method(data, setup, effects=(Own(),))

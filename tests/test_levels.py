"""Levels: straightness, twist and flatness from slopes, and what is behind them."""

import tracemalloc
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from promise import kept, needed_runs
from trunnion.cli import app

MEASURED = Path(__file__).parents[2] / "shared" / "measured" / "levels"
measured = pytest.mark.skipif(
    not MEASURED.exists(), reason="the measured files are not part of the project"
)


def beam(p: np.ndarray) -> np.ndarray:
    """Height in µm of a line at places in mm: no formula of the catalogue."""
    return 12.0 * np.sin(p / 310.0) + 4.0 * np.cos(p / 95.0)


def line(
    rng: np.random.Generator,
    *,
    noise: float = 1.0,
    places: int = 16,
    turned: bool = True,
    height: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
) -> tn.Levels:
    """A level of 100 mm moved by its own length, twice in the same order, turned in between."""
    p = 50.0 + 100.0 * np.arange(places)
    slope = (height(p + 50) - height(p - 50)) * 10.0
    sense = np.repeat([1.0, -1.0], places)[: None if turned else places]
    there = np.tile(p, 2)[: len(sense)]
    read = sense * (60.0 + np.tile(slope, 2)[: len(sense)])
    return tn.Levels(
        position_mm=there,
        along_um_m=read + noise * rng.standard_normal(len(sense)),
        across_um_m=-20.0 * sense + noise * rng.standard_normal(len(sense)),
        turn_deg=np.where(sense > 0, 0, 180),
        time_s=20.0 * np.arange(len(sense)),
    )


def narrowest(x: np.ndarray, z: np.ndarray) -> float:
    """Smallest zone of points: one of its lines goes through two of them."""
    best = np.inf
    for i, j in combinations(range(len(x)), 2):
        off = z - z[i] - (z[j] - z[i]) / (x[j] - x[i]) * (x - x[i])
        best = min(best, float(np.ptp(off)))
    return best


def test_a_profile_is_the_sum_of_its_readings() -> None:
    """Against heights that were there before the slopes, and a search over all pairs of points."""
    got = line(np.random.default_rng(1), noise=0.0, height=beam).straightness()
    nodes = 100.0 * np.arange(17)
    assert got.positions_mm == pytest.approx(nodes)
    z = beam(nodes)
    above = z - np.polyval(np.polyfit(nodes, z, 1), nodes)
    assert got.heights_um == pytest.approx(above, abs=1e-9)
    assert got.straightness_um == pytest.approx(np.ptp(above))
    assert got.minimum_zone_um == pytest.approx(narrowest(nodes, z))
    assert got.instrument_zero_um_m == pytest.approx(0.0, abs=1e-9)


def test_other_feet_take_the_slopes_as_they_are() -> None:
    data = line(np.random.default_rng(1), noise=0.0, height=lambda p: 1e-5 * (p - 800.0) ** 2)
    got = data.straightness(foot_mm=60.0)
    assert not got.chained
    p = 50.0 + 100.0 * np.arange(16)
    z = 1e-5 * (p - 800.0) ** 2  # a parabola is exact by trapezes
    assert got.heights_um == pytest.approx(z - np.polyval(np.polyfit(p, z, 1), p), abs=1e-9)
    with pytest.raises(tn.DataError, match="foot_mm"):
        data.straightness(foot_mm=-1.0)


def surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(
        3.0 * np.exp(-(((x - 150) / 250) ** 2) - ((y - 140) / 200) ** 2) + 2e-5 * x * y
    )


def plate(rng: np.random.Generator, noise: float = 0.5, zero: float = 30.0) -> tn.Levels:
    x, y = (50.0 * a.ravel() for a in np.meshgrid(np.arange(9.0), np.arange(6.0)))
    feet = 40.0
    slopes = np.column_stack(
        [
            surface(x + feet / 2, y) - surface(x - feet / 2, y),
            surface(x, y + feet / 2) - surface(x, y - feet / 2),
        ]
    )
    slopes = 1e3 * np.tile(slopes, (2, 1)) / feet + [100.0, -40.0]
    sense = np.repeat([1.0, -1.0], len(x))
    read = sense[:, None] * slopes + zero + noise * rng.standard_normal(slopes.shape)
    return tn.Levels(
        x_mm=np.tile(x, 2),
        y_mm=np.tile(y, 2),
        along_um_m=read[:, 0],
        across_um_m=read[:, 1],
        turn_deg=np.where(sense > 0, 0, 180),
    )


def test_a_surface_comes_out() -> None:
    """Within 2 % of its height, where the grid's step is a quarter of the bump's radius."""
    got = plate(np.random.default_rng(2), noise=0.0).flatness()
    z = surface(got.x_mm, got.y_mm)
    plane = np.column_stack([np.ones_like(z), got.x_mm, got.y_mm])
    above = z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0]
    assert np.abs(got.heights_um - above).max() < 0.02 * np.ptp(above)
    assert got.instrument_zero_um_m == pytest.approx((30.0, 30.0))
    # no plane of a search by hand has a narrower zone
    rng = np.random.default_rng(0)
    tried = np.ptp(got.heights_um + rng.normal(size=(20000, 2)) * 1e-3 @ plane.T[1:], axis=1)
    assert got.minimum_zone_um <= tried.min() + 1e-9
    assert got.minimum_zone_um > 0.97 * tried.min()


def test_uncertainties_are_true() -> None:
    """Of straightness, twist and flatness, over many measurements of what has a shape."""
    rng = np.random.default_rng(7)
    found: dict[str, list[tuple[float, float]]] = {}
    for _ in range(150):
        data = line(rng, height=lambda p: 40.0 * np.sin(p / 300.0))
        for result in (data.straightness(), data.twist(), plate(rng).flatness()):
            for name, std in result.std_errors.items():
                found.setdefault(f"{type(result).__name__} {name}", []).append(
                    (getattr(result, name), std)
                )
    assert len(found) == 6
    for name, pairs in found.items():
        if "roll" in name:
            continue  # of a surface without one: noise alone
        values, stated = np.array(pairs).T
        assert 0.8 < np.median(stated) / np.std(values) < 1.25, name


HIDDEN: dict[str, Callable[[tn.Levels, np.random.Generator], dict[str, np.ndarray]]] = {
    "instrument_zero": lambda d, rng: {"along_um_m": rng.uniform(2, 20) + 0 * d.sense},
    "twist": lambda d, rng: {
        "across_um_m": d.sense * rng.uniform(3, 20) * 1e-3 * (d.places_mm[:, 0] - 800)
    },
    "bow": lambda d, rng: {
        "along_um_m": -d.sense * rng.uniform(3, 20) * 1e-3 * (d.places_mm[:, 0] - 800)
    },
    "kink": lambda d, rng: {
        "along_um_m": d.sense * rng.uniform(5, 20) * (d.places_mm[:, 0] > rng.uniform(400, 1200))
    },
    "drift": lambda d, rng: {
        "along_um_m": rng.uniform(20, 60) * np.linspace(0, 0.18, len(d)),
        "across_um_m": rng.uniform(20, 60) * np.linspace(0, 0.18, len(d)),
    },
}


@pytest.mark.parametrize("cause", sorted(HIDDEN))
def test_what_is_hidden_is_named(cause: str) -> None:
    runs, good = needed_runs(0.95), 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, len(cause)])
        plain = line(rng)
        change = HIDDEN[cause](plain, rng)
        data = plain.with_columns(**{k: plain[k] + v for k, v in change.items()})
        good += any(cause in a for a in tn.diagnose(data).alternatives)
    assert kept(good, runs, 0.95)


def test_nothing_is_named_where_nothing_is() -> None:
    runs = needed_runs(0.95)
    calm = [tn.diagnose(line(np.random.default_rng(9000 + s))).verdict for s in range(runs)]
    assert kept(calm.count("consistent"), runs, 0.95)


def test_without_reversal_the_zero_is_not_told_apart() -> None:
    data = line(np.random.default_rng(3), turned=False, height=lambda p: 1e-5 * (p - 800) ** 2)
    found = tn.diagnose(data)
    assert "instrument_zero" in found.not_identifiable
    assert any("not turned" in note for note in found.notes)
    assert data.straightness().instrument_zero_um_m is None
    shifted = data.with_columns(along_um_m=data["along_um_m"] + 25.0)
    assert shifted.straightness().heights_um == pytest.approx(data.straightness().heights_um)


def test_a_drift_that_runs_with_the_place_is_not_looked_for() -> None:
    """There, and back with the instrument turned: a drift is a twist and a bow."""
    data = line(np.random.default_rng(3))
    order = np.concatenate([np.arange(16), np.arange(16, 32)[::-1]])
    back = data[order].with_columns(time_s=data["time_s"])
    assert {"drift"} == {e.id for e in tn.catalogue(data)} - {e.id for e in tn.catalogue(back)}
    assert any("a drift of the instrument would" in note for note in tn.diagnose(back).notes)


def test_useless_readings_are_refused() -> None:
    data = line(np.random.default_rng(4))
    with pytest.raises(tn.DataError, match="see flatness"):
        plate(np.random.default_rng(4)).straightness()
    with pytest.raises(tn.DataError, match="see straightness"):
        data.flatness()
    with pytest.raises(tn.DataError, match="no column along_um_m"):
        data.with_columns(along_um_m=None).straightness()
    one = np.arange(5.0)
    diagonal = tn.Levels(x_mm=one, y_mm=one, along_um_m=one, across_um_m=one)
    with pytest.raises(tn.DataError, match="not connected"):
        diagonal.flatness()
    with pytest.raises(tn.InputError, match="foot_mm"):
        data.straightness(foot_mm="wide")  # type: ignore[arg-type]
    with pytest.raises(tn.InputError, match="noise_um_m"):
        data.twist(noise_um_m=-1.0)
    with pytest.raises(tn.InputError, match="neither along_um_m nor across_um_m"):
        tn.Levels(position_mm=[1, 2])
    with pytest.raises(tn.InputError, match="one of 0, 180"):
        data.with_columns(turn_deg=90 + 0 * data["position_mm"])


def test_the_command_prints_them() -> None:
    runner = CliRunner()
    said = runner.invoke(app, ["levels", "results", str(tn.sample_path("levels/bed.csv"))])
    assert said.exit_code == 0, said.output
    assert "straightness, minimum zone" in said.output
    assert "µm/m per m" in said.output
    said = runner.invoke(app, ["levels", "results", str(tn.sample_path("levels/plate.csv"))])
    assert "flatness, least squares" in said.output
    named = runner.invoke(app, ["diagnose", str(tn.sample_path("levels/bed.csv"))])
    assert "twist" in named.output


# --- measured


def bed(name: str) -> tn.Levels:
    number, along, across = np.loadtxt(
        MEASURED / f"lathe_bed_{name}.csv", delimiter=",", skiprows=1, unpack=True
    )
    return tn.Levels(
        position_mm=25.0 * (number - 1), along_um_m=1e3 * along, across_um_m=1e3 * across
    )


@measured
@pytest.mark.parametrize(("name", "twist"), [("found", 143.0), ("bent_back", -37.0)])
def test_the_lathe_bed(name: str, twist: float) -> None:
    data = bed(name)
    assert data.twist().twist_um_m_m == pytest.approx(twist, abs=1.0)
    found = tn.diagnose(data)
    assert any("twist" in a for a in found.alternatives)
    assert any("not turned" in note for note in found.notes)
    said = f"{data.twist().twist_um_m_m:.1f} ± ".replace("-", "−")
    assert any(said in note and "µm/m per m" in note for note in found.notes)


def granite() -> tn.Levels:
    """The plate from left to right, row by row, and back with the level turned."""
    rows: list[tuple[float, float]] = []
    for name in ("0", "180_a", "180_b"):
        for text in (MEASURED / f"surface_plate_{name}.csv").read_text().splitlines():
            fields = [field.strip('"') for field in text.split(";")]
            if not fields[0].startswith("Date"):
                rows.append((1e6 * float(fields[1]), 1e6 * float(fields[2])))
    x, y = np.tile(50.0 * np.arange(9), 6), np.repeat(50.0 * np.arange(6), 9)
    along, across = np.array(rows).T
    return tn.Levels(
        x_mm=np.concatenate([x, x[::-1]]),
        y_mm=np.concatenate([y, y[::-1]]),
        along_um_m=along,
        across_um_m=across,
        turn_deg=np.repeat([0, 180], 54),
    )


@measured
def test_the_granite_plate() -> None:
    """Zero and shape are distinguished by reversal; the shape is that of one orientation alone."""
    both = granite()
    one = both[:54]
    zero = both.flatness().instrument_zero_um_m
    by_hand = (both["along_um_m"][:54] + both["along_um_m"][54:][::-1]).mean() / 2
    assert zero is not None
    assert zero[0] == pytest.approx(by_hand, abs=0.5)
    found = tn.diagnose(both)
    cause = next(c for c in found.causes if c.id == "instrument_zero")
    assert cause.parameters["along_um_m"] == pytest.approx(by_hand, abs=0.5)
    assert "instrument_zero" in tn.diagnose(one).not_identifiable
    assert one.flatness().flatness_um == pytest.approx(both.flatness().flatness_um, rel=0.1)


@pytest.mark.parametrize("both_ways", [False, True])
def test_slopes_are_those_of_least_squares(both_ways: bool) -> None:
    rng = np.random.default_rng(3)
    at = rng.integers(0, 12, 60) * 50.0
    sense = np.where(rng.random(60) < 0.5, 1.0, -1.0) if both_ways else np.ones(60)
    y = rng.standard_normal(60)
    turn = np.where(sense > 0, 0.0, 180.0)
    found = tn.Levels(position_mm=at, along_um_m=y, turn_deg=turn).slopes("along")
    places, index = np.unique(at, return_inverse=True)
    design = np.zeros((60, len(places) + both_ways))
    design[np.arange(60), index] = sense
    if both_ways:
        design[:, -1] = 1.0
    cofactor = np.linalg.inv(design.T @ design)
    values = cofactor @ (design.T @ y)
    m = len(places)
    np.testing.assert_allclose(found.values, values[:m], atol=1e-12)
    np.testing.assert_allclose(found.cofactor, cofactor[:m, :m], atol=1e-12)
    np.testing.assert_allclose(found.rss, np.sum((y - design @ values) ** 2), rtol=1e-10)
    assert found.free == 60 - design.shape[1]
    assert (found.zero is None) == (not both_ways)
    by = rng.standard_normal(m)
    np.testing.assert_allclose(found.variance(by), by @ cofactor[:m, :m] @ by, rtol=1e-10)


def test_memory_is_linear_in_places() -> None:
    peaks = []
    for n in (1000, 3000):
        at = np.tile(10.0 * np.arange(n), 2)
        turn = np.repeat([0.0, 180.0], n)
        y = 30.0 * np.where(turn == 0, 1.0, -1.0) + np.random.default_rng(n).standard_normal(2 * n)
        data = tn.Levels(position_mm=at, across_um_m=y, turn_deg=turn)
        tracemalloc.start()
        tn.diagnose(data)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 4 * peaks[0]

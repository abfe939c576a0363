"""Machines that warm up by no formula of the catalogue: what is said of their location errors."""

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from power.study import ground
from power.warming import MOVED, SHAPES, Run, run, said
from promise import kept, needed_runs
from trunnion.diagnosis.effect import Values, drift
from trunnion.diagnosis.fit import fit
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.linearised import Linearised
from trunnion.diagnosis.model import Covariate, Nuisance, Readings
from trunnion.diagnosis.plain import case_of
from trunnion.diagnosis.shape_in_time import shape_in_doubt
from trunnion.diagnosis.whitening import identity
from trunnion.machine.effects import Owner
from trunnion.models.touches import build
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Floats = NDArray[np.float64]
HELD = 0.9


def named(shapes: tuple[str, ...], seed: int, count: int) -> list[Run]:
    """Runs of the paper's plan of which the process is named: 10 to 40 times the noise."""
    found: list[Run] = []
    i = 0
    while len(found) < count:
        shape, size = shapes[i % len(shapes)], (10.0, 20.0, 40.0)[i % 3]
        made = run(shape, size, "paper", 1000 * seed + i)
        i += 1
        if said(made) == "named" and MOVED[made.axis] in made.off:
            found.append(made)
    return found


def test_intervals_hold_the_error_at_the_start_of_a_warm_up_of_another_shape() -> None:
    """An extrapolation by a formula that the machine does not follow: 58 % were within 2 u."""
    shapes = tuple(k for k in SHAPES if k not in ("steady", "one exponential"))
    runs = named(shapes, 3, needed_runs(HELD))
    off = np.abs([r.off[MOVED[r.axis]] for r in runs])
    assert kept(int(np.sum(off < 2)), len(off), HELD)
    assert np.sqrt(np.mean(off**2)) < 1.5


def test_a_steady_drift_costs_what_the_readings_leave_open() -> None:
    """What goes with it is less certain by some times, and no other location error at all."""
    rng = np.random.default_rng(13)
    effects = {"drift_x": {"rate_um_h": 20.0}}
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    made, twin, _, setup = ground("rich")
    d = tn.diagnose(tn.Touches(measure(made, twin, truth, noise_um=0.3, seed=13).columns), setup)
    fitted = tn.identify(d.data, setup, effects=("drift_x",))
    wider = {k: std / fitted.std_errors[k] for k, std in d.errors_std.items()}
    assert 1.5 < wider.pop("EX0C") < 4.0
    assert 1.0 < wider.pop("EY0A") < 4.0
    assert all(0.999 < w < 1.05 for w in wider.values())
    assert d.causes[0].std_errors["rate_um_h"] == pytest.approx(
        fitted.std_errors["drift_x.rate_um_h"], rel=1e-3
    )
    assert d.verdict == "explained"
    line = "Mostly what the shape of the drift of the X axis leaves open: EX0C ± "
    assert any(line in note for note in d.notes)
    assert "shape of processes in time" in d.budget(("EX0C",)).to_json()
    assert d.model.std_errors["EX0C"] == d.errors_std["EX0C"]
    assert d.budget()["EX0C"].std == pytest.approx(d.errors_std["EX0C"], rel=0.05)


def by_dense_matrices(x: Floats, y: Floats, process: Floats, root: Floats, at: int) -> float:
    """Mean square of a parameter about its least squares, by which a process in the noise moves it.

    All readings have a covariance of their own here: no polynomials, no inner products.
    """
    n, k = x.shape
    plain = np.linalg.inv(x.T @ x)
    theta = plain @ (x.T @ y)
    dof = n - k
    variance = float(np.sum((y - x @ theta) ** 2)) / dof
    chance, squares = [], []
    u = 2 * root - 1
    largest = np.abs(process / root).max() / np.sqrt(variance)
    for length in (0.15, 0.25, 0.4, 0.7, 1.2, 2.0, 3.5):
        alike = np.exp(-0.5 * ((u[:, None] - u) / length) ** 2)
        for octave in range(max(6, int(np.ceil(np.log2(4 * largest)))) + 1):
            d = process / root * 0.5**octave
            v = np.eye(n) + alike * np.outer(d, d) / variance
            inner = np.linalg.inv(v)
            own = np.linalg.inv(x.T @ inner @ x)
            moved = own @ (x.T @ inner @ y)
            left = (y - x @ moved) @ inner @ (y - x @ moved)
            log_det = (
                np.linalg.slogdet(v)[1] - np.linalg.slogdet(own)[1] + np.linalg.slogdet(plain)[1]
            )
            chance.append(-0.5 * (dof * np.log(left) + log_det) - 0.5 * octave * np.log(2.0))
            grown = variance * (own - plain)[at, at]
            squares.append(float(grown + (moved - theta)[at] ** 2))
    weight = np.exp(np.array(chance) - max(chance))
    return float(weight @ np.array(squares) / weight.sum())


@pytest.mark.parametrize("curve", ["line", "root"])
def test_mean_squares_are_those_of_a_process_in_the_noise(curve: str) -> None:
    n = 48
    t = np.linspace(0.1, 1.0, n)
    rng = np.random.default_rng(5)
    turned = np.where(np.arange(n) % 16 < 8, 1.0, -1.0)
    y = 9.0 * (t if curve == "line" else np.sqrt(t)) * turned + rng.standard_normal(n)
    model = LinearModel(
        t,
        Readings(y, np.arange(n), "µm"),
        [Nuisance("offset", "µm"), Nuisance("EX0C", "µm", Owner.MACHINE)],
        np.stack([np.ones(n), turned], axis=1),
        effects=[drift("drift_x", "rate_um_h", t, turned, owner=Owner.TIME)],
        covariates=[Covariate("time", t, "s", sequence=True)],
    )
    case = case_of(model)
    f = fit(
        model,
        case.rows,
        model.effects,
        case.plain.nuisance,
        {"drift_x": Values(rate_um_h=0.0)},
        identity,
    )
    variance = f.rss / f.dof
    found = shape_in_doubt(case, f, model.effects, variance)
    root = np.sqrt((t - t[0] + t[1] - t[0]) / (t[-1] - t[0] + t[1] - t[0]))
    process = f.effects["drift_x"]["rate_um_h"] * t * turned
    x = np.stack([np.ones(n), turned, t * turned], axis=1)
    expected = by_dense_matrices(x, y, process, root, 1)
    assert found[1, 1] == pytest.approx(expected, rel=0.02)
    assert not found[2].any()


def test_a_place_that_is_found_later_leaves_the_others_theirs() -> None:
    """With a curve of time and readings set aside it ended in an IndexError."""
    made, twin, _, read = ground("paper")
    model = build(tn.Touches(measure(made, twin, Truth()).columns), read)
    nonlinear = [j for j, e in enumerate(model.effects) if not e.linear][:2]
    found = Linearised(model, np.asarray(model.start), identity)
    for j in nonlinear:
        effect = model.effects[j]
        values = found.values[j][0]
        moved = {p.name: values[p.name] * (1.0 if p.linear else 1.01) for p in effect.parameters}
        found = found.with_places({j: effect.values(moved.values())})
    columns: Counter[int] = Counter()
    for j, piece in found.pieces():
        columns[j] += len(piece)
    assert [columns[j] for j in nonlinear] == [len(found.values[j]) for j in nonlinear]

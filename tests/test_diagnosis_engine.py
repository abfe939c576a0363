"""The engine keeps its promises on models that know nothing of machines."""

from __future__ import annotations

import itertools
import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import special, stats

import trunnion as tn
from trunnion.diagnosis import outliers
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.effect import Parameter
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.model import Covariate, Nuisance, Readings
from trunnion.diagnosis.own_effects import as_effect
from trunnion.diagnosis.scorer import cost
from trunnion.diagnosis.selection import search
from trunnion.machine.effects import Owner

mpl.use("Agg")

Floats = NDArray[np.float64]
N = 90
X = np.linspace(0.0, 100.0, N)


@dataclass(frozen=True)
class Own:
    """An effect as a user writes it."""

    id: str
    parameters: tuple[Parameter, ...]
    change: Callable[[Floats, Mapping[str, float]], NDArray[np.floating]]
    label: str = ""


def wave(n: int) -> Own:
    return Own(
        f"wave_{n}",
        (Parameter("a_um"), Parameter("b_um")),
        lambda x, v: v["a_um"] * np.cos(n * x / 10) + v["b_um"] * np.sin(n * x / 10),
    )


def screw() -> Own:
    return Own(
        "screw",
        (Parameter("a_um"), Parameter("b_um"), Parameter("pitch_mm", "mm", PITCHES, (5, 100))),
        lambda x, v: (
            v["a_um"] * np.cos(2 * np.pi * x / v["pitch_mm"])
            + v["b_um"] * np.sin(2 * np.pi * x / v["pitch_mm"])
        ),
    )


PITCHES = tuple(np.geomspace(9.0, 20.0, 40))
STEP = Own("step", (Parameter("h_um"),), lambda x, v: v["h_um"] * (x > 50))
BOW = Own(
    "bow", (Parameter("k_um"),), lambda x, v: v["k_um"] * (x / 50 - 1) ** 2, "bow of the guide"
)
CATALOGUE = (STEP, BOW, wave(1), wave(2), wave(3), wave(4))


def line(
    y: Floats,
    effects: tuple[object, ...] = CATALOGUE,
    x: Floats = X,
    replicates: NDArray[np.intp] | None = None,
    sigma: float | None = None,
) -> LinearModel:
    return LinearModel(
        x,
        Readings(y, np.arange(len(y)), "µm", None if sigma is None else np.full(len(y), sigma)),
        [Nuisance("offset", "µm"), Nuisance("slope", "µm/m", Owner.MACHINE)],
        np.stack([np.ones_like(x), x / 1e3], axis=1),
        effects=effects,  # type: ignore[arg-type]
        covariates=[
            Covariate("position", x, "mm"),
            Covariate("lane", np.arange(len(x)) % 5, classes=True),
            Covariate("order", np.arange(len(x)), sequence=True),
        ],
        groups=np.arange(len(y)) * 6 // len(y),
        replicates=replicates,
        binder=lambda d: line(d[1], effects, d[0]),
    )


def noise(seed: int, size: float = 1.0) -> Floats:
    return size * np.random.default_rng(seed).standard_normal(N)


def test_a_straight_line_is_consistent() -> None:
    d = tn.diagnose(line(3 + 0.2 * X + noise(1)))
    assert d.verdict == "consistent"
    assert d.causes == ()
    assert d.alternatives == ()
    assert d.unexplained is None
    assert d.errors_after["slope"] == pytest.approx(200.0, abs=12.0)
    assert d.sigma == pytest.approx(1.0, abs=0.25)


def test_a_cause_is_named_and_measured() -> None:
    d = tn.diagnose(line(0.2 * X + 5.0 * (X / 50 - 1) ** 2 + noise(2)))
    assert d.verdict == "explained"
    (cause,) = d.causes
    assert cause.id == "bow"
    assert abs(cause.parameters["k_um"] - 5.0) < 3 * cause.std_errors["k_um"]
    assert cause.p_value < 1e-6
    assert d.gain.heldout_rms_after_um < d.gain.heldout_rms_before_um
    assert "bow of the guide" in d.summary().lower()


def test_a_nonlinear_parameter_is_found_between_its_grid_values() -> None:
    y = 3 * np.cos(2 * np.pi * X / 12.345) + noise(3, 0.3)
    d = tn.diagnose(line(y, (*CATALOGUE, screw())))
    assert [c.id for c in d.causes] == ["screw"]
    cause = d.causes[0]
    assert abs(cause.parameters["pitch_mm"] - 12.345) < 4 * cause.std_errors["pitch_mm"]
    assert cause.std_errors["pitch_mm"] < 0.1


def test_exact_aliases_are_all_given() -> None:
    twin_step = Own("other_step", (Parameter("h_um"),), lambda x, v: -2 * v["h_um"] * (x > 50))
    d = tn.diagnose(line(4.0 * (X > 50) + noise(4), (*CATALOGUE, twin_step)))
    assert d.verdict == "ambiguous"
    assert set(d.alternatives[:2]) == {frozenset({"step"}), frozenset({"other_step"})}
    assert "other_step" in d.causes[0].aliases or "step" in d.causes[0].aliases


def test_a_sum_of_two_causes_is_an_alias_of_the_two() -> None:
    """Pairwise correlation does not show this: a = b + c."""
    both = Own(
        "both",
        (Parameter("h_um"),),
        lambda x, v: v["h_um"] * ((x > 50) + (x / 50 - 1) ** 2),
    )
    d = tn.diagnose(line(4.0 * (X > 50) + 4.0 * (X / 50 - 1) ** 2 + noise(5), (*CATALOGUE, both)))
    assert frozenset({"both"}) in d.alternatives
    off = tn.diagnose(line(6.0 * (X > 50) - 4.0 * (X / 50 - 1) ** 2 + noise(5), (*CATALOGUE, both)))
    assert {
        frozenset({"step", "bow"}),
        frozenset({"both", "bow"}),
        frozenset({"both", "step"}),
    } <= (set(off.alternatives))
    assert off.verdict == "ambiguous"


def test_what_cannot_be_seen_has_no_finite_error() -> None:
    blind = Own("blind", (Parameter("k_um"),), lambda x, v: v["k_um"] * x)
    half = Own(
        "half",
        (Parameter("k_um"), Parameter("h_um")),
        lambda x, v: v["k_um"] * x + v["h_um"] * (x > 50),
    )
    d = tn.diagnose(line(4.0 * (X > 50) + noise(6), (blind, half)))
    # "half" changes what the slope of the line does, too: neither has a size of its own.
    assert set(d.not_identifiable) == {"slope", "blind"}
    assert d.causes[0].std_errors["k_um"] == np.inf
    assert np.isfinite(d.causes[0].std_errors["h_um"])
    assert "nan" not in d.summary().lower()
    json.dumps(d.to_dict(), allow_nan=False)


def test_outliers_are_rows_and_no_cause() -> None:
    y = 0.2 * X + noise(7)
    y[[11, 40, 77]] += [30.0, -80.0, 25.0]
    d = tn.diagnose(line(y))
    assert d.outliers == (11, 40, 77)
    assert d.causes == ()
    assert d.verdict == "explained"
    assert d.errors_after["slope"] == pytest.approx(200.0, abs=15.0)


def test_outliers_beside_a_cause() -> None:
    y = 6.0 * (X / 50 - 1) ** 2 + noise(8)
    y[[5, 60]] += [40.0, -25.0]
    d = tn.diagnose(line(y))
    assert d.outliers == (5, 60)
    assert [c.id for c in d.causes] == ["bow"]


def test_a_lane_of_its_own_is_no_outlier() -> None:
    y = 0.2 * X + noise(9) + 6.0 * (np.arange(N) % 5 == 2) * (np.arange(N) < 45)
    d = tn.diagnose(line(0.2 * X + noise(9) + 5.0 * (np.arange(N) % 5 == 2)))
    assert d.verdict == "unexplained"
    assert d.unexplained is not None
    assert "lane 2" in d.unexplained
    assert d.outliers == ()
    assert tn.diagnose(line(y)).verdict == "unexplained"


@pytest.mark.parametrize(
    ("change", "word"),
    [(3 * np.sin(2 * np.pi * X / 17.0), "position"), (4.0 * (X > 30), "jump")],
)
def test_structure_outside_the_catalogue(change: Floats, word: str) -> None:
    d = tn.diagnose(line(0.2 * X + change + noise(10), (BOW,)))
    assert d.verdict == "unexplained"
    assert d.unexplained is not None
    assert word in d.unexplained


def test_scatter_beyond_the_stated_noise() -> None:
    assert tn.diagnose(line(noise(11), sigma=1.0)).verdict == "consistent"
    d = tn.diagnose(line(noise(11, 2.0), sigma=1.0))
    assert d.verdict == "unexplained"
    assert "stated noise" in str(d.unexplained)


def test_repeats_are_pure_error() -> None:
    """A pattern that no term of the dictionary makes shows against repeats."""
    rng = np.random.default_rng(12)
    x = np.repeat(np.linspace(0, 100, 45), 2)
    labels = np.repeat(np.arange(45), 2)
    rough = np.repeat(rng.standard_normal(45), 2)
    y = 0.2 * x + 2 * rough + 0.5 * rng.standard_normal(90)
    d = tn.diagnose(line(y, (BOW,), x, labels))
    assert d.verdict == "unexplained"
    assert "repeats" in str(d.unexplained)
    fair = tn.diagnose(line(0.2 * x + 0.5 * rng.standard_normal(90), (BOW,), x, labels))
    assert fair.verdict == "consistent"


class Saw:
    """A user's effect in ten lines."""

    id = "saw"
    parameters = ("h_um",)

    def change(self, data: Floats, values: Mapping[str, float]) -> Floats:
        return values["h_um"] * (data % 20) / 20


def test_a_users_own_effect_competes() -> None:
    d = tn.diagnose(line(6.0 * (X % 20) / 20 + noise(13), (*CATALOGUE, Saw())))
    assert [c.id for c in d.causes] == ["saw"]
    assert abs(d.causes[0].parameters["h_um"] - 6.0) < 3 * d.causes[0].std_errors["h_um"]
    assert as_effect(Saw(), X).motion is None
    with pytest.raises(tn.InputError, match="change"):
        as_effect(object(), X)  # type: ignore[arg-type]


def test_score_on_data_not_seen() -> None:
    def measured(seed: int, offset: float) -> Floats:
        return offset + 0.2 * X + 5.0 * (X / 50 - 1) ** 2 + noise(seed)

    d = tn.diagnose(line(measured(14, 0.0)))
    g = d.score(line(measured(15, 300.0)))  # another set-up: its offset is fitted anew
    assert g.rms_after_um == pytest.approx(1.0, abs=0.2)
    assert g.rms_before_um > 1.3
    with pytest.raises(tn.InputError, match=r"expected a model of the other data"):
        d.score((X, measured(15, 300.0)))  # a diagnosis holds no model that could be bound to them


def test_bad_input() -> None:
    y = noise(16)
    y[7] = np.nan
    with pytest.raises(tn.DataError, match="row 7"):
        tn.diagnose(line(y))
    with pytest.raises(tn.DataError, match="unknowns"):
        tn.diagnose(line(np.zeros(2), x=np.array([0.0, 1.0])))
    with pytest.raises(tn.InputError, match=r"expected .* or a diagnosis model"):
        tn.diagnose(3)


def test_exact_data_divide_by_no_zero() -> None:
    assert tn.diagnose(line(0.2 * X)).verdict == "consistent"
    d = tn.diagnose(line(0.2 * X + 3.0 * (X > 50)))
    assert d.causes[0].id == "step"
    assert d.causes[0].parameters["h_um"] == pytest.approx(3.0)


def test_what_a_diagnosis_shows(tmp_path: Path) -> None:
    y = 6.0 * (X / 50 - 1) ** 2 + noise(17)
    y[30] += 50
    d = tn.diagnose(line(y))
    text = d.summary()
    assert text.splitlines()[0].startswith("Explained by one cause: bow of the guide (bow): ")
    assert "Outlier, left out: row 30 (counted from 0)." in text
    page = d.to_html(tmp_path / "d.html").read_text(encoding="utf-8")
    assert page.count("data-figure=") >= 2
    assert "bow of the guide" in page
    assert d.plot().get_xlabel() == "Position (mm)"
    assert json.loads(json.dumps(d.to_dict()))["causes"][0]["id"] == "bow"
    assert tn.diagnose(line(y)).to_dict() == d.to_dict()


def test_numbers_survive_pickling() -> None:
    cause = tn.diagnose(line(6.0 * (X / 50 - 1) ** 2 + noise(17))).causes[0]
    assert pickle.loads(pickle.dumps(cause)) == cause


# --- the search itself


def candidates(seed: int, count: int) -> tuple[Candidates, list[Floats], Floats]:
    """Candidates of one to three columns, some of them close to sums of others."""
    rng = np.random.default_rng(seed)
    blocks = [rng.standard_normal((40, int(rng.integers(1, 4)))) for _ in range(count)]
    blocks[1] = blocks[2][:, :1] + blocks[3][:, :1] + 0.05 * rng.standard_normal((40, 1))
    blocks[4] = blocks[5] * 2.0
    basis = np.linalg.qr(rng.standard_normal((40, 4)))[0]
    return Candidates([b[None] for b in blocks], basis), blocks, basis


@pytest.mark.parametrize("seed", range(8))
def test_search_finds_what_exhaustive_search_finds(seed: int) -> None:
    c, blocks, basis = candidates(seed, 9)
    rng = np.random.default_rng(100 + seed)
    y = sum(2.5 * blocks[j] @ np.ones(blocks[j].shape[1]) / 2 for j in rng.choice(9, 3, False))
    r = np.asarray(y + rng.standard_normal(40))
    r = r - basis @ (basis.T @ r)
    searched = search(c, r)
    found = searched.found
    m = 36
    scores: dict[frozenset[int], float] = {}
    for size in range(6):
        for s in itertools.combinations(map(int, c.leaders), size):
            x = np.concatenate([np.zeros((40, 0)), *(blocks[j] for j in s)], axis=1)
            x = x - basis @ (basis.T @ x)
            rank = int(np.linalg.matrix_rank(x, tol=1e-3)) if size else 0
            fitted = x @ np.linalg.lstsq(x, r, rcond=1e-9)[0] if size else np.zeros(40)
            price = sum(special.chdtri(blocks[j].shape[1], c.level[j]) for j in s)
            rss = float(np.sum((r - fitted) ** 2))
            scores[frozenset(s)] = m * np.log(rss) + float(cost(price, rank, m))
    best = min(scores.values())
    near = {s for s, v in scores.items() if v <= best + 6 and s}
    assert found[0].score == pytest.approx(best)
    assert {f.members for f in found} == near


def test_false_alarms_of_the_engine() -> None:
    """300 runs without an effect: more than 5 % would show (binomial, 1 in 1000)."""
    alarms = sum(tn.diagnose(line(noise(1000 + k))).verdict != "consistent" for k in range(300))
    assert alarms <= stats.binom.ppf(0.999, 300, 0.05)


@pytest.mark.parametrize("tails", [3, 4, 8])
def test_heavy_tails_are_no_outliers(tails: int) -> None:
    rng = np.random.default_rng(tails)
    flagged = [len(outliers.far_out(np.abs(rng.standard_t(tails, 200)), 200.0)) for _ in range(150)]
    assert np.mean(np.array(flagged) > 0) <= 0.05


def test_outliers_mask_each_other_in_vain() -> None:
    rng = np.random.default_rng(5)
    design = np.stack([np.ones(N), X], axis=1)
    q = np.linalg.qr(design)[0]
    for _ in range(40):
        y = rng.standard_normal(N)
        bad = np.sort(rng.choice(N, 9, replace=False))
        y[bad] += rng.uniform(10, 200, 9)  # all to one side
        found = outliers.far_out(outliers.robust_sizes(q, y), N - 2.0)
        assert set(bad) <= set(found)
        assert len(found) <= len(bad) + 1


@pytest.mark.parametrize("dof", [9, 17, 30, 66, 500])
def test_few_readings_have_the_chances_of_many(dof: int) -> None:
    """RSS(S) / RSS is a beta variate: the cost of a penalty is its quantile at the same chance."""
    for columns in {1, 2, 3, 2 * dof // 5, dof // 2}:
        for level in (1e-2, 2e-3, 1e-6):
            penalty = float(stats.chi2.isf(level, columns))
            exact = -dof * np.log(stats.beta.ppf(level, (dof - columns) / 2, columns / 2))
            assert float(cost(penalty, columns, dof)) == pytest.approx(exact, rel=0.02)

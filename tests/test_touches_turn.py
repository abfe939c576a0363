"""Touches of a machine whose rotary axis stands off its command: by a formula of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from power.study import ground
from promise import kept, needed_runs
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Angle = Callable[[tn.Touches, np.random.Generator], NDArray[np.float64]]
FOUND = 0.95
NOISE_UM = 0.3
ARCSEC = np.pi / 180.0 / 3600.0


def read_further(data: tn.Touches, letter: str, arcsec: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change of each reading, µm, as an axis through the origin stands further by an angle.

    The face moves across the radius, and the ball, which comes along the face's normal, meets it
    that much later.
    """
    a = np.radians(np.asarray(data["a_deg"]))
    x = np.zeros((len(data), 3))
    x[:, 0] = 1.0
    c = np.stack([np.zeros_like(a), -np.sin(a), np.cos(a)], axis=1)
    axis = x if letter == "a" else c
    moved = np.cross(axis, data.position_mm) * (arcsec * ARCSEC)[:, None]
    return np.asarray(1e3 * np.sum(moved * data.direction, axis=1))


def measured(
    seed: int, letter: str, angle: Angle, plan: str = "rich"
) -> tuple[tn.Touches, tn.Setup, dict[str, float]]:
    """Touches of the independent generator, an axis off by an angle, and the hidden errors."""
    made, twin, _, read = ground(plan)
    rng = np.random.default_rng(seed)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
    m = measure(made, twin, truth, noise_um=NOISE_UM, tick_um=0.1, seed=seed)
    data = tn.Touches(m.columns)
    off = read_further(data, letter, angle(data, rng))
    places = data.position_mm + 1e-3 * off[:, None] * data.direction
    columns = dict(zip(("x_mm", "y_mm", "z_mm"), places.T, strict=True))
    return data.with_columns(**columns), read, dict(truth.errors)


def thrice_a_turn(arcsec: float) -> Angle:
    def angle(data: tn.Touches, rng: np.random.Generator) -> NDArray[np.float64]:
        return np.asarray(
            arcsec * np.sin(3 * np.radians(data["c_deg"]) + rng.uniform(0, 2 * np.pi))
        )

    return angle


def at_one_stop(letter: str, deg: float, arcsec: float) -> Angle:
    def angle(data: tn.Touches, _: np.random.Generator) -> NDArray[np.float64]:
        return np.asarray(arcsec * (np.abs(np.asarray(data[f"{letter}_deg"]) - deg) < 1e-6))

    return angle


@cache
def stops(letter: str) -> list[float]:
    data, _, _ = measured(1, "c", thrice_a_turn(0.0))
    return [float(x) for x in np.unique(np.asarray(data[f"{letter}_deg"]))]


def test_an_error_three_times_a_turn_is_an_angle_of_the_axis() -> None:
    """Of 30 arcsec it was noise in 4 of 8 runs, and a twist of the A axis in the others."""
    inside, seen, total, runs = 0, 0, 0, needed_runs(FOUND)
    for seed in range(runs):
        arcsec = (4.0, 30.0)[seed % 2]
        data, setup, hidden = measured(100 + seed, "c", thrice_a_turn(arcsec))
        d = tn.diagnose(data, setup)
        assert not [c for c in d.causes if (c.probability or 0.0) > 0.99]
        if d.structure is None:
            continue
        effect = d.structure.effect
        found = effect.covariate, effect.shape, effect.number, effect.component
        size = np.hypot(d.structure.parameters["a_arcsec"], d.structure.parameters["b_arcsec"])
        assert "C position (3rd harmonic, as an angle of C)" in d.sentences()[0]
        assert size == pytest.approx(arcsec, abs=1.5)
        seen += found == ("C position", "harmonic", 3.0, "angle of C")
        inside += sum(abs(d.errors_after[k] - hidden[k]) < 2.2 * d.errors_std[k] for k in hidden)
        total += len(hidden)
    assert kept(seen, runs, FOUND)
    assert kept(inside, total, FOUND)


def test_one_stop_of_an_axis_may_be_off_by_itself() -> None:
    """C off at 180 degrees only was two causes that are not there, in 8 of 8 runs."""
    seen, runs = 0, needed_runs(FOUND)
    for seed in range(runs):
        letter = "ac"[seed % 2]
        deg = stops(letter)[-2]
        data, setup, _ = measured(200 + seed, letter, at_one_stop(letter, deg, 12.0))
        d = tn.diagnose(data, setup)
        if d.structure is None:
            continue
        effect = d.structure.effect
        assert f"offset where {letter.upper()} position is {deg:g} deg" in effect.formula()
        assert d.structure.parameters["offset_arcsec"] == pytest.approx(12.0, abs=3.0)
        seen += (effect.shape, effect.number) == ("class", deg)
    assert kept(seen, runs, FOUND)


def test_a_named_angle_is_found_on_the_next_machine(tmp_path: Path) -> None:
    kinds: tuple[Callable[[float], Angle], ...] = (
        thrice_a_turn,
        lambda arcsec: at_one_stop("c", stops("c")[-2], arcsec),
    )
    files = []
    for i, made in enumerate(kinds):
        data, setup, _ = measured(7, "c", made(15.0))
        d = tn.diagnose(data, setup)
        named = d.draft_effect("worm", "error of the worm")
        files.append(tn.write_effects(tmp_path / f"effects_{i}.toml", [named]))
        assert tn.read_effects(files[-1], data) == (named,)
        assert tn.Diagnosis.from_json(d.to_json()) == d
    found, runs = 0, needed_runs(FOUND)
    for seed in range(runs):
        other, setup, _ = measured(400 + seed, "c", kinds[seed % 2](4.0))
        again = tn.diagnose(other, setup, effects=tn.read_effects(files[seed % 2], other))
        found += again.verdict != "unexplained" and "worm" in again.named
    assert kept(found, runs, FOUND)


def test_the_model_predicts_with_an_angle() -> None:
    """Simulation and identification have the machine that an angle needs."""
    data, setup, _ = measured(7, "c", thrice_a_turn(15.0))
    d = tn.diagnose(data, setup)
    assert d.model is not None
    assert tn.identify(data, setup, effects=d.model).rms_um == pytest.approx(
        d.gain.rms_after_um, rel=0.02
    )
    simulated = tn.simulate(data, setup, d.model)
    off = np.sum((simulated.position_mm - data.position_mm) * data.direction, axis=1)
    assert np.std(off) < 1.4e-3 * NOISE_UM


def test_an_angle_is_not_to_be_had_without_a_machine() -> None:
    data, setup, _ = measured(7, "c", thrice_a_turn(15.0))
    named = tn.diagnose(data, setup).draft_effect("worm")
    with pytest.raises(
        tn.InputError, match=r"got 'angle of C', expected X, Y, Z.*is the set-up missing"
    ):
        named.change(data, {"a_arcsec": 1.0, "b_arcsec": 0.0})


def test_noise_is_no_angle() -> None:
    runs = needed_runs(FOUND)
    data = [measured(600 + seed, "c", thrice_a_turn(0.0)) for seed in range(runs)]
    consistent = sum(
        tn.diagnose(touches, setup).verdict == "consistent" for touches, setup, _ in data
    )
    assert kept(consistent, runs, FOUND)

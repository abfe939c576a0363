"""Chatter is found at pitches that passes resolve, and is no wave of the place, alike in all."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
import pytest

import trunnion as tn
from twin.forward import Floats

SEEDS = range(6)
STEP = 1.5
PASSES = ((-1, 1.0), (1, 1.0), (-1, 0.5), (1, 0.5))
Error = Callable[[Floats, Floats, int], Floats]


def _cut(rng: np.random.Generator, error: Error) -> pd.DataFrame:
    """Four passes to and fro over 60 mm; ``error``: of place, time and number of the pass, µm."""
    passes = []
    for number, (sign, depth) in enumerate(PASSES):
        z = np.arange(64, 4, -STEP) if sign < 0 else np.arange(5, 65, STEP)
        time = np.abs(z - z[0]) / 2.0
        read = error(z, time, number) + rng.normal(0, 4) + rng.normal(0, 0.5, len(z))
        columns = {"z_mm": z, "error_um": np.round(read, 1), "pass": number + 1}
        passes.append(pd.DataFrame(columns | {"feed_sign": sign, "depth_mm": depth}))
    return pd.concat(passes, ignore_index=True)


def _wave(size: float, pitch: float, phases: Sequence[float]) -> Error:
    """A wave of the place, of a phase of its own in each pass."""
    return lambda z, _, k: size * np.sin(2 * np.pi * z / pitch + phases[k])


@pytest.fixture(scope="module")
def setup() -> tn.Setup:
    return tn.read_setup(tn.sample_path("turning/setup.toml"))


def _chatter(data: pd.DataFrame, setup: tn.Setup) -> tuple[float, dict[str, float], str]:
    found = tn.diagnose(tn.read(data), setup)
    for cause in found.causes:
        if cause.id == "chatter":
            return cause.probability, dict(cause.parameters), found.verdict
    return 0.0, {}, found.verdict


def test_a_feed_of_the_wrong_sign_is_no_chatter_of_one_step(setup: tn.Setup) -> None:
    for seed in SEEDS:
        data = _cut(np.random.default_rng(seed), lambda _z, t, _k: -15 * (1 - np.exp(-t / 10)))
        data.loc[data["pass"] == 2, "feed_sign"] = -1
        probability, values, verdict = _chatter(data, setup)
        assert probability < 0.9
        assert verdict != "explained"
        if values:
            assert values["pitch_mm"] > 2 * STEP


def test_a_wave_of_the_guide_is_no_chatter(setup: tn.Setup) -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        phase = rng.uniform(0, 6.28)
        data = _cut(rng, _wave(2.0, 20.0, [phase] * 4))
        assert _chatter(data, setup)[0] < 0.9


@pytest.mark.parametrize("pitch", [5.0, 9.0])
def test_chatter_that_passes_resolve_is_named(setup: tn.Setup, pitch: float) -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        data = _cut(rng, _wave(2.5, pitch, rng.uniform(0, 6.28, 4).tolist()))
        probability, values, _ = _chatter(data, setup)
        assert probability > 0.9
        assert values["pitch_mm"] == pytest.approx(pitch, rel=0.02)

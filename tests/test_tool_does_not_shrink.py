"""A tool grows as it warms, and does not shrink."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import trunnion as tn
from trunnion.diagnosis.records import CERTAIN

Floats = NDArray[np.float64]
SEEDS = range(8)
OVERHANG_MM = 65.0
SETUP = tn.read_setup(tn.sample_path("turning/setup.toml"))
Law = Callable[[Floats, Floats, float], Floats]


def passes(law: Law, seed: int, depths: tuple[float, ...] = (1.0, 1.0, 0.3)) -> tn.Diameters:
    """Passes towards the chuck, away from it, towards it; ``law``: µm by z, time and depth."""
    rng = np.random.default_rng(seed)
    rows = []
    for k, depth in enumerate(depths):
        z = np.arange(64.5, 1.0, -1.5)[:: -1 if k % 2 else 1]
        time = np.abs(z - z[0]) / 2.0
        error = law(z, time, depth) + rng.normal(0.0, 4.0) + 0.4 * rng.standard_normal(len(z))
        rows += list(
            zip(
                z,
                np.round(error, 1),
                [k + 1] * len(z),
                [1 if k % 2 else -1] * len(z),
                [depth] * len(z),
                np.round(time, 2),
                strict=True,
            )
        )
    names = ("z_mm", "error_um", "pass", "feed_sign", "depth_mm", "time_s")
    return tn.Diameters(dict(zip(names, zip(*rows, strict=True), strict=True)))


def running_in(_: Floats, time: Floats, __: float) -> Floats:
    """A new edge wears quickly at first."""
    return np.asarray(6.0 * (1.0 - np.exp(-time / 3.0)) + 0.1 * time)


def heats(_: Floats, time: Floats, __: float) -> Floats:
    """A tool grows into the part."""
    return np.asarray(-25.0 * (1.0 - np.exp(-time / 15.0)))


def test_a_tool_does_not_shrink_as_it_warms() -> None:
    """An edge that is worn in is structure without a name."""
    for seed in SEEDS:
        d = tn.diagnose(passes(running_in, seed), SETUP)
        assert "tool_heating" not in d.named
        assert d.verdict in ("unexplained", "ambiguous")


def test_a_tool_that_grows_is_named() -> None:
    """With its time constant, by fits that do not stop where two bounds meet."""
    for seed in SEEDS:
        d = tn.diagnose(passes(heats, seed), SETUP)
        heating = next(c for c in d.causes if c.id == "tool_heating")
        assert heating.probability > CERTAIN
        assert abs(heating["tau_s"] - 15.0) < 4.0 * heating.std_errors["tau_s"]

"""Make the samples again: ``python tools/samples/make_samples.py``."""

from pathlib import Path

import numpy as np

import trunnion as tn
from trunnion.samples.truth import HIDDEN_EFFECTS, OTHER_ERRORS, TABLE_2

__all__ = ["make_cross", "make_hidden", "make_rotary"]

MACHINE = """\
[machine]
preset = "trt-ca"
"""
REST = """\
[resolution]
linear_um = 0.1
rotary_arcsec = 0.36

[report]
machine = "simulated five-axis mill (sample of trunnion)"
"""
SETUP = f"""\
# A tilting rotary table with the cross-shaped artefact of Kang, Kim and Jee (2022).
{MACHINE}
[artefact]
kind = "cross"
length_mm = 100.0
width_mm = 25.0
height_mm = 25.0

[probe]
ball_radius_mm = 1.0
tick_um = 0.1

{REST}"""
ROTARY = f"""\
# An R-test on a tilting rotary table: the ball stands on the table, the sensors in the spindle.
{MACHINE}
{REST}
[rotary_test]
balls_mm = [[90.0, 20.0, 60.0]]
"""


def make_cross(folder: Path) -> None:
    """Write ``setup.toml`` and ``touches.csv`` of the cross."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(SETUP, encoding="utf-8")
    setup = tn.read_setup(folder / "setup.toml")
    touches = tn.simulate(
        tn.plan(setup),
        setup,
        errors=TABLE_2,
        placement={"dx_um": 50.0, "dy_um": -30.0, "rc_arcsec": 60.0},
        noise_um=0.3,
        seed=2022,
    )
    touches.to_csv(folder / "touches.csv")


def make_hidden(folder: Path) -> None:
    """Write a longer measurement that hides two effects and two bad touches."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(SETUP, encoding="utf-8")
    setup = tn.read_setup(folder / "setup.toml")
    plan = tn.plan(setup, c_deg=range(0, 360, 30), a_deg=(90, 60, 30, -30, -60, -90))
    touches = tn.simulate(
        plan.with_columns(time_s=8.0 * np.asarray(plan.time_s)),  # a machine that takes its time
        setup,
        errors=OTHER_ERRORS,
        placement={"dx_um": -40.0, "dy_um": 25.0, "rc_arcsec": -50.0},
        effects=HIDDEN_EFFECTS,
        noise_um=0.3,
        seed=5,
    )
    away = np.zeros((len(touches), 3))
    away[[57, 140]] = [[0.012], [-0.03]] * touches.direction[[57, 140]]
    recorded = touches.position_mm + away
    touches.with_columns(x_mm=recorded[:, 0], y_mm=recorded[:, 1], z_mm=recorded[:, 2]).to_csv(
        folder / "touches.csv"
    )


def make_rotary(folder: Path) -> None:
    """Write an R-test of the machine of ``hidden``, and the set-up of it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(ROTARY, encoding="utf-8")
    setup, ball = tn.read_setup(folder / "setup.toml"), (90.0, 20.0, 60.0)
    tilts, turns = np.meshgrid([0, 30, 60, 90, -30, -60, -90], np.arange(0, 360, 15), indexing="ij")
    plan = tn.plan_rotary_test(setup, ball, {"A": tilts.ravel(), "C": turns.ravel()})
    effects = {"c_positioning_2": HIDDEN_EFFECTS["c_positioning_2"]}
    off = (ball[0] + 0.08, ball[1] - 0.05, ball[2] + 0.03)
    made = tn.simulate_rotary_test(
        plan, setup, off, OTHER_ERRORS, effects=effects, noise_um=0.5, seed=6
    )
    rounded = {name: np.round(np.asarray(made[name]), 1) for name in ("dx_um", "dy_um", "dz_um")}
    places = {name: np.round(np.asarray(made[name]), 6) for name in ("x_mm", "y_mm", "z_mm")}
    made.with_columns(**rounded, **places, time_s=3.0 * np.arange(len(made))).to_csv(
        folder / "rtest.csv"
    )


if __name__ == "__main__":
    SAMPLES = Path(__file__).parents[2] / "python" / "trunnion" / "samples"
    make_cross(SAMPLES / "cross")
    make_hidden(SAMPLES / "hidden")
    make_rotary(SAMPLES / "rotary")

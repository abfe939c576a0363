"""Common mistakes of a measurement are named; ordinary machines are not suspected."""

import numpy as np

import trunnion as tn

SETUP = tn.Setup(artefact=tn.Artefact("cross"))
PLAN = tn.plan(SETUP)
SIZES = {"EX0C": 60, "EY0C": 60, "EY0A": 60, "EZ0A": 60, "EA0A": 60, "EB0A": 60, "EC0A": 60}


def test_a_tool_measured_to_the_tip_is_named() -> None:
    data = tn.simulate(PLAN, SETUP, errors={"EX0C": 20.0}, noise_um=0.3, seed=1)
    tip = tn.Touches({**data.columns, "z_mm": data["z_mm"] - SETUP.probe.ball_radius_mm})
    fit = tn.identify(tip, SETUP)
    assert "to the tip of the ball?" in fit.summary().replace("\n", " ")
    assert abs(fit.errors["EZ0A"] + 1000.0) < 2.0  # said, not corrected


def test_no_ordinary_machine_is_suspected() -> None:
    rng = np.random.default_rng(5)
    for seed in range(200):
        errors = {name: float(rng.uniform(-size, size)) for name, size in SIZES.items()}
        data = tn.simulate(PLAN, SETUP, errors=errors, noise_um=0.3, seed=seed)
        assert tn.identify(data, SETUP).notes == ()

"""Structure in a quantity that comes round: no origin of the angle may count, or move an error."""

import numpy as np
import pytest

import trunnion as tn


def opposite_lost_motions(seed: int) -> tuple[tn.Touches, tn.Setup]:
    """Touches whose X and Y approaches are off by their own sign of 3 µm; EX0C is 15 µm."""
    setup = tn.Setup(tn.Artefact("cross"))
    data = tn.simulate(tn.plan(setup), setup, errors={"EX0C": 15.0}, noise_um=0.3, seed=seed)
    columns = {k: np.array(v) for k, v in data.columns.items()}
    for axis, size_um in (("x", 6.0), ("y", -6.0)):
        columns[f"{axis}_mm"] += 0.5e-3 * size_um * columns[f"dir_{axis}"]
    return tn.Touches(columns), setup


@pytest.mark.parametrize("seed", [1, 7, 104, 211])
def test_structure_in_the_azimuth_moves_no_location_error(seed: int) -> None:
    d = tn.diagnose(*opposite_lost_motions(seed))
    for name, true in (("EX0C", 15.0), ("EY0A", 0.0), ("EZ0A", 0.0)):
        assert abs(d.errors_after[name] - true) < 4.0 * d.errors_std[name], name
    assert "linear" not in (d.unexplained or "")


@pytest.mark.parametrize("seed", [1, 104])
def test_the_bias_that_is_named_is_the_one_that_moves_the_tool_most(seed: int) -> None:
    """Positions of the contact point, not of the ball's centre, put a millimetre into a height."""
    setup = tn.Setup(tn.Artefact("cross"))
    data = tn.simulate(tn.plan(setup), setup, noise_um=0.3, seed=seed)
    columns = {k: np.array(v) for k, v in data.columns.items()}
    for axis in "xyz":
        columns[f"{axis}_mm"] += columns[f"dir_{axis}"]
    d = tn.diagnose(tn.Touches(columns), setup)
    moved = {k: v - d.errors_after[k] for k, v in d.errors_before.items()}
    arcsec_um = 100e3 * np.pi / 648000  # at a radius of 100 mm
    size = {k: abs(m) * (1.0 if k[1] in "XYZ" else arcsec_um) for k, m in moved.items()}
    worst = max((k for k in moved if abs(moved[k]) > d.errors_std[k]), key=lambda k: size[k])
    assert f"{worst} is biased by" in d.summary()
    assert worst == "EZ0A"

"""Trajectories of the loop against the project's reference: an independent prototype."""

from pathlib import Path

import numpy as np
import pytest

from trunnion import contouring as ct

FILE = Path(__file__).parent / "data" / "contouring" / "reference.csv"
TABLE = np.genfromtxt(FILE, delimiter=",", names=True, dtype=None, encoding="utf-8")


@pytest.mark.parametrize("feed", [1000, 3000])
@pytest.mark.parametrize("controller", ["independent", "existing", "proposed"])
def test_trajectory_and_true_errors_are_those_of_the_reference(feed: int, controller: str) -> None:
    rows = TABLE[(TABLE["feed_mm_min"] == feed) & (TABLE["controller"] == controller)]
    run = ct.simulate(ct.Path.paper(), feed, controller=controller)  # type: ignore[arg-type]
    k = rows["k"].astype(int)
    assert len(rows) >= 48
    assert len(run) == {1000: 4108, 3000: 1420}[feed]
    radians = np.array([1.0, 1.0, 1.0, np.pi / 180, np.pi / 180])
    reference = np.stack([rows[f"ref_{a}"] for a in "xyzac"], axis=1)
    actual = np.stack([rows[a] for a in "xyzac"], axis=1)
    np.testing.assert_allclose(run.u[k], rows["u_ref"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.reference[k] * radians, reference, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.actual[k] * radians, actual, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.foot_u[k], rows["u_foot"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.contour_um[k], rows["contour_um"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.orientation_arcsec[k], rows["orient_arcsec"], rtol=0, atol=1e-9)

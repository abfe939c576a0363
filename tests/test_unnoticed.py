"""Effects that stay unnoticed and shift an error of the machine."""

from __future__ import annotations

import numpy as np
import pytest

from trunnion.machine.unnoticed import BesideFit, unnoticed

ROWS = 40


@pytest.mark.parametrize("more", [0.0, 1e-8, -1e-8])
def test_effects_that_shift_as_much_are_in_the_order_of_the_catalogue(more: float) -> None:
    """What rounding makes larger is not said first: a delay and a ball radius at one speed."""
    rng = np.random.default_rng(61)
    jacobian = np.stack([np.ones(ROWS), rng.normal(size=ROWS)], axis=1)
    cofactor = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    other = 1e3 * rng.normal(size=ROWS)
    same = 1e4 * jacobian[:, 0] + other
    columns = {"trigger_delay.delay_ms": same + more * other, "probe_radius.radius_um": same}
    beside = BesideFit.of(jacobian, cofactor, columns)
    said = unnoticed(beside, ("EZ0A", "EY0C"), {"EZ0A": 0.01, "EY0C": 1.0}, 1e-3)
    assert [*said] == ["trigger_delay", "probe_radius"]


def test_columns_of_few_readings_are_what_they_are_among_all() -> None:
    """Columns that are zero but in the readings of one measurement, or everywhere."""
    rng = np.random.default_rng(62)
    jacobian = rng.normal(size=(ROWS, 3))
    cofactor = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    few = np.zeros(ROWS)
    few[10:15] = rng.normal(size=5)
    columns = {f"a.{i}": x for i, x in enumerate([few, np.zeros(ROWS), *[few] * 20])}
    beside = BesideFit.of(jacobian, cofactor, columns)
    along, left, *_ = np.linalg.lstsq(jacobian, few)
    assert beside.along[0] == pytest.approx(along)
    assert beside.left[0] == pytest.approx(float(np.sqrt(left[0])))
    assert beside.whole[[0, 1]] == pytest.approx([float(np.linalg.norm(few)), 0.0])
    assert beside.along[-1] == pytest.approx(along)

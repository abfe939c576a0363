"""What the columns of a kind of data are declared to be: readings, set positions, or neither."""

from pkgutil import resolve_name

import numpy as np
import pytest

import trunnion as tn
from trunnion.data import frame
from trunnion.files.table import Table
from trunnion.models import examples
from trunnion.models.kinds import Kind, kinds

EXAMPLES = [example for kind in kinds() for example in kind.examples]
EXACT = {"tip_x_mm", "tip_y_mm", "tip_z_mm"}
"""Readings that an example makes without noise of their own."""


@pytest.mark.parametrize("example", EXAMPLES)
def test_readings_are_what_another_noise_changes(
    example: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    one: Table = resolve_name(example)()[0]
    monkeypatch.setattr(examples, "SEED", examples.SEED + 10)
    other = resolve_name(example)()[0]
    changed = {name for name in one.columns if not np.array_equal(one[name], other[name])}
    assert changed
    assert changed - EXACT == set(one.readings) - EXACT
    assert set(one.set_positions).isdisjoint(changed)
    assert one.set_positions


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.name)
def test_every_column_of_positions_has_one_role(kind: Kind) -> None:
    """A column in mm, µm, degrees or µm/m is either, but for what describes cut, level, control."""
    cut = {"depth_mm", "diameter_mm", "turn_deg", *frame.COLUMNS}
    for name, column in resolve_name(kind.data).kinds.items():
        length = name.endswith(("_mm", "_um", "_deg", "_um_m"))
        assert column.observed + column.commanded == (length and name not in cut), name


def test_further_instruments_of_a_stop_are_readings_too() -> None:
    axis = tn.Positioning(
        target_mm=[0, 10], measured_mm=[0, 10.01], scale_mm=[0, 10], direction=[1, 1], cycle=[1, 1]
    )
    assert list(axis.readings) == ["measured_mm", "scale_mm"]
    assert list(axis.set_positions) == ["target_mm"]


def test_a_plan_of_an_r_test_has_no_readings() -> None:
    plan = tn.RotaryTest(c_deg=[0.0], x_mm=[1.0], y_mm=[2.0], z_mm=[3.0])
    assert not plan.readings

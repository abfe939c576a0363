"""What is given wrongly is refused with its name, and what is said in numbers keeps its meaning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.conformity import Conformity
from trunnion.diagnosis.records import Cause

BAR = tn.read(tn.sample_path("ballbar/circle.csv"))
AXIS = tn.read(tn.sample_path("positioning/axis.csv"))


def test_a_mapping_of_measurements_is_none_of_columns() -> None:
    said = r"data: got a mapping of measurements \('a': Ballbar, 'b': Positioning\), expected col"
    with pytest.raises(tn.InputError, match=said):
        tn.diagnose({"a": BAR, "b": AXIS})


def test_a_path_among_data_says_how_to_read_it() -> None:
    said = r"data\[1\]: got the path 'x1\.csv', expected measured data: trunnion\.read\('x1\.csv'\)"
    with pytest.raises(tn.InputError, match=said):
        tn.diagnose([BAR, "x1.csv"])


def test_a_table_of_conformity_keeps_the_sign() -> None:
    """EZ0A was −0.29 in the estimates and 0.29 in the table below."""
    found = Conformity.of({"EZ0A": -0.29}, {"EZ0A": 0.13}, {"EZ0A": 0.3})
    assert "−0.29" in found.summary()
    assert found.judged[0].value == 0.29  # the size, which is judged
    older = replace(found.judged[0], signed=None)
    assert "−" not in Conformity((older,), 0.95).table().cells()[0][1]


@pytest.mark.parametrize(("std", "said"), [(4.2, True), (0.1, False), (np.inf, False)])
def test_a_cause_whose_size_the_measurements_contradict_has_none(std: float, *, said: bool) -> None:
    """ "Backlash of Y 3.0 ± 4.2 µm (> 99 %)": it acts, but no size is known."""
    cause = Cause("backlash_y", {"b_um": 3.0}, {"b_um": std}, 1e-9, probability=1.0)
    assert bool(cause.reserve) == said
    assert replace(cause, probability=0.6).reserve == ""


def test_tests_that_settle_nothing_say_so() -> None:
    test = tn.NextMeasurement("a circle", "ballbar", 10.0, 0.0, {}, BAR)
    assert not test.helps
    assert "does not settle the doubt" in test.summary()
    assert "with a probability of 80 %" in replace(test, chance=0.8).summary()

"""What a measurement says of a machine, and what it may tell a control."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn


def only_c_turns() -> tuple[tn.Touches, tn.Setup]:
    """Touches of the sample at A = 0: they do not show where the A axis is."""
    touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    return touches[np.asarray(touches.a_deg) == 0], tn.read_setup(
        tn.sample_path("cross/setup.toml")
    )


def test_a_diagnosis_carries_nothing_unmeasured_into_a_control() -> None:
    part, setup = only_c_turns()
    model = tn.diagnose(part, setup).model
    assert np.isinf(model.std_errors["EY0A"])
    for use in (tn.cnc_parameters, tn.error_map, tn.volumetric_error):
        with pytest.raises(tn.DataError, match="EY0A"):
            use(setup, model)  # type: ignore[operator]

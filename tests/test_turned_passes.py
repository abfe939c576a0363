"""Turned passes from causes, by formulas written from docs/reference/effects.md."""

import numpy as np
import pytest

import trunnion as tn

SETUP = tn.Setup(artefact=tn.Artefact("none"), turning={"overhang_mm": 65.0})


def passes() -> tn.Diameters:
    z = np.arange(65.0, 4.0, -1.0)
    return tn.Diameters(
        {
            "z_mm": np.tile(z, 2),
            "error_um": np.zeros(2 * len(z)),
            "pass": np.repeat([1, 2], len(z)),
            "time_s": np.tile((65.0 - z) / 2.0, 2),
            "depth_mm": np.repeat([1.0, 2.0], len(z)),
        }
    )


def test_causes_add_up() -> None:
    planned = passes()
    z, t, depth = (np.asarray(planned[k]) for k in ("z_mm", "time_s", "depth_mm"))
    found = tn.simulate_diameters(
        planned,
        SETUP,
        {
            "tool_heating": {"amplitude_um": 30.0, "tau_s": 20.0},
            "chuck_tilt": {"tip_um": 4.0},
            "taper": {"angle_arcsec": 10.0},
        },
        offset_um=3.0,
    )
    heat = -30.0 * (1 - np.exp(-t / 20.0))
    tilt = 4.0 * (z / 65.0) ** 2 * depth
    taper = 2e3 * z * np.tan(10.0 * np.pi / 648000)
    expected = 3.0 + heat + tilt + taper
    np.testing.assert_allclose(found["error_um"], expected, rtol=0, atol=1e-6)


def test_what_was_turned_is_diagnosed() -> None:
    made = tn.simulate_diameters(
        passes(), SETUP, {"bending": {"tip_um": 12.0}}, noise_um=0.3, seed=2
    )
    again = tn.simulate_diameters(
        passes(), SETUP, {"bending": {"tip_um": 12.0}}, noise_um=0.3, seed=2
    )
    np.testing.assert_array_equal(made["error_um"], again["error_um"])
    found = tn.diagnose(made, SETUP)
    assert frozenset({"bending"}) in {frozenset(ids) for ids in found.alternatives}


def test_wrong_names_and_sizes_are_refused() -> None:
    with pytest.raises(tn.UnknownNameError, match="cause of a diameter error"):
        tn.simulate_diameters(passes(), SETUP, {"bendng": {}})
    with pytest.raises(tn.UnknownNameError, match="parameter of bending"):
        tn.simulate_diameters(passes(), SETUP, {"bending": {"um": 1.0}})
    with pytest.raises(tn.InputError, match="noise_um: got -1"):
        tn.simulate_diameters(passes(), SETUP, {}, noise_um=-1.0)

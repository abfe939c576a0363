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


def stepped() -> tn.Diameters:
    """One pass over three diameters, from the tailstock to the chuck."""
    z = np.arange(60.0, 2.0, -0.5)
    size = np.select([z > 40, z > 20], [30.0, 45.0], 60.0)
    return tn.Diameters(
        {"z_mm": z, "error_um": 0.0 * z, "time_s": (60.0 - z) / 1.5, "diameter_mm": size}
    )


def test_a_part_that_grows_shrinks_by_its_diameter() -> None:
    planned = stepped()
    causes = {"workpiece_heating": {"amplitude_um": 14.0, "tau_s": 25.0}}
    made = tn.simulate_diameters(planned, SETUP, causes)
    t, size = np.asarray(planned["time_s"]), np.asarray(planned["diameter_mm"])
    expected = -14.0 * size / 30.0 * (1 - np.exp(-t / 25.0))
    np.testing.assert_allclose(made["error_um"], expected, rtol=0, atol=1e-9)
    noisy = tn.simulate_diameters(planned, SETUP, causes, noise_um=0.3, seed=4)
    found = tn.diagnose(noisy, SETUP)
    assert any("workpiece_heating" in ids for ids in found.alternatives)
    assert not any(ids == {"tool_heating"} for ids in found.alternatives)
    # On one diameter it is the growth of the tool: it is no candidate there.
    one = tn.simulate_diameters(
        passes(), SETUP, {"tool_heating": {"amplitude_um": 20.0, "tau_s": 20.0}}, noise_um=0.3,
        seed=1,
    )  # fmt: skip
    assert not any("workpiece_heating" in ids for ids in tn.diagnose(one, SETUP).alternatives)


def test_acceleration_at_blocks_is_found_where_they_start() -> None:
    blocks = [50.0, 36.0, 21.0, 9.0]
    setup = tn.Setup(
        artefact=tn.Artefact("none"), turning={"overhang_mm": 65.0, "blocks_mm": blocks}
    )
    z = np.arange(60.0, 2.0, -0.2)
    planned = tn.Diameters({"z_mm": z, "error_um": 0.0 * z, "time_s": (60.0 - z) / 1.5})
    causes = {"block_acceleration": {"amplitude_um": 5.0, "way_mm": 1.5}}
    made = tn.simulate_diameters(planned, setup, causes)
    away = np.abs(z[:, None] - np.array(blocks)).min(axis=1)
    expected = np.where(away < 1.5, -5.0 * (1 - np.sqrt(away / 1.5)), 0.0)
    np.testing.assert_allclose(made["error_um"], expected, rtol=0, atol=1e-9)
    noisy = tn.simulate_diameters(planned, setup, causes, noise_um=0.4, seed=3)
    found = tn.diagnose(noisy, setup)
    assert {"block_acceleration"} in [set(ids) for ids in found.alternatives]
    cause = next(c for c in found.causes if c.id == "block_acceleration")
    assert abs(cause.parameters["amplitude_um"] - 5.0) < 4 * cause.std_errors["amplitude_um"]
    assert abs(cause.parameters["way_mm"] - 1.5) < 0.5
    nothing = tn.simulate_diameters(planned, setup, {}, noise_um=0.4, seed=3)
    assert not tn.diagnose(nothing, setup).causes
    # Where no blocks are stated, the same readings are not explained by them.
    assert not any("block_acceleration" in ids for ids in tn.diagnose(noisy, SETUP).alternatives)

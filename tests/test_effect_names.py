"""Effects by their ids and by the codes of ISO 230-1."""

import numpy as np
import pytest

import trunnion as tn
from trunnion.setup.names import effect_ids, iso_codes


@pytest.mark.parametrize(
    ("effect", "codes"),
    [
        ("scale_x", ("EXX",)),
        ("positioning_z", ("EZZ",)),
        ("straightness_y_of_x", ("EYX",)),
        ("angular_x_of_z", ("EAZ",)),
        ("angular_z_of_x", ("ECX",)),
        ("squareness_xy", ("EC0Y",)),
        ("squareness_xz", ("EB0Z",)),
        ("squareness_yz", ("EA0Z",)),
        ("a_positioning", ("EAA",)),
        ("a_sag", ("EYA", "EZA")),
        ("a_twist", ("EBA",)),
        ("b_sag", ("EXB", "EZB")),
        ("c_radial_2", ("EXC", "EYC")),
        ("c_axial", ("EZC",)),
        ("c_wobble_2", ("EAC", "EBC")),
        ("tilt_3", ("EAC", "EBC")),
        ("positioning_cyclic", ("ECC",)),
        ("probe_radius", ()),
        ("backlash_x", ()),
        ("drift", ()),
    ],
)
def test_codes_are_those_of_the_standard(effect: str, codes: tuple[str, ...]) -> None:
    assert iso_codes(effect) == codes


@pytest.mark.parametrize("spelling", ["EC0Y", "ECOY", "ec0y", "E_C0Y", "E_{C0Y}"])
def test_spellings_of_a_code(spelling: str) -> None:
    assert effect_ids(spelling, ["scale_x", "squareness_xy"]) == ("squareness_xy",)


def test_a_code_is_accepted_where_an_id_is() -> None:
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    data = tn.read_touches(tn.sample_path("cross/touches.csv"))
    one = tn.identify(data, setup, effects=("squareness_xy",))
    assert tn.identify(data, setup, effects=("EC0Y",)) == one
    plan = tn.plan(setup, c_deg=(0.0, 90.0), a_deg=(90.0,))
    moved = tn.simulate(plan, setup, effects={"EC0Y": {"arcsec": 30.0}})
    same = tn.simulate(plan, setup, effects={"squareness_xy": {"arcsec": 30.0}})
    assert np.array_equal(moved.position_mm, same.position_mm)
    assert tn.volumetric_error(setup, {}, {"EXX": {"ppm": 50.0}}).max_um > 1.0
    assert tn.diagnose(data, setup, effects=("EXX", "ecc")).verdict == "consistent"


def test_a_code_of_several_effects_is_refused_where_one_is_expected() -> None:
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    data = tn.read_touches(tn.sample_path("cross/touches.csv"))
    with pytest.raises(tn.InputError, match="got 'ECC', expected one of c_positioning, c_pos"):
        tn.identify(data, setup, effects=("ECC",))
    with pytest.raises(tn.UnknownNameError, match="EQQ"):
        tn.diagnose(data, setup, effects=("EQQ",))

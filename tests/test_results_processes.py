"""What results of hybrid machine, contouring and turning say and hold, beyond the contract."""

import numpy as np

import trunnion as tn
from result_examples import ballbar, correction, finishing, profile
from trunnion import hybrid, turning


def test_equal_results_have_equal_fields() -> None:
    one = hybrid.transformed_cube(hybrid.Mechanism(), "e4")
    other = hybrid.transformed_cube(hybrid.Mechanism(), "e4", 11.0)
    assert one != other
    assert one == hybrid.transformed_cube(hybrid.Mechanism(), "e4")
    assert turning.Crossing((1.0, 2.0), 5.0) != turning.Crossing((1.0, 2.0), 5.5)


def test_programs_and_profiles_come_back_from_results() -> None:
    found = correction()
    again = turning.Correction.from_json(found.to_json())
    assert again.program == found.program
    assert again.original == finishing().program
    path = turning.probe_path(profile(), chuck_radius_mm=0.0)
    back = turning.ProbePath.from_json(path.to_json())
    assert back.profile == profile()
    assert np.array_equal(back.stations_mm(5.0), path.stations_mm(5.0))


def test_what_is_not_identifiable_has_no_number_and_is_named() -> None:
    found = ballbar()
    assert found.std_errors["e15_um"] == np.inf
    assert found.to_dict()["std_errors"]["e15_um"] == "inf"
    assert "Not identifiable: e15_um." in found.sentences()
    assert isinstance(tn.hybrid.BallbarIdentification.from_dict(found.to_dict()), type(found))

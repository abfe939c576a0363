"""Every result of hybrid machine, contouring and turning is a value with one interface."""

import copy
import json
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import trunnion as tn
from trunnion import contouring, hybrid, turning
from trunnion.base.report import Result

POSE = [1100.0, 1130.0, 1110.0, 20.0, 5.0]
CENTRE = (0.0, -350.0, -1400.0)


def ballbar() -> hybrid.BallbarIdentification:
    machine = hybrid.Mechanism()
    plan = hybrid.ballbar_plan(machine, CENTRE, step_deg=15.0)
    return hybrid.identify_ballbar(plan, machine, sigma_um=0.5)


def identifiability() -> hybrid.Identifiability:
    machine = hybrid.Mechanism()
    return hybrid.identifiability(hybrid.ballbar_plan(machine, CENTRE, step_deg=15.0), machine)


def short() -> contouring.Path:
    return contouring.Path.circle(5.0, turn_deg=20.0, tilt_deg=10.0)


def comparison() -> contouring.ContourComparison:
    return contouring.compare(path=short(), feeds_mm_min=(1000.0, 2000.0))


def profile() -> turning.Profile:
    return turning.Profile.from_points([(100, 20), (50, 20), (50, 30), (0, 30)])


def finishing() -> turning.Finishing:
    return profile().finishing("linuxcnc-lathe", head=[[("G", 7)]], feed=100)


def correction() -> turning.Correction:
    z = np.arange(5.0, 45.0, 1.0)
    return turning.correct(finishing().program, (z, 12.0 * np.sin(z / 9.0)), unit_um=1.0)


def groove() -> turning.Finishing:
    points = [(100, 20), (60, 20), (60, 15), (40, 15), (40, 20), (0, 20)]
    part = turning.Profile.from_points(points)
    return part.finishing("linuxcnc-lathe", access_z_mm=[50.0], feed=100)


def crossing() -> turning.Crossing:
    return turning.Crossing((12.0, 9.0), 5.0)


RESULTS: dict[str, Callable[[], Result]] = {
    "Forward": lambda: hybrid.Mechanism().forward([POSE, POSE]),
    "Sensitivity": lambda: hybrid.Mechanism().sensitivity(POSE),
    "Constraint": lambda: hybrid.Mechanism().constraint(POSE),
    "ClosureDependence": lambda: hybrid.Mechanism().closure_dependence(POSE, {"base3_c": 10.0}),
    "Identifiability": identifiability,
    "BallbarIdentification": ballbar,
    "CubeStudy": lambda: hybrid.cube_study(hybrid.Mechanism(), ["e4", "e5"]),
    "CubeChange": lambda: hybrid.transformed_cube(hybrid.Mechanism(), "e4"),
    "ContourRun": lambda: contouring.simulate(short(), 1000.0),
    "ContourSweep": lambda: contouring.sweep([short()], [500.0, 1000.0]),
    "Margins": lambda: contouring.margins(path=short()),
    "ContourComparison": comparison,
    "Correction": correction,
    "Finishing": groove,
    "ProbePath": lambda: turning.probe_path(profile()),
    "Interval": lambda: turning.probe_path(profile()).intervals[0],
    "Crossing": crossing,
}


@pytest.fixture(scope="module", params=RESULTS)
def result(request: pytest.FixtureRequest) -> Result:
    return RESULTS[request.param]()


def test_the_list_has_every_result() -> None:
    public = {
        name
        for package in (hybrid, contouring, turning)
        for name in package.__all__
        if isinstance(getattr(package, name), type) and issubclass(getattr(package, name), Result)
    }
    assert public == set(RESULTS)


def test_it_is_a_value(result: Result) -> None:
    assert isinstance(result, Result)
    for again in (pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
        assert again is not result
        assert again == result
        assert hash(again) == hash(result)
        assert again.summary() == result.summary()
    assert result != "something else"


def test_it_goes_to_json_and_back(result: Result) -> None:
    text = result.to_json()
    assert json.loads(text) == result.to_dict()
    again = type(result).from_json(text)
    assert again == result
    assert again.to_json() == text


def test_it_is_read_by_people(result: Result) -> None:
    name = type(result).__name__
    shown = repr(result)
    assert shown.startswith(f"<{name}: ")
    assert len(shown) < 400
    assert "array(" not in shown
    page = result._repr_html_()
    assert page.count("<table>") == len(result.tables()) >= 1
    assert "<pre>" not in page
    for table in result.tables():
        assert table.title in result.summary().replace("\n", " ") or len(table.title) > 60
        assert len({len(row) for row in (table.columns, *table.rows)}) == 1
    for sentence in result.sentences():
        assert sentence in result.summary()


def test_it_is_a_data_frame(result: Result) -> None:
    pytest.importorskip("pandas")
    frame = result.to_dataframe()
    assert len(frame) > 0
    assert any(kind.kind in "fi" for kind in frame.dtypes)


NOTHING_TO_SEE = {
    "ClosureDependence", "Constraint", "Crossing", "Finishing", "Forward", "Interval"
}  # fmt: skip


def test_it_is_drawn_where_there_is_something_to_see(result: Result) -> None:
    if type(result).__name__ in NOTHING_TO_SEE:
        with pytest.raises(tn.InputError, match="plot: got"):
            result.plot()
        return
    drawn = result.plot()
    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    assert any(ax.has_data() for ax in figure.axes)
    plt.close(figure)


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
    path = turning.probe_path(profile())
    back = turning.ProbePath.from_json(path.to_json())
    assert back.profile == profile()
    assert np.array_equal(back.stations_mm(5.0), path.stations_mm(5.0))


def test_what_is_not_identifiable_has_no_number_and_is_named() -> None:
    found = ballbar()
    assert found.std_errors["e15_um"] == np.inf
    assert found.to_dict()["std_errors"]["e15_um"] == "inf"
    assert "Not identifiable: 1.00 e15_um." in found.sentences()
    assert isinstance(tn.hybrid.BallbarIdentification.from_dict(found.to_dict()), type(found))

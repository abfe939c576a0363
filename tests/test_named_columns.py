"""Data are a table, a DataFrame, an xarray Dataset or a dict of arrays, with one result."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from result_examples import cross

TOUCHES, SETUP = cross()
FORMS: dict[str, Callable[[tn.Touches], Any]] = {
    "DataFrame": lambda data: data.to_dataframe(),
    "DataFrame with an index": lambda data: data.to_dataframe().set_index(["time_s", "point"]),
    "Dataset": lambda data: data.to_xarray(),
    "Dataset with coordinates": lambda data: data.to_xarray().set_coords(["a_deg", "c_deg"]),
    "dict": lambda data: dict(data.columns),
}
CALLS: dict[str, Callable[[Any], Any]] = {
    "identify": lambda data: tn.identify(data, SETUP),
    "closed_form": lambda data: tn.closed_form(data, SETUP),
    "observability": lambda data: tn.observability(data, SETUP),
    "simulate": lambda data: tn.simulate(data, SETUP, {"EX0C": 5.0}),
    "probing_program": lambda data: tn.probing_program(data, SETUP).text(),
    "diagnose": lambda data: tn.diagnose(data, SETUP).to_dict()["causes"],
    "compare": lambda data: tn.compare(data, data, setup=SETUP),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_table_comes_back_from_every_form(form: str) -> None:
    assert tn.Touches(FORMS[form](TOUCHES)) == TOUCHES


@pytest.mark.parametrize("call", CALLS)
def test_every_form_gives_the_same_result(call: str) -> None:
    expected = CALLS[call](tn.Touches(TOUCHES.columns))
    for form in FORMS.values():
        assert CALLS[call](form(TOUCHES)) == expected


def test_a_grid_is_taken_node_by_node() -> None:
    """A plate measured on a grid: nominal places are the axes, measured ones two fields."""
    xarray = pytest.importorskip("xarray")
    x, y = np.linspace(0.0, 200.0, 9), np.linspace(0.0, 100.0, 7)
    along, across = np.meshgrid(x, y, indexing="ij")
    noise = 1e-4 * np.random.default_rng(4).standard_normal((2, *along.shape))
    axes = ("nominal_x_mm", "nominal_y_mm")
    plate = xarray.Dataset(
        {"x_mm": (axes, along * (1 + 40e-6) + noise[0]), "y_mm": (axes, across + noise[1])},
        {"nominal_x_mm": x, "nominal_y_mm": y},
    )
    points = tn.Points(plate)
    assert len(points) == 63
    np.testing.assert_array_equal(points.nominal_mm[:, 0], along.ravel())
    assert [cause.id for cause in tn.diagnose(plate).causes] == ["scale_x"]


def test_what_is_no_data_is_refused_by_its_argument() -> None:
    with pytest.raises(tn.InputError, match=r"data: got 3, expected a Touches, or a DataFrame"):
        tn.identify(3, SETUP)  # type: ignore[arg-type]
    with pytest.raises(tn.InputError, match="no such column"):
        tn.identify({"x_mm": [1.0]}, SETUP)  # type: ignore[arg-type]
    with pytest.raises(tn.InputError, match="plan: got Points"):
        tn.observability(tn.read_points(tn.sample_path("plate/first.csv")), SETUP)  # type: ignore[arg-type]

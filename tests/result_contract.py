"""What every result and every data table can do: one check, run over everything public.

For a class of one's own: ``check_result(example)``.
"""

import copy
import json
import pickle
import tempfile
from collections.abc import Callable
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from trunnion.base.errors import InputError
from trunnion.base.report import Result
from trunnion.base.units import unit_of
from trunnion.diagnosis.result import Diagnosis
from trunnion.files.table import Table
from trunnion.plot.dispatch import pictures
from trunnion.plot.picture import Picture

__all__ = ["check_result"]

NOTHING_TO_SEE = {
    "Alternative": "one probability; the picture of its diagnosis's sets has it beside the others",
    "ClockOffset": "one number with its uncertainty, a millionth of it",
    "Crossing": "two numbers; where a level is passed is in the picture of the diameters",
    "Dataset": "words: where measured data come from",
    "FailedDiagnosis": "a message",
    "Recognised": "words: how a file was read",
}
"""Class → why it has no picture; every other result and every kind of data has one."""
MAX_REPR_LINES = 4
MAX_REPR_CHARACTERS = 600


def check_result(result: Any) -> None:
    """Hold an example of a result, or of a data table, to everything that all of them can do.

    Raises
    ------
    AssertionError
        Every check that failed, with its reason.
    """
    failed = []
    for check in CHECKS:
        try:
            check(result)
        except Exception as error:
            failed.append(f"{check.__name__.removeprefix('_')}: {error!r:.300}")
    assert not failed, f"{type(result).__name__}:\n  " + "\n  ".join(failed)


def _is_a_result(result: Any) -> None:
    assert isinstance(result, Result | Table)


def _pickles(result: Any) -> None:
    assert pickle.loads(pickle.dumps(result)) == result


def _deep_copies(result: Any) -> None:
    assert copy.deepcopy(result) == result


def _differs_from_something_else(result: Any) -> None:
    assert result != "something else"
    assert (result == object()) is False


def _hashes_like_its_copy(result: Any) -> None:
    assert hash(copy.deepcopy(result)) == hash(result)


def _is_plain_in_json(result: Any) -> None:
    text = json.dumps(result.to_dict(), allow_nan=False)
    assert json.loads(text) == result.to_dict()
    json.loads(result.to_json())


def _comes_back_from_json(result: Any) -> None:
    if not _holds_code(result):
        again = type(result).from_json(result.to_json())
        assert again == result
        assert again.to_dict() == result.to_dict()
        assert again.to_json() == result.to_json()


def _holds_code(result: Any) -> bool:
    """Whether a field is a function or a model, which JSON cannot hold."""
    return isinstance(result, Result) and any(
        not f.compare and f.default is MISSING for f in fields(result)
    )


def _indents_json(result: Any) -> None:
    assert json.loads(result.to_json(indent=2)) == json.loads(result.to_json())


def _is_a_data_frame(result: Any) -> None:
    frame = result.to_dataframe()
    assert isinstance(frame, pd.DataFrame)
    assert len(frame.columns)
    if len(frame):
        assert any(kind.kind in "fi" for kind in frame.dtypes)


def _is_html_for_a_notebook(result: Any) -> None:
    page = result._repr_html_()
    assert "<table" in page or "<p>" in page
    assert "<pre" not in page
    if isinstance(result, Result):
        assert page.count("<table>") == len(result.tables())


def _has_a_short_repr(result: Any) -> None:
    text = repr(result)
    assert type(result).__name__ in text
    assert len(text.splitlines()) <= MAX_REPR_LINES, text
    assert len(text) <= MAX_REPR_CHARACTERS, text
    assert "array(" not in text


def _says_something(result: Any) -> None:
    if isinstance(result, Result):
        assert result.summary().strip()
        assert str(result) == result.summary()
        for sentence in result.sentences():
            assert sentence in result.summary()
        for table in result.tables():
            assert len({len(row) for row in (table.columns, *table.rows)}) == 1
        assert "nan" not in result.summary().lower().split()


def _draws(result: Any) -> None:
    if type(result).__name__ in NOTHING_TO_SEE:
        with pytest.raises(InputError, match="plot: got"):
            result.plot()
        return
    drawn = result.plot()
    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    assert any(ax.has_data() for ax in figure.axes)
    plt.close(figure)


def _is_drawn_for_pages_too(result: Any) -> None:
    """What matplotlib draws is described for pages as well: titles, axes with units, series."""
    if isinstance(result, Diagnosis):
        return  # its report draws more
    assert bool(pictures(result)) == (type(result).__name__ not in NOTHING_TO_SEE)
    for picture in pictures(result):
        assert isinstance(picture, Picture)
        assert picture.title
        assert picture.series
        figure = picture.figure()
        assert len(figure.data)
        json.loads(figure.to_json())


def _is_gridded_with_units(result: Any) -> None:
    """What is on a grid has named axes of the right length, units, and a file that holds it all."""
    if result.gridded() is None:
        with pytest.raises(InputError, match="nothing of it is on a grid"):
            result.to_xarray()
        return
    found = result.to_xarray()
    assert found.data_vars
    for name, values in found.variables.items():
        if (unit := unit_of(str(name))) and values.dtype.kind == "f":
            assert values.attrs["units"] == unit
    with tempfile.TemporaryDirectory() as folder:
        again = xr.load_dataset(result.save(Path(folder) / "a.nc"), engine="scipy")
    xr.testing.assert_equal(again, found)


CHECKS: tuple[Callable[[Any], None], ...] = (
    _is_a_result,
    _pickles,
    _deep_copies,
    _differs_from_something_else,
    _hashes_like_its_copy,
    _is_plain_in_json,
    _indents_json,
    _comes_back_from_json,
    _is_a_data_frame,
    _is_html_for_a_notebook,
    _has_a_short_repr,
    _says_something,
    _draws,
    _is_drawn_for_pages_too,
    _is_gridded_with_units,
)

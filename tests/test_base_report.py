"""What every result can do follows from its fields: text, JSON and back, equality, pickles."""

import copy
import json
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from trunnion.base.report import Result, Table, rough, significant
from trunnion.base.stored import plain


@dataclass(frozen=True, eq=False, repr=False)
class Inner(Result):
    """A result in a result."""

    name: str
    spread: float


@dataclass(frozen=True, eq=False, repr=False)
class Outer(Result):
    """One field of every sort."""

    values: NDArray[np.float64]
    rows: NDArray[np.intp]
    named: Mapping[str, float]
    inner: tuple[Inner, ...]
    missing: float | None = None

    def sentences(self) -> list[str]:
        return ["A <b>headline</b>."]

    def tables(self) -> tuple[Table, ...]:
        return (Table.of("Spreads", ("", "spread"), [(i.name, i.spread) for i in self.inner]),)


def outer() -> Outer:
    return Outer(
        np.array([[1.0, np.inf], [-np.inf, -0.5]]),
        np.array([3, 1]),
        {"a": 1.0, "b": float("inf")},
        (Inner("first", float("inf")), Inner("second", 0.25)),
    )


def test_json_and_back_keeps_every_field() -> None:
    back = Outer.from_json(outer().to_json())
    assert back == outer()
    assert back.rows.dtype == np.intp
    assert json.loads(outer().to_json())["inner"][0]["spread"] == "inf"


@pytest.mark.parametrize(
    "array",
    [
        np.array([[1.5, -0.0], [1e-300, 2.0]]),
        np.array([1.5, np.inf, np.nan]),
        np.array([0.1, 2.0], dtype=np.float32),
        np.array([[True], [False]]),
        np.array([-3, 1 << 60]),
        np.array([255], dtype=np.uint8),
        np.array(["a", "b c"]),
        np.array([None, "x", 1.5, -np.inf], dtype=object),
        np.array(2.5),
        np.zeros((0, 3)),
    ],
    ids=lambda array: f"{array.dtype} {array.shape}",
)
def test_an_array_is_stored_entry_by_entry(array: NDArray[Any]) -> None:
    def entries(part: Any) -> Any:
        if isinstance(part, np.ndarray) and part.ndim:
            return [entries(one) for one in part]
        one = part.item() if hasattr(part, "item") else part
        return str(one) if isinstance(one, float) and not np.isfinite(one) else one

    stored = plain(array)
    assert repr(stored) == repr(entries(array))  # types and signs of zero, too
    json.dumps(stored, allow_nan=False)


def test_a_table_shows_names_as_they_are() -> None:
    name = "offset [um] of [red]x[/red] :x:"
    shown = Table.of("Sizes", ("size [mm]", "[bold]"), [(name, 1.0)]).text()
    assert name in shown
    assert "size [mm]" in shown
    assert "[bold]" in shown


def test_a_copy_and_a_pickle_are_equal() -> None:
    first = outer()
    assert copy.deepcopy(first) == first
    assert pickle.loads(pickle.dumps(first)) == first
    assert hash(copy.deepcopy(first)) == hash(first)


@pytest.mark.parametrize(
    "change",
    [
        {"values": np.zeros((2, 2))},
        {"rows": np.array([3, 2])},
        {"named": {"a": 1.0}},
        {"inner": ()},
        {"missing": 0.0},
    ],
)
def test_a_changed_field_is_another_result(change: dict[str, object]) -> None:
    values = {name: getattr(outer(), name) for name in ("values", "rows", "named", "inner")}
    assert Outer(**{**values, **change}) != outer()


def test_numbers_stay_numbers_in_a_data_frame() -> None:
    pytest.importorskip("pandas")
    frame = outer().to_dataframe()
    assert list(frame.columns) == ["name", "spread"]
    assert frame["spread"].dtype == float
    assert frame["spread"][1] == 0.25


def test_text_and_html_say_the_same_and_html_is_escaped() -> None:
    assert "not identifiable" in outer().summary()
    assert "0.2500" in outer().summary()
    page = outer()._repr_html_()
    assert "&lt;b&gt;" in page
    assert "<td style" in page
    assert repr(outer()) == "<Outer: A <b>headline</b>.>"


def test_what_is_no_json_of_the_class_is_refused_with_its_place() -> None:
    with pytest.raises(tn.FileFormatError, match=r"JSON:1:2: got .* expected JSON"):
        Outer.from_json("{nonsense")
    with pytest.raises(tn.FileFormatError, match="got 'Inner', expected 'Outer'"):
        Outer.from_json(Inner("x", 1.0).to_json())
    with pytest.raises(tn.FileFormatError, match="Inner: got values that do not fit"):
        Inner.from_json('{"name": "x"}')


@pytest.mark.parametrize(
    ("value", "digits", "said"),
    [
        (270.4, 2, "270"),
        (99.7, 1, "100"),
        (3272.0, 3, "3270"),
        (56200.0, 3, "56200"),
        (-1.6942, 4, "−1.694"),
        (0.0123, 2, "0.012"),
        (1234567.0, 4, "1235000"),
    ],
)
def test_ordinary_sizes_have_no_exponent(value: float, digits: int, said: str) -> None:
    """Wander was "correlated over about 2.7e+02 s", a turn "+3.27e+03 arcsec"."""
    assert rough(value, digits) == said
    assert significant(value, digits).text == said
    assert rough(abs(value), digits, signed=True) == "+" + said.removeprefix("−")


def test_a_parameter_of_no_size_is_not_stated() -> None:
    """A warm-up that is a line: amplitude and time constant grow together."""
    sizes = {"amplitude_um": 3.06e9, "tau_min": 4.3e10}
    cause = tn.Cause("warmup", sizes, {"amplitude_um": 2.1e8, "tau_min": np.inf}, 1e-9)
    assert cause.size() == "2 parameters, identifiable in combination only"
    wave = tn.Cause("wave", {"a_um": 3.0, "b_um": -3.2}, {"a_um": 39.0, "b_um": 8.4}, 1e-9)
    assert wave.reserve == "; it acts, its parameters are determined in combination only"
    alone = tn.Cause("taper", {"angle_arcsec": 6.7}, {"angle_arcsec": 8.8}, 1e-9)
    assert alone.reserve == "; it acts, its size is not determined"
    assert replace(wave, std_errors={"a_um": 39.0, "b_um": 0.4}).reserve == ""

"""What every result can do follows from its fields: text, JSON and back, equality, pickles."""

import copy
import json
import pickle
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from trunnion.base.report import Result, Table


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

"""Checks of arguments: what passes, in which type, and in which words the rest is refused."""

import math
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.base import checks


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int8(2)])
def test_numbers_of_any_type_become_floats(value: Any) -> None:
    for number in (checks.finite("x", value), checks.positive("x", value)):
        assert type(number) is float
        assert number == 2.0
    assert checks.within("x", value, 0, 2) == 2.0


@pytest.mark.parametrize("value", ["2", True, None, math.nan, -math.inf, 10**400, 1j, [2.0]])
def test_what_is_no_finite_number_is_refused(value: Any) -> None:
    with pytest.raises(tn.InputError, match=r"^x: got .*, expected a finite number$"):
        checks.finite("x", value)
    with pytest.raises(tn.InputError, match=r"^x: got .*, expected a finite number above 0$"):
        checks.positive("x", value)
    with pytest.raises(tn.InputError, match=r"^x: got .*, expected a number from 0 to 9 mm$"):
        checks.within("x", value, 0, 9, "mm")


def test_limits_are_allowed_and_what_lies_beyond_is_not() -> None:
    assert checks.within("x", 0, 0) == 0.0
    for value in (-1e-9, 9.000001):
        with pytest.raises(tn.InputError, match="expected a number from 0 to 9"):
            checks.within("x", value, 0, 9)
    with pytest.raises(tn.InputError, match="above 0"):
        checks.positive("x", 0)


def test_whole_numbers() -> None:
    assert type(checks.whole("n", np.int64(3), 0)) is int
    assert checks.whole("n", 3, 0, 3) == 3
    for value in (-1, 4, 3.0, True, "3"):
        with pytest.raises(tn.InputError, match=r"n: got .*, expected a whole number from 0 to 3"):
            checks.whole("n", value, 0, 3)


def test_names_with_numbers() -> None:
    assert checks.numbers("errors", None) == {}
    assert checks.numbers("errors", {"EX0C": 1}) == {"EX0C": 1.0}
    with pytest.raises(tn.InputError, match=r"errors\.EX0C: got nan, expected a finite number"):
        checks.numbers("errors", {"EX0C": math.nan})
    with pytest.raises(tn.InputError, match=r"errors: got \[1\], expected names with numbers"):
        checks.numbers("errors", [1])


def test_arrays() -> None:
    assert checks.array("p", [1, 2, 3], 3).shape == (1, 3)
    assert checks.array("p", [[1, 2, 3]] * 4, 3, rows=4).flags.c_contiguous
    cases: tuple[tuple[Any, str], ...] = (
        ([1, 2], r"got shape \(2,\), expected \(n, 3\)"),
        ([["a", 1, 2]], r"expected numbers of shape \(n, 3\)"),
        ([[1, 2, 3], [4]], r"expected numbers of shape \(n, 3\)"),
        ([[1, 2, 3], [4, np.inf, 6]], "row 1: got .*, expected finite numbers"),
    )
    for value, words in cases:
        with pytest.raises(tn.InputError, match=words):
            checks.array("p", value, 3)
    with pytest.raises(tn.InputError, match=r"expected \(2, 3\)"):
        checks.array("p", [[1, 2, 3]], 3, rows=2)


def test_a_name_that_was_likely_meant_is_offered() -> None:
    known = ("scale_x", "backlash_y", "EX0C")
    assert checks.choose("effect", "scale_x", known) == "scale_x"
    for name, meant in (("scael_x", "scale_x"), ("ex0c", "EX0C")):
        with pytest.raises(tn.InputError, match=f"got '{name}'.*; did you mean {meant}"):
            checks.choose("effect", name, known)
    with pytest.raises(tn.UnknownNameError, match=r"expected one of scale_x, backlash_y, EX0C$"):
        checks.choose("effect", "tide", known)
    with pytest.raises(tn.UnknownNameError, match="got 3, expected"):
        checks.choose("effect", 3, known)


LONG = {"digits": 1 << 20_000, "text": "x" * 9000, "list": [0] * 9000, "dict": {"a": [0] * 9000}}


@pytest.mark.parametrize("value", LONG.values(), ids=LONG)
def test_a_message_stays_short(value: Any) -> None:
    with pytest.raises(tn.InputError) as error:
        checks.finite("x", value)
    assert len(str(error.value)) < 120


def test_an_error_knows_the_entry_that_it_is_about() -> None:
    with pytest.raises(tn.InputError) as error, checks.entry("a", 1), checks.entry("b"):
        checks.finite("x", None)
    assert error.value.entry == ("a", 1, "b")

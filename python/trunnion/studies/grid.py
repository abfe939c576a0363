"""The grid of a sweep: checked at once, before anything is computed or allocated."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.checks import did_you_mean, entry, named, shown, within
from trunnion.base.errors import InputError, UnknownNameError
from trunnion.studies.study import Parameter, Study, Value

MAX_NUMBERS = 250_000_000
"""Numbers in a result, 2 GB: beyond it a sweep is a mistake or several sweeps."""
MAX_NODES = 1_000_000
"""Each node is a call of the study at least."""
MAX_WHOLE = 2**53
"""Largest whole number: files hold numbers in double precision."""
RESERVED = ("sample", "failure", "**")
"""Names of dimensions that every result may have."""


@dataclass(frozen=True)
class Grid:
    """Axes in the order given, and what stays the same at all nodes."""

    axes: dict[str, tuple[Value, ...]]
    fixed: dict[str, Value]

    @classmethod
    def checked(
        cls,
        study: Study,
        grid: Mapping[str, Any] | None,
        fixed: Mapping[str, Any] | None,
        samples: int,
    ) -> Grid:
        """Every name known, every value of the right kind, no axis empty, none twice.

        Names and lengths come first: a grid that is too large is not even walked through.

        Raises UnknownNameError: a name that the study does not have.
        Raises InputError: anything else. Both say in `entry` which value of grid or fixed it is.
        """
        known = study.parameters
        tables = {}
        for what, given in (("grid", grid), ("fixed", fixed)):
            with entry(what):
                tables[what] = named(what, given, "a dict of names")
        for what, table in tables.items():
            for name in table:
                with entry(what, name):
                    _known(name, known, study)
        lengths = []
        for name, values in tables["grid"].items():
            with entry("grid", name):
                lengths.append(_length(name, values))
        _check_size(math.prod(lengths), samples, 1)
        axes = {}
        for name, values in tables["grid"].items():
            with entry("grid", name):
                axes[name] = _axis(name, values, known)
        return cls(axes, _fixed(tables["fixed"], axes, known))

    @classmethod
    def restored(cls, grid: Mapping[str, Any], fixed: Mapping[str, Any]) -> Grid:
        """From the tables that a file holds.

        Raises InputError: values that no sweep has.
        """
        for name, values in grid.items():
            _length(name, values)
        for name, value in fixed.items():
            if not isinstance(value, float | int | str):
                raise InputError(f"{name}: got {shown(value)}, expected a number or text")
        return cls({name: _axis(name, values, {}) for name, values in grid.items()}, dict(fixed))

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""
        return tuple(len(values) for values in self.axes.values())

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)

    def at(self, node: int) -> dict[str, Value]:
        """All parameters at node number `node`; the last axis runs fastest."""
        place = np.unravel_index(node, self.shape) if self.axes else ()
        own = {
            name: values[int(i)] for (name, values), i in zip(self.axes.items(), place, strict=True)
        }
        return {**self.fixed, **own}

    def check_size(self, samples: int, width: int) -> None:
        """Refuse what would not fit, before it is allocated."""
        _check_size(self.nodes, samples, width)


def _check_size(nodes: int, samples: int, width: int) -> None:
    if nodes > MAX_NODES:
        with entry("grid"):
            raise InputError(f"grid: got {_count(nodes)} nodes, expected at most {MAX_NODES:.0e}")
    if nodes * samples * width > MAX_NUMBERS:
        with entry("samples"):
            raise InputError(
                f"sweep: got {_count(nodes)} nodes × {_count(samples)} samples × {width} numbers "
                f"= {_count(nodes * samples * width)}, expected at most {MAX_NUMBERS:.3g}: fewer "
                "samples, or several sweeps"
            )


def _count(value: int) -> str:
    return f"{value:.6g}" if value < 10**300 else "more than 1e300"


def _fixed(
    given: Mapping[Any, Any], axes: Mapping[str, object], known: Mapping[str, Parameter]
) -> dict[str, Value]:
    """What stays the same: defaults, then what is given."""
    fixed: dict[str, Value] = {
        name: parameter.default
        for name, parameter in known.items()
        if parameter.default is not None and not parameter.optional and name not in axes
    }
    for name, value in given.items():
        with entry("fixed", name):
            if name in axes:
                raise InputError(f"{name}: got it in the grid and in fixed, expected it in one")
            fixed[name] = _value(name, value, known)
    for name in known:
        if name not in axes and name not in fixed and name != "**" and not known[name].optional:
            raise InputError(f"{name}: got nothing, expected it in the grid or in fixed")
    return fixed


def _known(name: Any, known: Mapping[str, Parameter], study: Study) -> None:
    if not isinstance(name, str) or (name not in known and "**" not in known):
        expected = f"one of {', '.join(known)}" if known else "none: it has no parameters"
        expected += did_you_mean(name, known)
        raise UnknownNameError(
            f"parameter of study {study.name}: got {shown(name)}, expected {expected}"
        )


def _length(name: str, values: Any) -> int:
    if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray):
        raise InputError(f"axis {name}: got {shown(values)}, expected a list of values")
    if isinstance(values, np.ndarray) and values.ndim != 1:
        raise InputError(
            f"axis {name}: got an array of shape {values.shape}, expected one dimension"
        )
    if name in RESERVED:
        raise InputError(f"axis {name}: the name is taken, expected another")
    try:
        length = len(values)
    except OverflowError:  # a range beyond what len can say
        length = sys.maxsize
    if length == 0:
        raise InputError(f"axis {name}: got no values, expected at least one")
    return length


def _axis(name: str, values: Any, known: Mapping[str, Parameter]) -> tuple[Value, ...]:
    if name in known and not known[name].in_grid:
        raise InputError(f"{name}: got it in the grid, expected it in fixed: outputs depend on it")
    checked = []
    for place, value in enumerate(values):
        with entry(place):
            checked.append(_value(name, value, known))
    if len({float if type(value) is int else type(value) for value in checked}) > 1:
        raise InputError(
            f"axis {name}: got values of several kinds, expected only numbers, only text or only "
            "true and false"
        )
    if len(set(checked)) < len(checked):
        raise InputError(f"axis {name}: got a value twice, expected each once")
    return tuple(checked)


def _value(name: str, value: Any, known: Mapping[str, Parameter]) -> Value:
    parameter = known.get(name, Parameter(None))
    if isinstance(value, np.generic):
        value = value.item()
    kind = type(parameter.default)
    if isinstance(value, int) and abs(value) > MAX_WHOLE:
        raise InputError(f"{name}: got a whole number beyond 2^53, expected a smaller one")
    expected = _wanted(value, kind)
    if expected:
        raise InputError(f"{name}: got {shown(value)}, expected {expected}")
    if parameter.choices and value not in parameter.choices:
        choices = ", ".join(str(choice) for choice in parameter.choices)
        raise InputError(f"{name}: got {value!r}, expected one of {choices}")
    if parameter.low is not None and not isinstance(value, str):
        within(name, value, parameter.low, parameter.high)
    checked: Value = float(value) if kind is float else value
    return checked


def _wanted(value: Any, kind: type) -> str:
    """What a parameter with a default of this kind takes; "" if it takes the value."""
    flag = isinstance(value, bool)
    if kind is str:
        good, expected = isinstance(value, str), "text"
    elif kind is bool:
        good, expected = flag, "true or false"
    elif kind is int:
        good, expected = isinstance(value, int) and not flag, "a whole number"
    elif kind is type(None):
        good, expected = isinstance(value, float | int | str), "a number or text"
    else:
        good, expected = isinstance(value, float | int) and not flag, "a number"
    finite = not isinstance(value, float) or math.isfinite(value)
    return "" if good and finite else expected

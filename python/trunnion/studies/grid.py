"""The grid of a sweep: checked at once, before anything is computed or allocated."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.errors import InputError, UnknownNameError
from trunnion.studies.study import Parameter, Study, Value

__all__ = ["MOST_NUMBERS", "Grid"]

MOST_NUMBERS = 250_000_000
"""Most numbers in a result, 2 GB: beyond it a sweep is a mistake or several sweeps."""

MOST_NODES = 1_000_000
"""Most nodes: each is a call of the study at least."""
LARGEST = 2**53
"""Largest whole number: files hold numbers in double precision."""
TAKEN = ("sample", "failure", "**")
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

        Raises
        ------
        UnknownNameError
            A name that the study does not have.
        InputError
            Anything else.
        """
        known = study.parameters
        for what, given in (("grid", grid), ("fixed", fixed)):
            if given is not None and not isinstance(given, Mapping):
                raise InputError(f"{what}: got {given!r}, wanted a dict of names")
            for name in given or {}:
                _known(name, known, study)
        lengths = [_length(name, values) for name, values in (grid or {}).items()]
        _check_size(math.prod(lengths), samples, 1)
        axes = {name: _axis(name, values, known) for name, values in (grid or {}).items()}
        held = {
            name: parameter.default
            for name, parameter in known.items()
            if parameter.default is not None and name not in axes
        }
        for name, value in (fixed or {}).items():
            if name in axes:
                raise InputError(f"{name}: got it in the grid and in fixed, wanted it in one")
            held[name] = _value(name, value, known)
        for name, parameter in known.items():
            if parameter.default is None and name not in axes and name not in held and name != "**":
                raise InputError(f"{name}: got nothing, wanted it in the grid or in fixed")
        return cls(axes, held)

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
    if nodes > MOST_NODES:
        raise InputError(f"grid: got {nodes:.6g} nodes, wanted at most {MOST_NODES:.0e}")
    numbers = nodes * samples * width
    if numbers > MOST_NUMBERS:
        raise InputError(
            f"sweep: got {nodes:.6g} nodes × {samples:.6g} samples × {width} numbers = "
            f"{numbers:.3g}, wanted at most {MOST_NUMBERS:.3g}: fewer samples, or several sweeps"
        )


def _known(name: Any, known: Mapping[str, Parameter], study: Study) -> None:
    if not isinstance(name, str) or (name not in known and "**" not in known):
        wanted = f"one of {', '.join(known)}" if known else "none: it has no parameters"
        raise UnknownNameError(f"parameter of study {study.name}: got {name!r}, wanted {wanted}")


def _length(name: str, values: Any) -> int:
    if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray):
        raise InputError(f"axis {name}: got {values!r}, wanted a list of values")
    if isinstance(values, np.ndarray) and values.ndim != 1:
        raise InputError(f"axis {name}: got an array of shape {values.shape}, wanted one dimension")
    if name in TAKEN:
        raise InputError(f"axis {name}: the name is taken, wanted another")
    try:
        length = len(values)
    except OverflowError:  # a range beyond what len can say
        length = sys.maxsize
    if length == 0:
        raise InputError(f"axis {name}: got no values, wanted at least one")
    return length


def _axis(name: str, values: Any, known: Mapping[str, Parameter]) -> tuple[Value, ...]:
    if name in known and not known[name].in_grid:
        raise InputError(f"{name}: got it in the grid, wanted it in fixed: outputs depend on it")
    checked = tuple(_value(name, value, known) for value in values)
    if len({_kind(value) for value in checked}) > 1:
        raise InputError(
            f"axis {name}: got values of several kinds, wanted only numbers, only text or only "
            "true and false"
        )
    if len(set(checked)) < len(checked):
        raise InputError(f"axis {name}: got a value twice, wanted each once")
    return checked


def _kind(value: Value) -> type:
    return float if type(value) is int else type(value)


def _value(name: str, value: Any, known: Mapping[str, Parameter]) -> Value:
    parameter = known.get(name, Parameter(None))
    if isinstance(value, np.generic):
        value = value.item()
    kind = type(parameter.default)
    if parameter.default is None:
        good, wanted = isinstance(value, float | int | str), "a number or text"
    elif kind is str:
        good, wanted = isinstance(value, str), "text"
    elif kind is bool:
        good, wanted = isinstance(value, bool), "true or false"
    elif kind is int:
        good, wanted = isinstance(value, int) and not isinstance(value, bool), "a whole number"
    else:
        good = isinstance(value, float | int) and not isinstance(value, bool)
        wanted = "a number"
    if isinstance(value, int) and abs(value) > LARGEST:
        raise InputError(f"{name}: got a whole number beyond 2^53, wanted a smaller one")
    if not good or (isinstance(value, float) and not math.isfinite(value)):
        raise InputError(f"{name}: got {value!r}, wanted {wanted}")
    if parameter.choices and value not in parameter.choices:
        choices = ", ".join(str(choice) for choice in parameter.choices)
        raise InputError(f"{name}: got {value!r}, wanted one of {choices}")
    if parameter.low is not None and not isinstance(value, str) and value < parameter.low:
        raise InputError(f"{name}: got {value!r}, wanted {parameter.low:g} or more")
    if parameter.high is not None and not isinstance(value, str) and value > parameter.high:
        raise InputError(f"{name}: got {value!r}, wanted {parameter.high:g} or less")
    checked: Value = float(value) if kind is float else value
    return checked

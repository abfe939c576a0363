"""The keys of a set-up's tables: how each is declared, checked, described and found in its file.

A table is a frozen dataclass whose fields are declared by `key`: the default, what values the key
takes, and what it means. The same declaration serves the constructor (of a `Part`), the reader of
files, the writer and the description for people::

    @dataclass(frozen=True)
    class Probe(Part):
        table: ClassVar[str] = "probe"
        ball_radius_mm: float = key(1.0, LENGTH, "radius of the ball")

    setup.servo.table("X").build(LinearAxis)     # any dataclass, from any table of a file

Units are those of the names (`trunnion.base.units`).
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from trunnion.base.checks import (
    choose,
    did_you_mean,
    entry,
    finite,
    instance,
    mapping,
    positive,
    shown,
    within,
)
from trunnion.base.errors import InputError, UnknownNameError
from trunnion.base.frozen import FrozenMapping, thawed
from trunnion.base.report import Table
from trunnion.base.units import unit_of
from trunnion.files.toml import MAX_DEPTH, TomlText

T = TypeVar("T")

# --- what a key takes


class Takes(Protocol):
    """The values that a key takes: a check of one of them, and words for a message."""

    @property
    def words(self) -> str:
        """What is expected."""
        ...

    def __call__(self, what: str, value: Any) -> Any:
        """Return the value in its final type, or raise InputError; `what` begins the message."""
        ...


@dataclass(frozen=True)
class Number:
    """Numbers from `low` to `high`, or (`positive`) above 0; finite unless `infinite`."""

    low: float = -math.inf
    high: float = math.inf
    positive: bool = False
    infinite: bool = False

    @property
    def words(self) -> str:
        """What is expected."""
        if self.positive:
            return "a finite number above 0"
        if self.high < math.inf:
            return f"a number from {self.low:g} to {self.high:g}"
        return "a finite number" + (f", {self.low:g} or above" if self.low > -math.inf else "")

    def __call__(self, what: str, value: Any) -> float:
        """Return the number."""
        if self.infinite and isinstance(value, float) and value == math.inf:
            return value
        if self.positive:
            return positive(what, value)
        if self.low == -math.inf:
            return finite(what, value)
        return within(what, value, self.low, self.high, unit_of(what))


LENGTH = Number(1e-3, 1e5)
"""Sizes of machines, artefacts and probes, mm: from 1 µm to 100 m."""

COORDINATE = Number(-1e5, 1e5)
"""Coordinates, mm."""


@dataclass(frozen=True)
class Choice:
    """One of some texts."""

    names: tuple[str, ...]

    @property
    def words(self) -> str:
        """What is expected."""
        return "one of " + ", ".join(self.names)

    def __call__(self, what: str, value: Any) -> str:
        """Return the text."""
        return choose(what, value, self.names)


@dataclass(frozen=True)
class Flag:
    """True or false."""

    words: str = "true or false"

    def __call__(self, what: str, value: Any) -> bool:
        """Return it."""
        return instance(what, value, bool, self.words)


@dataclass(frozen=True)
class Sign:
    """1 or -1."""

    words: str = "1 or -1"

    def __call__(self, what: str, value: Any) -> int:
        """Return it."""
        if abs(finite(what, value, self.words)) != 1.0:
            raise InputError(f"{what}: got {value!r}, expected {self.words}")
        return 1 if value == 1 else -1


@dataclass(frozen=True)
class Vector:
    """A list of `count` numbers; 0: of any length."""

    count: int
    each: Takes = field(default_factory=Number)

    @property
    def words(self) -> str:
        """What is expected."""
        return f"a list of {self.count} numbers" if self.count else "a list of numbers"

    def __call__(self, what: str, value: Any) -> tuple[float, ...]:
        """Return them."""
        values = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(values, list | tuple) or self.count not in (0, len(values)):
            raise InputError(f"{what}: got {thawed(value)!r}, expected {self.words}")
        found = []
        for index, item in enumerate(values):
            with entry(index):
                found.append(self.each(f"{what}[{index}]", item))
        return tuple(found)


@dataclass(frozen=True)
class Vectors:
    """A list of `least` to `most` lists of `count` numbers."""

    count: int
    least: int
    most: int
    each: Takes = field(default_factory=Number)

    @property
    def words(self) -> str:
        """What is expected."""
        return f"a list of {self.least} to {self.most} lists of {self.count} numbers"

    def __call__(self, what: str, value: Any) -> tuple[tuple[float, ...], ...]:
        """Return them."""
        values = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(values, list | tuple) or not self.least <= len(values) <= self.most:
            raise InputError(f"{what}: got {thawed(value)!r}, expected {self.words}")
        takes = Vector(self.count, self.each)
        found = []
        for index, item in enumerate(values):
            with entry(index):
                found.append(takes(f"{what}[{index}]", item))
        return tuple(found)


@dataclass(frozen=True)
class Numbers:
    """A table of names with numbers; the owner knows the names."""

    words: str = "a table of names with numbers"

    def __call__(self, what: str, value: Any) -> FrozenMapping[float]:
        """Return it."""
        found = {}
        for name, size in mapping(what, value, self.words).items():
            with entry(name):
                found[name] = finite(f"{what}.{name}", size)
        return FrozenMapping(found)


# --- keys of a table


@dataclass(frozen=True)
class Key:
    """One key of a table; `default` is MISSING where the key is required."""

    takes: Takes
    meaning: str
    default: Any = MISSING


def key(default: Any, takes: Takes, meaning: str) -> Any:
    """Declare a key as a field of a dataclass; default ``...``: required, None: may be absent."""
    metadata = {"takes": takes, "meaning": meaning}
    return field(metadata=metadata) if default is ... else field(default=default, metadata=metadata)


def keys_of(kind: Any) -> Mapping[str, Key]:
    """Return the keys that a dataclass declares, by name."""
    return {
        item.name: Key(item.metadata["takes"], item.metadata["meaning"], item.default)
        for item in fields(kind)
        if "takes" in item.metadata
    }


class Part:
    """Base of a table's dataclass: values are checked, in their final type, when it is made."""

    table: ClassVar[str]

    def __post_init__(self) -> None:
        """Check every field."""
        for name, declared in keys_of(type(self)).items():
            value = getattr(self, name)
            if value is None and declared.default is None:
                continue
            with entry(name):
                value = declared.takes(f"{self.table}.{name}", value)
            object.__setattr__(self, name, value)

    def refuse(self, name: str, expected: str) -> InputError:
        """Return the error that a value is wrong beside others."""
        value = getattr(self, name)
        got = "missing" if value is None else f"got {value!r}"
        error = InputError(f"{self.table}.{name}: {got}, expected {expected}")
        error.entry = (name,)
        return error

    def own_keys(self) -> Mapping[str, Key]:
        """Return the keys that this one has; all that the class declares, unless a class says."""
        return keys_of(type(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the keys with plain values, as they stand in a file; absent ones left out."""
        values = {name: thawed(getattr(self, name)) for name in self.own_keys()}
        return {name: value for name, value in values.items() if value is not None}

    def _repr_html_(self) -> str:
        return report(f"[{self.table}]", [("", self)]).html()


def report(title: str, parts: Iterable[tuple[str, Part]]) -> Table:
    """Return what stands in parts, each with the table it is in, with units and meanings."""
    rows: list[tuple[str, ...]] = []
    for above, part in parts:
        head = above and f"{above}."
        for name, declared in part.own_keys().items():
            value = thawed(getattr(part, name))
            if isinstance(value, dict):  # machine.errors
                rows += [(f"{head}{name}.{k}", f"{v:g}", unit_of(k), "") for k, v in value.items()]
            else:
                text = f"{value:g}" if isinstance(value, float) else str(value)
                text = "–" if value is None else text
                rows.append((head + name, text, unit_of(name), declared.meaning))
    return Table.of(title, ("key", "value", "unit", "meaning"), rows)


# --- tables of a file


class Section(FrozenMapping[Any]):
    """A table of a set-up: frozen values by key, and the file it stands in (None: built).

    Errors raised under `placed` name file, line and column where there is a file.
    """

    __slots__ = ("file", "keys_above")

    def __init__(
        self,
        values: Mapping[str, Any],
        keys_above: tuple[str, ...] = (),
        file: TomlText | None = None,
    ) -> None:
        self.keys_above, self.file = keys_above, file
        super().__init__(_frozen(".".join(keys_above), values, MAX_DEPTH - len(keys_above))._values)

    @classmethod
    def of(cls, name: str, table: object) -> Self:
        """Return a table of the set-up: as it is, or of a plain mapping."""
        if isinstance(table, cls):
            return table
        return cls(mapping(name, table), (name,))

    @property
    def name(self) -> str:
        """The keys that lead to it, with dots."""
        return ".".join(self.keys_above)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._values, self.keys_above, self.file)

    def table(self, name: str) -> Section:
        """Return a table below this one; an absent one is empty."""
        keys = (*self.keys_above, name)
        with self.placed(), entry(name):
            below = mapping(".".join(keys), self.get(name, {}))
        return Section(below, keys, self.file)

    @contextmanager
    def placed(self, said: str = "") -> Iterator[None]:
        """Give errors raised inside their place in the file; `said` is how they name the table."""
        try:
            yield
        except InputError as error:
            text = str(error)
            if said and text.startswith(said):
                text = self.name + text.removeprefix(said)
            if self.file is None:
                error.args = (text,)
                raise
            keys = (*self.keys_above, *error.entry)
            raise self.file.error(keys, text, at_value=True) from None

    def only(self, known: Iterable[str]) -> None:
        """Refuse keys that are not known."""
        names = tuple(known)
        for name in self:
            if name not in names:
                path = (*self.keys_above, name)
                what = f"{'.'.join(path)}: unknown key, expected one of {', '.join(names)}"
                what += did_you_mean(name, names)
                if self.file is None:
                    raise UnknownNameError(what)
                raise self.file.error(path, what, at_value=False)

    def read(self, declared: Mapping[str, Key], beside: Iterable[str] = ()) -> dict[str, Any]:
        """Return the checked values of the keys that are there; required ones have to be.

        `beside`: keys that may be there too, read elsewhere.
        """
        self.only((*declared, *beside))
        head = f"{self.name}." if self.name else ""
        found = {}
        for name, one in declared.items():
            with self.placed(), entry(name):
                if name in self:
                    found[name] = one.takes(head + name, self[name])
                elif one.default is MISSING:
                    raise InputError(
                        f"{head}{name}: missing, expected {one.takes.words}: {one.meaning}"
                    )
        return found

    def build(self, kind: type[T], declared: Mapping[str, Key] | None = None) -> T:
        """Return a dataclass made from the table; `declared` if only some of its keys are meant."""
        values = self.read(keys_of(kind) if declared is None else declared)
        with self.placed(getattr(kind, "table", "")):
            return kind(**values)


_SCALARS = str | bool | int | float | datetime.datetime | datetime.date | datetime.time


def _frozen(what: str, value: Any, depth: int) -> Any:
    """Return a value of TOML as one that does not change."""
    if depth < 0:
        raise InputError(f"{what:.40}...: got more than {MAX_DEPTH} tables in one another")
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Mapping):
        for name in value:
            instance(what, name, str, "text as key")
        return FrozenMapping({k: _frozen(f"{what}.{k}", v, depth - 1) for k, v in value.items()})
    if isinstance(value, list | tuple):
        return tuple(_frozen(f"{what}[{n}]", item, depth - 1) for n, item in enumerate(value))
    if isinstance(value, int) and value.bit_length() > 4096:
        raise InputError(f"{what}: got a whole number of more than 1000 digits, expected fewer")
    if not isinstance(value, _SCALARS):
        raise InputError(f"{what}: got {shown(value)}, expected a value of TOML")
    return value

"""What a study is: parameters in, outputs out, a block of samples at a node at a time.

Built-in studies are in :data:`STUDIES` by name; a further one is one entry there. A user's own
Python function becomes one by :class:`FunctionStudy`, which :func:`trunnion.sweep` does by itself.
"""

from __future__ import annotations

import hashlib
import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from types import CodeType
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np

from trunnion.base.checks import choose, named
from trunnion.base.errors import InputError, TrunnionError
from trunnion.base.units import Floats
from trunnion.setup import Setup

Value: TypeAlias = float | int | str | bool
Values: TypeAlias = Mapping[str, Value]


@dataclass(frozen=True)
class Parameter:
    """A parameter of a study: what it is unless the grid or `fixed` say otherwise.

    `default` None: it must be given. Its type is that of the default; a number takes any number,
    a whole number only whole ones. `choices`: the only values allowed. `low`, `high`: the least
    (None: any number) and the most. `in_grid` False: outputs depend on it, so that it must be the
    same at all nodes. `optional`: it is not there unless the grid or `fixed` has it.
    """

    default: Value | None
    unit: str = ""
    choices: tuple[Value, ...] = ()
    low: float | None = None
    high: float = math.inf
    in_grid: bool = True
    optional: bool = False


TRUTH: Mapping[str, Parameter] = {
    "errors_um": Parameter(60.0, "µm", low=0.0),
    "errors_arcsec": Parameter(60.0, "arcsec", low=0.0),
    "placement_um": Parameter(100.0, "µm", low=0.0),
    "placement_arcsec": Parameter(100.0, "arcsec", low=0.0),
}
"""Half-widths of the uniform distributions of true location errors and placements."""


@dataclass(frozen=True)
class Output:
    """An output of a study, one number a sample, or one for each `labels` along dimension `dim`.

    `unit` may be a tuple, one for each of `labels`. `label` says to people what it is.
    """

    name: str
    unit: str | tuple[str, ...] = ""
    dim: str = ""
    labels: tuple[str, ...] = ()
    label: str = ""

    @property
    def width(self) -> int:
        """Numbers a sample."""
        return len(self.labels) or 1


@dataclass(frozen=True)
class Seeds:
    """Random numbers of one node: they depend on seed, node and number of the sample alone."""

    seed: int
    node: int

    def generator(self, sample: int) -> np.random.Generator:
        """Numbers of one sample."""
        return np.random.default_rng(self._sequence(sample))

    def whole(self) -> int:
        """A 63-bit whole number for the node, to seed the core with."""
        return int(self._sequence().generate_state(1, np.uint64)[0] >> np.uint64(1))

    def uniform(self, first: int, count: int, width: int) -> Floats:
        """Rows of `width` numbers in [0, 1) for samples `first` onward: (count, width).

        Philox makes four numbers from each value of a counter, so that any piece of the table can
        be had without the ones before.
        """
        per_sample = -(-width // 4)
        key = self._sequence().generate_state(2, np.uint64)
        philox = np.random.Philox(key=key)
        philox.advance(first * per_sample)
        drawn = np.random.Generator(philox).random((count, 4 * per_sample))
        return np.asarray(drawn[:, :width])

    def _sequence(self, *sample: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.seed, spawn_key=(self.node, *sample))


@dataclass(frozen=True)
class Block:
    """Outputs of consecutive samples at a node: (count, columns), not numbers where one failed."""

    columns: Floats
    failures: tuple[tuple[int, str], ...] = ()
    """Samples that failed, counted from the block's first, and why."""


@runtime_checkable
class Study(Protocol):
    """What :func:`trunnion.sweep` runs. Must be picklable to go to other processes."""

    @property
    def name(self) -> str:
        """What the result calls it."""
        ...

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """What the grid may vary."""
        ...

    def outputs(self, values: Values) -> tuple[Output, ...]:
        """What comes out, in the order of the columns; `values` are those of the first node."""
        ...

    @property
    def chunk(self) -> int:
        """Samples in a block: a second's work or so."""
        ...

    def run(
        self, values: Values, seeds: Seeds, first: int, count: int, threads: int | None
    ) -> Block:
        """Samples `first` to `first + count` at a node; `threads` None: all cores are its own."""
        ...


@dataclass(frozen=True)
class FunctionStudy:
    """A user's function ``f(rng, **parameters)`` that returns a number or a dict of numbers.

    Parameters
    ----------
    function
        Called once a sample with the sample's own random generator and the node's parameters.
    units
        Units of the outputs, by name, for the labels of the result.
    names
        Names of the outputs, in the order of the columns; a sample that returns others fails.
        Empty: those of the first sample of a block.
    """

    function: Callable[..., Any]
    units: Mapping[str, str] = field(default_factory=dict)
    chunk: int = 1
    names: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the function."""
        return getattr(self.function, "__name__", type(self.function).__name__)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """The function's arguments but for the first; ``**`` in its signature allows any.

        A default that is no number and no text is left to the function.
        """
        found: dict[str, Parameter] = {}
        for number, (name, argument) in enumerate(
            inspect.signature(self.function).parameters.items()
        ):
            if number == 0 or argument.kind is argument.VAR_POSITIONAL:
                continue
            if argument.kind is argument.VAR_KEYWORD:
                found["**"] = Parameter(None)
                continue
            default = argument.default
            if default is argument.empty:
                found[name] = Parameter(None)
            elif isinstance(default, float | int | str):
                found[name] = Parameter(default)
        return found

    def outputs(self, values: Values) -> tuple[Output, ...]:
        """Names from a trial on random numbers that no sample uses."""
        last: Exception | None = None
        for sample in range(2**32 - 8, 2**32):
            try:
                found = self._call(values, Seeds(0, 2**32 - 1).generator(sample))
            except Exception as error:  # a sample may fail; the next one may not
                last = error
            else:
                return tuple(Output(name, self.units.get(name, "")) for name in found)
        raise InputError(
            f"study {self.name}: eight trials failed, the last with {type(last).__name__}: {last}"
        )

    def of_outputs(self, outputs: tuple[Output, ...]) -> FunctionStudy:
        """Return the study with the names of its outputs."""
        return replace(self, names=tuple(output.name for output in outputs))

    def code(self) -> str:
        """Digest of what the function does, as far as its own code says; "" where it has none.

        What it reads from outside, other functions or variables, does not enter.
        """
        code = getattr(self.function, "__code__", None)
        return "" if code is None else hashlib.sha256(_spelled(code).encode()).hexdigest()[:16]

    def run(
        self,
        values: Values,
        seeds: Seeds,
        first: int,
        count: int,
        threads: int | None,  # noqa: ARG002
    ) -> Block:
        """Call the function for each sample."""
        names = self.names
        rows: list[list[float] | None] = []
        failures: list[tuple[int, str]] = []
        for index in range(count):
            try:
                found = self._call(values, seeds.generator(first + index))
                names = names or tuple(found)
                if set(found) != set(names):
                    got = ", ".join(found) or "none"
                    raise InputError(f"outputs: got {got}, expected {', '.join(names)}")
                rows.append([found[name] for name in names])
            except Exception as error:  # whatever a user's function raises is a record
                rows.append(None)
                failures.append((index, f"{type(error).__name__}: {error}"))
        width = max((len(row) for row in rows if row is not None), default=1)
        columns = np.array([[np.nan] * width if row is None else row for row in rows])
        return Block(columns, tuple(failures))

    def _call(self, values: Values, rng: np.random.Generator) -> dict[str, float]:
        found = self.function(rng, **values)
        if not isinstance(found, Mapping):
            found = {self.name: found}
        return {_text(name): _number(name, value) for name, value in found.items()}


def _text(name: Any) -> str:
    if not isinstance(name, str) or not name:
        raise InputError(f"name of an output: got {name!r}, expected text")
    return name


def _number(name: Any, value: Any) -> float:
    array = np.asarray(value)
    if array.ndim != 0 or array.dtype.kind not in "fiub":
        raise InputError(f"output {name}: got {value!r}, expected a number")
    return float(array)


def _spelled(code: CodeType) -> str:
    def spelled(value: Any) -> str:
        if isinstance(value, CodeType):
            return _spelled(value)
        # The order of a set is another one in each process.
        return repr(sorted(map(repr, value)) if isinstance(value, frozenset) else value)

    constants = [spelled(value) for value in code.co_consts]
    return repr((code.co_code, code.co_names, code.co_varnames, constants))


STUDIES: dict[str, tuple[str, str]] = {
    "calibration": ("trunnion.studies.calibration", "CalibrationStudy"),
    "compensation": ("trunnion.studies.compensation", "CompensationStudy"),
    "identification": ("trunnion.studies.identification", "IdentificationStudy"),
    "diagnosis-power": ("trunnion.studies.power", "DiagnosisPowerStudy"),
}
"""Built-in studies: name → module and class."""


def study_of(
    study: str | Study | Callable[..., Any],
    units: Mapping[str, str] | None,
    setup: Setup | None = None,
) -> Study:
    """A study from a name, a function or itself; `setup`: what it begins with, where it has one."""
    named("units", units, "a dict of output names")
    if units and isinstance(study, str | Study):
        raise InputError("units: got some for a study that has its own, expected none")
    if isinstance(study, str):
        module, name = STUDIES[choose("study", study, STUDIES)]
        made = getattr(import_module(module), name)
        if setup is None:
            return cast(Study, made())
        if "setup" not in inspect.signature(made).parameters:
            raise InputError(f"setup: got one for study {study}, which varies none; expected none")
        return cast(Study, made(setup=setup))
    if setup is not None:
        raise InputError("setup: got one for a study of your own, expected a built-in study's name")
    if isinstance(study, Study):
        return study
    if callable(study):
        return FunctionStudy(study, dict(units or {}))
    raise InputError(f"study: got {study!r}, expected a name, a function or a Study")


def guarded(count: int, one: Callable[[int], list[float]], width: int) -> Block:
    """Samples one by one; those that raise one of trunnion's errors are recorded."""
    columns = np.full((count, width), np.nan)
    failures: list[tuple[int, str]] = []
    for index in range(count):
        try:
            columns[index] = one(index)
        except TrunnionError as error:
            failures.append((index, f"{type(error).__name__}: {error}"))
    return Block(columns, tuple(failures))

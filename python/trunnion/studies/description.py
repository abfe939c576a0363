"""What makes a sweep this sweep, in memory and as the JSON that its files hold."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trunnion._core import __version__
from trunnion.base.checks import instance, shown, whole
from trunnion.base.errors import DataError, InputError, TrunnionError
from trunnion.studies.grid import Grid
from trunnion.studies.study import FunctionStudy, Output, Study

FAILURE = ("failure_sample", "failure_parameters", "failure_error")
"""Variables of a result that list its failed samples."""


class AnotherSweepError(DataError):
    """A file holds another sweep than the one that is to go on in it, or none."""


@dataclass(frozen=True)
class Description:
    """A sweep but for its numbers: two with the same description have the same numbers.

    study: Name of the study.
    grid: Axes, and the parameters that stay the same.
    grid_units: Units of the axes.
    samples, seed: Draws at each node, and what they are drawn from.
    outputs: In the order of the columns.
    code: Digest of a user's function; None for the other studies.
    version: Of trunnion.
    """

    study: str
    grid: Grid
    grid_units: Mapping[str, str]
    samples: int
    seed: int
    outputs: tuple[Output, ...]
    code: str | None = None
    version: str = __version__

    @classmethod
    def of(
        cls, study: Study, grid: Grid, samples: int, seed: int, outputs: tuple[Output, ...]
    ) -> Description:
        """Of a sweep that is to run."""
        known = study.parameters
        units = {name: known[name].unit for name in grid.axes if name in known}
        code = study.code() if isinstance(study, FunctionStudy) else None
        return cls(study.name, grid, units, samples, seed, outputs, code)

    @property
    def width(self) -> int:
        """Numbers a sample."""
        return sum(output.width for output in self.outputs)

    @property
    def bytes(self) -> int:
        """Size of its numbers."""
        return 8 * self.grid.nodes * self.samples * self.width

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "study": self.study,
            "grid": {name: list(values) for name, values in self.grid.axes.items()},
            "grid_units": dict(self.grid_units),
            "fixed": dict(self.grid.fixed),
            "samples": self.samples,
            "seed": self.seed,
            **({} if self.code is None else {"code": self.code}),
            "outputs": [
                [output.name, output.unit, output.dim, list(output.labels), output.label]
                for output in self.outputs
            ],
            "trunnion": self.version,
        }

    def text(self) -> str:
        """As JSON."""
        return json.dumps(self.to_dict(), sort_keys=True)

    @classmethod
    def read(cls, path: Path, text: object) -> Description:
        """From the JSON in a file of a sweep.

        Raises DataError: it is not what `text` writes; the message names file and entry.
        """
        try:
            return _parsed(text)
        except (TrunnionError, TypeError, ValueError, RecursionError) as error:
            why = str(error) if isinstance(error, TrunnionError) else "got text that is no JSON"
            raise DataError(
                f"{path}: damaged, or not of a sweep: {why}; expected what a sweep has written"
            ) from None

    def check_same(self, path: Path, found: Description) -> None:
        """Refuse to go on with the file of another sweep.

        Raises AnotherSweepError: `found`, which `path` holds, is not this sweep; it says in what.
        """
        # Through JSON, as `found` came: tuples become lists, and so on.
        here: dict[str, Any] = json.loads(self.text())
        there = json.loads(found.text())
        for key in self.to_dict():
            if key == "code" and key in there and there[key] != here[key]:
                raise AnotherSweepError(
                    f"{path}: holds another sweep: the code of {self.study} was another; expected "
                    "the same function to go on with, or another file"
                )
            if there.get(key) != here[key]:
                raise AnotherSweepError(
                    f"{path}: holds another sweep: {key} is {there.get(key)!r} there, "
                    f"{here[key]!r} here; expected the same sweep to go on with, or another file"
                )


def check_names(study: str, outputs: Sequence[Output], axes: Mapping[str, object]) -> None:
    """Refuse outputs and axes that the result cannot hold beside each other.

    Raises InputError: a name that is taken, or a dimension with different labels.
    """
    if not outputs:
        raise InputError(f"study {study}: got no outputs, expected at least one")
    taken = {*axes, *FAILURE, "sample", "failure"}
    taken |= {output.dim for output in outputs} | {f"{output.dim}_unit" for output in outputs}
    labels: dict[str, tuple[str, ...]] = {}
    for output in outputs:
        if output.name in taken:
            raise InputError(
                f"study {study}: got an output named {output.name!r} as a parameter or a "
                "dimension is, expected another name"
            )
        taken.add(output.name)
        if output.dim in (*axes, *FAILURE, "sample", "failure"):
            raise InputError(f"axis {output.dim}: the name is taken, expected another")
        if labels.setdefault(output.dim, output.labels) != output.labels:
            raise InputError(
                f"output {output.name}: got {len(output.labels)} labels along {output.dim!r}, "
                "expected those of the other outputs along it"
            )


def _parsed(text: object) -> Description:
    if not isinstance(text, str):
        raise InputError("got no description")
    table = _table("description", json.loads(text))
    outputs = tuple(
        _output(f"outputs {place}", entry)
        for place, entry in enumerate(_items("outputs", table.get("outputs")))
    )
    grid = Grid.restored(_table("grid", table.get("grid")), _table("fixed", table.get("fixed")))
    samples = whole("samples", table.get("samples"), 1)
    found = Description(
        study=_text("study", table.get("study")),
        grid=grid,
        grid_units={
            name: _text(f"grid_units {name}", unit)
            for name, unit in _table("grid_units", table.get("grid_units")).items()
        },
        samples=samples,
        seed=whole("seed", table.get("seed"), 0),
        outputs=outputs,
        code=None if "code" not in table else _text("code", table["code"]),
        version=_text("trunnion", table.get("trunnion")),
    )
    check_names(found.study, outputs, grid.axes)
    grid.check_size(samples, found.width)
    return found


def _output(what: str, entry: object) -> Output:
    items = _items(what, entry)
    if len(items) != 5:
        raise InputError(
            f"{what}: got {len(items)} entries, expected name, unit, dim, labels, label"
        )
    name, unit, dim, labels, label = items
    named = tuple(_text(f"{what} labels", entry) for entry in _items(f"{what} labels", labels))
    if bool(named) != bool(dim) or len(set(named)) != len(named):
        raise InputError(f"{what}: got labels {shown(labels)} along {shown(dim)}")
    units: str | tuple[str, ...]
    if isinstance(unit, str):
        units = unit
    else:
        units = tuple(_text(f"{what} unit", entry) for entry in _items(f"{what} unit", unit))
        if len(units) != len(named):
            raise InputError(f"{what}: got {len(units)} units, expected one for each label")
    return Output(
        _text(f"{what} name", name),
        units,
        _text(f"{what} dim", dim),
        named,
        _text(f"{what} label", label),
    )


def _text(what: str, value: object) -> str:
    return instance(what, value, str, "text")


def _items(what: str, value: object) -> list[Any]:
    return instance(what, value, list, "a list")


def _table(what: str, value: object) -> dict[str, Any]:
    return instance(what, value, dict, "a table")

"""The result of a sweep: arrays with names, in memory and as a netCDF file."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trunnion.base.arguments import checked
from trunnion.base.checks import optional_module
from trunnion.base.errors import DataError
from trunnion.base.input import path_of
from trunnion.base.output import check_new, whole_file
from trunnion.studies.description import AnotherSweepError, Description
from trunnion.studies.store import Blocks, Journal
from trunnion.studies.study import Value

if TYPE_CHECKING:
    import xarray as xr


def import_xarray() -> Any:
    """xarray, which holds the results.

    Raises ImportError: it is not installed.
    """
    return optional_module("xarray", "sweeps", "sweep")


def target_of(path: Any) -> Path:
    """Where the result goes; a file that may be, in a folder that is there.

    Raises InputError: no path, a folder, or a path in a folder that is not there.
    """
    target = path_of(path)
    check_new(target, overwrite=True)
    return target


def journal_of(target: Path) -> Journal:
    """The blocks beside a result that is not complete yet."""
    return Journal(target.with_name(target.name + ".part"))


@checked
def open_sweep(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a sweep from its file, finished or still running; samples not done yet are missing.

    Raises
    ------
    DataError
        There is neither `path` nor `path.part`, or it is none of a sweep.

    Examples
    --------
    >>> import trunnion as tn
    >>> found = tn.sweep("calibration", samples=10, seed=1, path="noise.nc", progress=False)
    >>> dict(tn.open_sweep("noise.nc").sizes)["sample"]
    10
    """
    import_xarray()
    target = target_of(path)
    if target.exists():
        return _read(target)[0]
    journal = journal_of(target)
    if not journal.path.exists():
        raise DataError(f"{target}: no such sweep, finished or running")
    description = journal.description()
    blocks = Blocks(description.grid.nodes, description.samples, description.width)
    journal.restore(blocks)
    return dataset(description, blocks)


def read_same(target: Path, description: Description) -> xr.Dataset:
    """Read a finished sweep.

    Raises AnotherSweepError: the file is damaged, holds another sweep, or is none of a sweep.
    """
    try:
        found, there = _read(target)
    except DataError as error:
        raise AnotherSweepError(str(error)) from None
    description.check_same(target, there)
    return found


def write(result: xr.Dataset, target: Path) -> None:
    """The whole file or none, on the disk before what it was made from goes."""
    with whole_file(target) as draft:
        result.to_netcdf(draft, engine="scipy")


def dataset(description: Description, blocks: Blocks) -> xr.Dataset:
    """Arrays with names: grid axes, sample, and the outputs' own dimensions."""
    grid = description.grid
    variables, coordinates = _variables(description, blocks)
    failures = sorted(blocks.failures.items())
    if failures:
        parameters = [
            json.dumps({name: grid.at(node)[name] for name in grid.axes})
            for (node, _), _ in failures
        ]
        variables["failure_sample"] = ("failure", [sample for (_, sample), _ in failures])
        variables["failure_parameters"] = ("failure", parameters)
        variables["failure_error"] = ("failure", [why for _, why in failures])
    attributes: dict[str, Any] = {
        **{name: _attribute(value) for name, value in grid.fixed.items()},
        "study": description.study,
        "seed": _attribute(description.seed),
        "samples_done": int(blocks.done.sum()),
        "samples_failed": len(failures),
        "trunnion": description.version,
        "described": description.text(),
    }
    found: xr.Dataset = import_xarray().Dataset(variables, coordinates, attributes)
    return found


def _variables(description: Description, blocks: Blocks) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables of the outputs, and coordinates."""
    grid = description.grid
    coordinates: dict[str, Any] = {
        name: (name, _storable(values), {"units": description.grid_units.get(name, "")})
        for name, values in grid.axes.items()
    }
    variables: dict[str, Any] = {}
    column = 0
    for output in description.outputs:
        dims: tuple[str, ...] = (*grid.axes, "sample")
        shape = (*grid.shape, description.samples)
        taken = blocks.columns[:, :, column : column + output.width]
        column += output.width
        attributes = {"long_name": output.label} if output.label else {}
        if output.dim:
            dims, shape = (*dims, output.dim), (*shape, output.width)
            coordinates[output.dim] = (output.dim, list(output.labels))
            if isinstance(output.unit, tuple):
                coordinates[f"{output.dim}_unit"] = (output.dim, list(output.unit))
        if isinstance(output.unit, str):
            attributes["units"] = output.unit
        variables[output.name] = (dims, taken.reshape(shape), attributes)
    return variables, coordinates


def _read(target: Path) -> tuple[xr.Dataset, Description]:
    """The result in a netCDF file, and what it is of."""
    try:
        found: xr.Dataset = import_xarray().load_dataset(target, engine="scipy")
    except Exception as error:  # a damaged file may lead the reader anywhere
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(f"{target}: {why}; expected the file (netCDF) of a sweep") from None
    if "described" not in found.attrs:
        raise DataError(f"{target}: holds no sweep; expected the file of one, or another file")
    return found, Description.read(target, found.attrs["described"])


def _attribute(value: Value) -> Value:
    """The classic netCDF format has no truth values, and no whole numbers beyond 32 bits."""
    if isinstance(value, bool):
        return int(value)
    return str(value) if isinstance(value, int) and abs(value) >= 2**31 else value


def _storable(values: tuple[Value, ...]) -> list[Value]:
    integers = all(type(value) is int for value in values)
    if integers and any(abs(int(value)) >= 2**31 for value in values):
        return [float(value) for value in values]
    return list(values)

"""Measured data of others, of machines whose owners knew the answer: `names`, `about`, `load`.

The files are not part of the package, but for two with an open licence. They are looked for in a
folder (an argument, or the environment variable ``TRUNNION_DATA``), then among the shipped ones;
with ``download=True`` those that are published as they are come from their public address (pooch,
``pip install 'trunnion[datasets]'``), held to a checksum.
"""

from __future__ import annotations

import os
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, optional_module
from trunnion.base.errors import InputError
from trunnion.base.input import path_of
from trunnion.datasets.catalogue import DATASETS, GITHUB, READERS
from trunnion.datasets.catalogue import Dataset as Dataset

__all__ = ["Dataset", "about", "load", "names"]


def names() -> tuple[str, ...]:
    """Return the names of all sets."""
    return tuple(DATASETS)


@checked
def about(name: str) -> Dataset:
    """Return what a set is: description, source, licence, what its owner knew.

    Raises
    ------
    UnknownNameError
        No set of this name.
    """
    return DATASETS[choose("dataset", name, DATASETS)]


@checked
def load(name: str, folder: str | PathLike[str] | None = None, *, download: bool = False) -> Any:
    """Return the measured data of a set.

    Parameters
    ----------
    name
        One of `names`.
    folder
        Where the files are; ``TRUNNION_DATA`` by default.
    download
        Take what is in no folder from its public address.

    Raises
    ------
    UnknownNameError
        No set of this name.
    InputError
        A file is not there; the message says where it can be had.
    """
    found = about(name)
    return READERS[found.reader](*(_path(found, file, folder, download) for file in found.files))


def _path(found: Dataset, file: str, folder: str | PathLike[str] | None, download: bool) -> Path:
    """Return where a file of a set is."""
    given = folder if folder is not None else os.environ.get("TRUNNION_DATA")
    if given is not None:
        path_of(given, "folder", "the path of a folder")
    shipped = Path(str(files(__name__))) / "files" / Path(file).name
    for path in ([] if given is None else [Path(given) / file]) + [shipped]:
        if path.is_file():
            return path
    public = found.public.get(file)
    if download and public is not None:
        pooch = optional_module("pooch", "downloads of measured data", "datasets")
        url = f"{GITHUB}/{found.repository}/{found.commit}/{public[0]}"
        return Path(pooch.retrieve(url, known_hash=f"sha256:{public[1]}", progressbar=False))
    why = (
        "download=True takes it from its public address"
        if public is not None
        else f"it is published in another form only: {found.source}"
    )
    raise InputError(
        f"dataset {found.name!r}: got no file {file} in {given or 'TRUNNION_DATA (not set)'}, "
        f"expected it there ({why})"
    )

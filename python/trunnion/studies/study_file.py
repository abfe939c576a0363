"""A study as a TOML file: what ``trunnion sweep`` runs.

::

    study = "calibration"     # a built-in study
    samples = 1000            # random draws at each node of the grid, 1 if absent
    seed = 1                  # 0 if absent
    setup = "setup.toml"      # what a study that varies a set-up begins with, beside this file
    [grid]                    # every combination is a node
    noise_um = [0.1, 0.3, 1.0]
    [fixed]                   # the others keep their defaults
    length_mm = 150.0
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trunnion.base.errors import TrunnionError, UnknownNameError
from trunnion.files.toml import TomlText
from trunnion.setup import read_setup
from trunnion.studies.run import sweep
from trunnion.studies.study import STUDIES

if TYPE_CHECKING:
    import xarray as xr

KEYS = ("study", "samples", "seed", "setup", "grid", "fixed")


def sweep_file(study: str | PathLike[str], **how: Any) -> xr.Dataset:
    """Run the study in a file, or go on with it; keywords as in :func:`trunnion.sweep`.

    Raises FileFormatError: the file is not TOML, or has a key or value that the study does not
        take; with its place.
    Raises TrunnionError: as :func:`trunnion.sweep`.
    """
    file = TomlText.read(study)
    for key in file.tables:
        if key not in KEYS:
            what = f"got key {key!r}, expected some of {', '.join(KEYS)}"
            raise file.error((key,), what, at_value=False)
    if not isinstance(file.tables.get("study"), str):
        what = f"study: got {file.written(('study',))}, expected one of {', '.join(STUDIES)}"
        raise file.error(("study",), what, at_value=True)
    described: dict[str, Any] = dict(file.tables)
    if "setup" in described:
        if not isinstance(described["setup"], str):
            what = f"setup: got {file.written(('setup',))}, expected the path of a set-up (TOML)"
            raise file.error(("setup",), what, at_value=True)
        described["setup"] = read_setup(Path(study).parent / described["setup"])
    try:
        return sweep(described.pop("study"), described.pop("grid", {}), **described, **how)
    except TrunnionError as error:
        if not error.entry:  # not about the file: about where the result goes, say
            raise
        key_alone = isinstance(error, UnknownNameError) and error.entry != ("study",)
        raise file.error(error.entry, str(error), at_value=not key_alone) from None

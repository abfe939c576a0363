"""Passes of turned diameters: their labels, their readings in order, and what these have to be."""

from typing import Any

import numpy as np
import numpy.typing as npt

from trunnion.base.errors import DataError
from trunnion.base.units import Integers
from trunnion.data.diameters import Diameters

# More is likely a typo: a diameter itself, or another unit.
MAX_ERROR_UM = 5000.0

MIN_READINGS = 4  # in a pass


def labels_of(values: npt.NDArray[Any] | None, count: int) -> npt.NDArray[np.str_]:
    """Labels of readings, all of one where none are given."""
    return np.full(count, "1") if values is None else np.asarray(values).astype(str)


def in_order(labels: npt.NDArray[np.str_]) -> tuple[str, ...]:
    """Labels that there are, as they come."""
    return tuple(dict.fromkeys(labels.tolist()))


def along_passes(data: Diameters) -> list[Integers]:
    """Row numbers of each pass in order along the part."""
    z = np.asarray(data.z_mm, dtype=np.float64)
    labels = labels_of(data.pass_, len(z))
    rows = (np.flatnonzero(labels == label) for label in in_order(labels))
    return [one[np.argsort(z[one], kind="stable")] for one in rows]


def check_passes(data: Diameters, overhang: float) -> None:
    """Check places, sizes of errors and numbers of readings; ``overhang``: mm.

    Raises DataError.
    """
    z = np.asarray(data.z_mm, dtype=np.float64)
    if (z > overhang + 1e-6).any():
        row = int(np.argmax(z))
        raise DataError(
            f"z_mm ({data.place(row)}): got {z[row]}, expected at most the overhang, {overhang} mm"
        )
    if (z < -1e-6).any():
        row = int(np.argmin(z))
        raise DataError(
            f"z_mm ({data.place(row)}): got {z[row]}, expected 0 (the chuck's face) or more: does "
            "it count from the chuck outward?"
        )
    error = np.asarray(data.error_um, dtype=np.float64)
    if (np.abs(error) > MAX_ERROR_UM).any():
        row = int(np.argmax(np.abs(error)))
        raise DataError(
            f"error_um ({data.place(row)}): got {error[row]}, expected measured minus nominal "
            f"diameter, µm, within ±{MAX_ERROR_UM:g}"
        )
    labels = labels_of(data.pass_, len(data))
    for label, count in zip(*np.unique(labels, return_counts=True), strict=True):
        if count < MIN_READINGS:
            raise DataError(f"pass {label}: got {count} readings, expected at least {MIN_READINGS}")

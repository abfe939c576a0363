"""What is given to a diagnosis: one measurement, or a list of them, and what is neither."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any

from trunnion.base.errors import DataError, InputError
from trunnion.data.frame import OF_THE_MACHINE, listed
from trunnion.data.touches import Touches
from trunnion.files.table import Table


def refuse_mapping_of_data(data: Any) -> None:
    """Refuse a mapping of measurements by name, whose values are no columns."""
    if not isinstance(data, Mapping):
        return
    given = {key: type(one).__name__ for key, one in data.items() if _is_measured(one)}
    if given:
        said = ", ".join(f"{key!r}: {kind}" for key, kind in given.items())
        raise InputError(
            f"data: got a mapping of measurements ({said}), expected columns by name, or a list of "
            "the measurements in the order of time: list(data.values())"
        )


def _is_measured(value: Any) -> bool:
    """Whether a value of a mapping is a measurement, which no column is."""
    return isinstance(value, Table | Mapping) or type(value).__name__ in ("DataFrame", "Dataset")


def check_list(data: Sequence[Any], no_data: Callable[[str, Any], str]) -> None:
    """Refuse what is no data, lists within the list among it, and a list of less than two.

    no_data: What is said of a thing of this name that is no kind of data.
    """
    for i, one in enumerate(data):
        if isinstance(one, list | tuple):
            raise InputError(
                f"data[{i}]: got a {type(one).__name__} of {len(one)}, expected a measurement or a "
                "diagnosis model: give all of them in one list"
            )
        if isinstance(one, str | PathLike):
            raise InputError(
                f"data[{i}]: got the path {str(one)!r}, expected measured data: "
                f"trunnion.read({str(one)!r}) reads the file (diagnose_many takes paths, of "
                "measurements each by itself)"
            )
        if one is None or isinstance(one, int | float):
            raise InputError(no_data(f"data[{i}]", one))
    if len(data) < 2:
        raise InputError(f"data: got {len(data)} measurements in a list, expected at least two")


def refuse_other_frames(data: Sequence[Any]) -> None:
    """Refuse touches in other frames of the control than the first: they share location errors."""
    frames = [(i, one.control_frame) for i, one in enumerate(data) if isinstance(one, Touches)]
    known = [(i, frame) for i, frame in frames if frame is not None]
    for i, frame in known[1:]:
        if found := known[0][1].differences(frame, OF_THE_MACHINE):
            got = f"{{name}}: got {{after}} in measurement {i + 1}, expected {{before}} as in "
            raise DataError(
                f"{listed(found, f'{got}measurement {known[0][0] + 1}')}: location errors are "
                "about the axes of the work offset, and those that corrections leave are others. "
                "Diagnose each by itself; trunnion.compare says what changed"
            )

"""Touches as the table sees them: what a control with tool centre point control on logs."""

from __future__ import annotations

from os import PathLike

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.units import Floats
from trunnion.data.linuxcnc_log import logged_hashes, plan_hash, read_probe_log
from trunnion.data.touches import Touches
from trunnion.probing.steps import table_pose
from trunnion.setup import Setup


def on_table(touches: Touches, setup: Setup) -> Touches:
    """Positions, directions and starts in the frame of the table of the nominal machine."""
    turn, shift = table_pose(touches, setup)
    starts = touches.start_mm
    places = {"": touches.position_mm - shift, "dir_": touches.direction}
    if starts is not None:
        places["start_"] = starts - shift
    return _with(touches, {name: _turned(turn.swapaxes(1, 2), v) for name, v in places.items()})


def is_table_log(path: str | PathLike[str], plan: Touches, setup: Setup) -> bool:
    """Whether the last run of this plan in a log is with tool centre point control on."""
    with_tcp = plan_hash(on_table(plan, setup))
    found = [one for one in logged_hashes(path) if one in {with_tcp, plan_hash(plan)}]
    return found[-1:] == [with_tcp]


@checked
def read_table_log(path: str | PathLike[str], plan: Touches, setup: Setup) -> Touches:
    """Read the log of a program with tool centre point control on.

    Parameters
    ----------
    path
        Log of a program of :func:`probing_program` with ``tcp=True``: X Y Z on the table, mm.
    plan, setup
        The plan that the program came from, and its set-up.

    Returns
    -------
    Touches
        In the machine frame of the machine that the control reckons with, as
        :func:`read_probe_log` returns those of a corrected machine.

    Raises
    ------
    FileFormatError
        As of :func:`read_probe_log`.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(30.0, 0.0, 60.0)),
    ...                  control=tn.ControlSetup(tcp_off="M429"))
    >>> plan = tn.plan(setup)
    >>> head = tn.probing_program(plan, setup, tcp=True).text().splitlines()[0]
    >>> head.split("hash ")[1].rstrip(")") != tn.probing_program(plan, setup).plan_hash
    True
    """
    measured = read_probe_log(path, on_table(plan, setup), setup)
    turn, shift = table_pose(measured, setup)
    places = {"": _turned(turn, measured.position_mm) + shift}
    places["dir_"] = _turned(turn, measured.direction)
    if measured.start_mm is not None:
        places["start_"] = _turned(turn, measured.start_mm) + shift
    return _with(measured, places)


def _turned(turn: Floats, vectors: Floats) -> Floats:
    return np.asarray(np.einsum("nij,nj->ni", turn, vectors))


def _with(touches: Touches, places: dict[str, Floats]) -> Touches:
    columns = {
        # What is rounded away is no number of a plan, but would be one of its hash.
        f"{name}{axis}" + ("" if name == "dir_" else "_mm"): np.round(values[:, i], 9) + 0.0
        for name, values in places.items()
        for i, axis in enumerate("xyz")
    }
    return touches.with_columns(**columns)

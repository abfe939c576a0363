"""The frame that a control had while it measured: work offset, tool length, corrections.

A probing program logs it (:mod:`trunnion.data.linuxcnc_runs`), touches keep it in columns, an
estimate carries it, and a compensation, which turns by the joints about `control.centre_mm`,
refuses one that does not fit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from trunnion.base.errors import DataError
from trunnion.files.columns import parse_number
from trunnion.setup import Setup

AXES = ("x", "y", "z")
ROTARY = ("a", "b", "c")
SAME_FRAME_MM = 1e-4  # far less than a touch repeats to
SAME_PLACE_MM = 1e-3
SAME_ANGLE_DEG = 1e-3
Frame: TypeAlias = Literal["machine", "corrected", "table"]
"""What X Y Z of approaches are: the linear axes', these with corrections, the table's (TCP)."""
MODES: tuple[Frame, ...] = ("machine", "corrected", "table")
"""Frames as a log calls them, by the number that a program's parameters hold."""
COLUMNS = (
    *(f"wcs_{axis}_mm" for axis in AXES), *(f"wcs_{axis}_deg" for axis in ROTARY),
    "tool_length_mm", "control_corrected",
)  # fmt: skip
"""Columns of touches that hold it, alike in every row."""
OF_THE_MACHINE = tuple(name for name in COLUMNS if name != "tool_length_mm")
"""Those that location errors depend on: the tool length is taken off."""
CHANGED = (
    (
        tuple(name for name in COLUMNS if name.startswith("wcs_")),
        "location errors are about the axes of the work offset, and change with it",
    ),
    (
        ("tool_length_mm",),
        "positions are those of a tip at that length, and where one of the two is wrong, location "
        "errors along the tool change by as much",
    ),
    (("control_corrected",), "changes are those that the control's corrections make"),
)
"""Columns, and what another value of theirs does to errors."""
GOT_EXPECTED = "{name}: got {after}, expected {before}"


class Difference(NamedTuple):
    """A part of a frame that a later one has otherwise: column or word of a log, both values."""

    name: str
    before: float | str
    after: float | str


def differences(
    before: Mapping[str, float] | Mapping[str, str], after: Mapping[str, float] | Mapping[str, str]
) -> list[Difference]:
    """Return all parts in which two frames differ, numbers by more than `SAME_FRAME_MM`.

    What one of them does not say does not differ.
    """
    return [
        Difference(name, was, after[name])
        for name, was in before.items()
        if name in after and not _alike(was, after[name])
    ]


def _alike(one: float | str, other: float | str) -> bool:
    a, b = (parse_number(x) if isinstance(x, str) else x for x in (one, other))
    return one == other if a is None or b is None else abs(a - b) <= SAME_FRAME_MM


def listed(found: Sequence[Difference], first: str, more: str = GOT_EXPECTED) -> str:
    """Say all differences, the first in other words than those behind it.

    first, more: With the names of the fields in braces.
    """
    words = (first, *[more] * (len(found) - 1))
    shown = ((x if isinstance(x, str) else f"{x:.10g}" for x in one) for one in found)
    return "; ".join(
        text.format(name=name, before=before, after=after)
        for text, (name, before, after) in zip(words, shown, strict=True)
    )


@dataclass(frozen=True)
class ControlFrame:
    """Frame of a measurement, as far as the control says it.

    Attributes
    ----------
    place_mm
        Origin of the work offset in machine coordinates; None: not said.
    turned_deg
        How far the work offset shifts each rotary axis, by letter.
    tool_length_mm
        Tool length in force; None: not said.
    corrected
        Whether the control's corrections were on; None: not said.

    Examples
    --------
    >>> import trunnion as tn
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> touches.with_columns(control_corrected=[1] * len(touches)).control_frame.corrected
    True
    """

    place_mm: tuple[float, float, float] | None = None
    turned_deg: dict[str, float] = field(default_factory=dict)
    tool_length_mm: float | None = None
    corrected: bool | None = None

    @classmethod
    def of_words(cls, words: Mapping[str, str]) -> ControlFrame:
        """Return the frame that a run of a log says, by the names there."""
        at = {name: parse_number(word) for name, word in words.items()}
        known = {name: value for name, value in at.items() if value is not None}
        place = tuple(known[axis] for axis in AXES if axis in known)
        return cls(
            place_mm=(place[0], place[1], place[2]) if len(place) == len(AXES) else None,
            turned_deg={axis.upper(): known[axis] for axis in ROTARY if axis in known},
            tool_length_mm=known.get("length"),
            corrected=words["mode"] != MODES[0] if "mode" in words else None,
        )

    @classmethod
    def of_columns(cls, columns: Mapping[str, Any]) -> ControlFrame | None:
        """Return the frame that touches have in their first row; None without its columns."""
        there = {name: columns[name][0].item() for name in COLUMNS if name in columns}
        if not there:
            return None
        place = tuple(there[f"wcs_{x}_mm"] for x in AXES if f"wcs_{x}_mm" in there)
        turned = {x.upper(): there.get(f"wcs_{x}_deg") for x in ROTARY}
        on = there.get("control_corrected")
        return cls(
            place_mm=(place[0], place[1], place[2]) if len(place) == len(AXES) else None,
            turned_deg={x: at for x, at in turned.items() if at is not None},
            tool_length_mm=there.get("tool_length_mm"),
            corrected=None if on is None else bool(on),
        )

    def columns(self, count: int) -> dict[str, Any]:
        """Return it as columns of so many touches."""
        values: dict[str, float] = {}
        if self.place_mm is not None:
            values |= {f"wcs_{x}_mm": at for x, at in zip(AXES, self.place_mm, strict=True)}
        values |= {f"wcs_{x.lower()}_deg": at for x, at in self.turned_deg.items()}
        if self.tool_length_mm is not None:
            values["tool_length_mm"] = self.tool_length_mm
        if self.corrected is not None:
            values["control_corrected"] = int(self.corrected)
        return {name: np.full(count, value) for name, value in values.items()}

    def hindrances(
        self,
        centre_mm: Sequence[float] | None,
        wcs: str = "the work offset",
        stated_as: str = "control.centre_mm",
    ) -> Iterator[str]:
        """Say what keeps what is identified in this frame from being compensated.

        A compensation in the control turns by its joints about `centre_mm`, and takes errors as
        those of the machine without corrections. ``centre_mm``: None, it is not stated.
        """
        if centre_mm is not None and self.place_mm is not None:
            off = float(np.linalg.norm(np.subtract(self.place_mm, centre_mm)))
            if off > SAME_PLACE_MM:
                found = ", ".join(f"{v:.10g}" for v in self.place_mm)
                stated = ", ".join(f"{v:.10g}" for v in centre_mm)
                yield (
                    f"{wcs} was at {found}, {off:.3g} mm from {stated_as} = "
                    f"[{stated}]. Location errors are about the axes of that work offset: state "
                    f"centre_mm = [{found}] before a compensation, which would turn about axes "
                    "that far off."
                )
        for axis, turned in self.turned_deg.items():
            if abs(turned) > SAME_ANGLE_DEG:
                yield (
                    f"{wcs} shifts {axis} by {turned:.6g} deg. Angles are "
                    "those of that work offset, a compensation turns by those of the joint: before "
                    "one, move the zero of the joint (HOME_OFFSET) by as much, and measure again."
                )
        if self.corrected:
            yield (
                "the control's corrections were on while it measured, so that the errors found are "
                "those that the corrections leave. trunnion verify and trunnion compare judge the "
                "corrections by such touches. A compensation takes the errors of the machine "
                "itself: for one, measure without corrections (trunnion program without "
                "--corrected and --tcp)."
            )

    def refuse_to_compensate(self, setup: Setup) -> None:
        """Refuse a compensation with this set-up by what was identified in this frame.

        Raises
        ------
        DataError
            Corrections were on, the work offset shifts a rotary axis, or it was not at
            `control.centre_mm`.
        """
        stated = f"control.centre_mm{f' of {setup.source}' if setup.source else ''}"
        if found := list(self.hindrances(setup.control.centre_mm, stated_as=stated)):
            said = " Also: ".join(found)
            raise DataError(f"errors of a frame that does not fit the set-up: {said[:-1]}")

    def beside(self, other: ControlFrame) -> ControlFrame:
        """Return what this frame says, with what only the other one says."""
        return ControlFrame(
            self.place_mm or other.place_mm,
            other.turned_deg | self.turned_deg,
            other.tool_length_mm if self.tool_length_mm is None else self.tool_length_mm,
            other.corrected if self.corrected is None else self.corrected,
        )

    def differences(
        self, later: ControlFrame, columns: Collection[str] = COLUMNS
    ) -> list[Difference]:
        """Return all columns, of some, in which a later frame differs, with both values."""
        mine, theirs = (
            {name: float(values[0]) for name, values in frame.columns(1).items() if name in columns}
            for frame in (self, later)
        )
        return differences(mine, theirs)


def frame_changes(
    frames: Sequence[ControlFrame | None], columns: Collection[str] = COLUMNS
) -> Iterator[str]:
    """Say of measurements in which columns, of some, their frame is not that of the first.

    frames: Of each measurement; None: it says none, and the first is the first that says one.
    """
    known = [(number, frame) for number, frame in enumerate(frames, 1) if frame is not None]
    for number, frame in known[1:]:
        at, first = known[0]
        of = "the first measurement" if at == 1 else f"measurement {at}"
        found = first.differences(frame, columns)
        for names, why in CHANGED:
            if some := [one for one in found if one.name in names]:
                said = f"{{name}} was {{before}} with {of}, {{after}} with measurement {number}"
                yield f"{listed(some, said, '{name} was {before}, then {after}')}: {why}."


def taken_as_said(data: Sequence[Any]) -> Iterator[str]:
    """Say what some measurements of one estimate do not say of the frame, and others do.

    data: Of each kind; touches have a frame, or None, the others know none.
    """
    columns = {
        i: {} if one.control_frame is None else one.control_frame.columns(1)
        for i, one in enumerate(data, 1)
        if hasattr(one, "control_frame")
    }
    for i, mine in columns.items():
        said = {name: j for j, own in reversed(columns.items()) for name in own}
        if lacking := [name for name in COLUMNS if name in said and name not in mine]:
            others = " and ".join(str(j) for j in sorted({said[name] for name in lacking}))
            yield (
                f"Measurement {i} does not say {', '.join(lacking)}: the errors are stated with "
                f"what measurement {others} says of the control, and hold if it was the same. If "
                "that is not known, diagnose each by itself."
            )


def frame_notes(data: Any) -> tuple[str, ...]:
    """Say what corrections of the control make of what is identified; most data say none."""
    frame = getattr(data, "control_frame", None)
    if frame is None or not frame.corrected:
        return ()
    return (
        "control_corrected is 1: these touches were made with the control's corrections on. Errors "
        "are what the corrections leave, not those of the machine: trunnion verify judges a "
        "compensation by such touches, and none can be made of them.",
    )

"""Files for a control: what is to be set, old and new, and what that leaves."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from trunnion.base.arguments import checked
from trunnion.base.input import path_of
from trunnion.base.output import check_folder, check_new, whole_file
from trunnion.base.report import SHOWN, Cell, Result, Shown, Table
from trunnion.compensation.forecast import Left, before_and_after
from trunnion.machine.sizes import size_doubt

SETTINGS = "settings.csv"
"""Name of the file with every setting, for people."""


@dataclass(frozen=True, eq=False, repr=False)
class Setting(Result):
    """One number in a control.

    Attributes
    ----------
    name, where, unit
        What it is called there, in which file, and its unit.
    old, new
        Value before (None: not known) and after.
    meaning
        What it stands for.
    sign
        What a positive value means.
    why
        Why it differs from the estimate; empty where it is the estimate.
    holds
        The range it holds for; empty: any position.
    """

    name: str
    where: str
    unit: str
    old: float | None
    new: float
    meaning: str = ""
    sign: str = ""
    why: str = ""
    holds: str = ""

    def sentences(self) -> Sequence[str]:
        """Name, old and new value."""
        old = "not known" if self.old is None else f"{self.old:g}"
        return (f"{self.name} ({self.where}): {old} → {self.new:g} {self.unit}.",)

    def tables(self) -> tuple[Table, ...]:
        """One row."""
        return (_table((self,)),)


@dataclass(frozen=True, eq=False, repr=False)
class ControlFiles(Result):
    """What a control is given.

    Attributes
    ----------
    control
        The control and what of it is used.
    files
        Name → text.
    settings
        Every number, where it goes, old and new.
    before_um, after_um
        Largest volumetric error of the machine as estimated over the work space, without the files
        and with them.
    interval_um
        Interval that holds the largest error after, for the uncertainty of the estimate; None
        where that has no covariance.
    left_out
        What was found and cannot be held by this control, each with the reason.
    notes
        What to do, in order.
    between_nodes
        Table → largest error that its interpolation leaves between nodes, with rounding: µm for
        lengths, arcsec for angles. It comes on top of `after_um`.
    rms_um
        Root mean square of the volumetric error over the solid box and the rotary positions,
        without the files and with them.
    direction_arcsec
        Largest error of the tool direction that stays.
    space
        The work space in words.
    errors, std_errors
        Location errors of the estimate and their standard uncertainties, µm and arcsec.
    """

    control: str
    files: Mapping[str, str]
    settings: tuple[Setting, ...]
    before_um: float
    after_um: float
    interval_um: tuple[float, float] | None = None
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    between_nodes: Mapping[str, float] | None = None
    rms_um: tuple[float, float] = (0.0, 0.0)
    direction_arcsec: float = 0.0
    space: str = ""
    errors: Mapping[str, float] = field(default_factory=dict)
    std_errors: Mapping[str, float] = field(default_factory=dict)

    def left(self) -> tuple[Left, Left]:
        """Return what is there without the files, and what they leave."""
        before = Left("without the files", self.before_um, self.rms_um[0], self.direction_arcsec)
        after = replace(before, name="with the files", max_um=self.after_um, rms_um=self.rms_um[1])
        return before, replace(after, max_interval_um=self.interval_um)

    def sentences(self) -> Sequence[str]:
        """What it leaves, what it cannot hold, what to do."""
        lines = [f"{self.control}. {before_and_after(*self.left(), 'the files')}"]
        lines.append(f"Work space: {self.space}.")
        for name, left in (self.between_nodes or {}).items():
            if left < SHOWN:
                continue
            unit = "µm" if name[0] in "xyz" else "arcsec"
            lines.append(f"Between the nodes of table {name}: up to {left:.2g} {unit} more.")
        lines += [f"Not compensated: {text}." for text in self.left_out]
        lines += filter(None, [size_doubt(self.errors, self.std_errors)])
        return [*lines, *self.notes, f"{SETTINGS} says what each number means, and its sign."]

    def tables(self) -> tuple[Table, ...]:
        """Settings, old and new."""
        return (_table(self.settings),)

    @checked
    def write(self, folder: str | Path, *, overwrite: bool = False) -> tuple[Path, ...]:
        """Write the files into a folder, none over another one unless asked to.

        Raises
        ------
        InputError
            A file of such a name is there, or the folder is none and cannot be made.
        """
        place = path_of(folder, "folder", "the path of a folder")
        check_folder(place)
        place.mkdir(exist_ok=True)
        paths = tuple(place / name for name in self.files)
        for path in paths:
            check_new(path, overwrite=overwrite)
        for path, text in zip(paths, self.files.values(), strict=True):
            with whole_file(path) as draft:
                draft.write_text(text, encoding="utf-8")
        return paths


def settings_text(settings: Sequence[Setting]) -> str:
    """CSV of settings for people and spreadsheets."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = ("name", "where", "old", "new", "unit", "sign", "meaning", "why", "holds")
    writer.writerow(names)
    for one in settings:
        numbers = ("" if one.old is None else f"{one.old:.9f}", f"{one.new:.9f}")
        writer.writerow(
            (one.name, one.where, *numbers, one.unit, one.sign, one.meaning, one.why, one.holds)
        )
    return out.getvalue()


def _table(settings: Sequence[Setting]) -> Table:
    # What each means and its sign are in the file for people: a terminal has no room for them.
    texts = {
        "why not the estimate": [one.why for one in settings],
        "holds for": [one.holds for one in settings],
    }
    used = {name: cells for name, cells in texts.items() if any(cells)}
    rows: list[tuple[Cell, ...]] = []
    for i, one in enumerate(settings):
        places = 4 if one.unit else 7  # a direction has no unit
        old = "" if one.old is None else Shown(one.old, f"{one.old:+.{places}f}")
        new = Shown(one.new, f"{one.new:+.{places}f}")
        rows.append((one.name, one.where, old, new, one.unit, *(c[i] for c in used.values())))
    return Table.of("What to set", ("", "in", "old", "new", "unit", *used), rows)

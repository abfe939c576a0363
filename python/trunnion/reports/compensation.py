"""The report of a compensation: errors measured, where each goes, before and after, what to do."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from trunnion.base.report import Cell, Result, Shown, Table
from trunnion.base.units import unit_of
from trunnion.compensation.forecast import EXACT, MAP, PARAMETERS, CompensationForecast, SignTest
from trunnion.compensation.parameters import MIN_LEFT, CncParameters
from trunnion.controls.files import ControlFiles, Setting
from trunnion.plot.dispatch import pictures
from trunnion.reports.document import Document, Item, Mark, Points, Section
from trunnion.reports.results import Figure, figures_table
from trunnion.reports.source import Source
from trunnion.setup.names import called

ERRORS = "Errors measured"
NOTE_OLD = "Note the old values with the date before anything is changed, and keep them."
TAKEN_UP = (
    "A change that is not the value of its error takes up what it can of the tilts, which no "
    "parameter holds."
)
NAMED = (
    "LinuxCNC, Siemens, Heidenhain, TwinCAT, ISG and Etalon have these parameters under names of "
    "their own: trunnion compensate --control writes them, with the files of that control."
)
VERIFY = (
    "Then touch a ball on the table at many postures, without and with the new values: trunnion "
    "verify compares what is left with what this estimate leaves."
)


def compensation_document(result: Result, source: Source) -> Document:
    """Return the document of a forecast for any control."""
    assert isinstance(result, CompensationForecast)
    set_ = result.parameters
    goes = {name: _goes_to(name, set_) for name in result.errors}
    errors, failed = _errors(result.errors, result.std_errors, source, goes)
    first, space, *_ = result.sentences()
    largest = max(set_.centres_um, key=lambda k: abs(set_.centres_um[k]), default=None)
    todo = [
        NOTE_OLD,
        "Add each change to its old value: new value = old value + change. The machine was "
        "measured with the old values, and the changes are counted from there.",
    ]
    if result.sign_test is not None and largest is not None:
        todo.append(_sign_test(result.sign_test))
    todo += [VERIFY, NAMED]
    to_set: list[Item] = [_to_set(set_), TAKEN_UP] if set_.settings() else []
    top = [*to_set, Points(tuple(todo), "What to do"), errors]
    sections = (
        Section(
            "What can be reached", (Points(_reached(result)), result.tables()[0], *pictures(result))
        ),
        Section("Files written", tuple(_files(result.files))),
        source.section(),
    )
    return Document(
        result.title(),
        source.subtitle(),
        _mark(failed),
        f"{first} {_left(result)} {space}",
        tuple(top),
        sections,
    )


def _left(result: CompensationForecast) -> str:
    """Say what parameters leave, and what does better."""
    after, map_, exact = (result.by_name(name) for name in (PARAMETERS, MAP, EXACT))
    if after is None or not after.max_um:
        return ""
    share = after.max_um / result.left[0].max_um
    said = (
        f"{100 * share:.0f} % of the largest error stays, and the tool direction stays wrong by up "
        f"to {after.direction_arcsec:.3g} arcsec"
    )
    if map_ is None or exact is None or exact.max_interval_um is None:
        return f"{said}."
    most = map_.max_um + exact.max_interval_um[1]
    return (
        f"{said}. An error map in their place leaves {most:.2g} µm or less (95 %), the tool "
        f"direction wrong by up to {map_.direction_arcsec:.3g} arcsec."
    )


def control_document(result: Result, source: Source) -> Document:
    """Return the document of files for one control."""
    assert isinstance(result, ControlFiles)
    places: dict[str, list[str]] = {}
    for one in result.settings:
        for name in result.errors:
            if name.lower() in f"{one.name} {one.meaning}".lower():
                places.setdefault(name, []).append(one.name)
    goes = {name: ", ".join(found) for name, found in places.items()}
    errors, failed = _errors(result.errors, result.std_errors, source, goes)
    first, space, *more = result.sentences()
    notes = [one for one in more if one in result.notes]
    known = [one for one in more if one not in notes]
    known.append(f"The tool direction stays wrong by up to {result.direction_arcsec:.3g} arcsec.")
    todo = Points((NOTE_OLD, *notes, VERIFY), "What to do")
    shown: tuple[Item, ...] = tuple(pictures(result))
    sections = (
        Section("What else is known", (Points(tuple(known)),)),
        Section("Pictures", shown),
        Section("Files written", tuple(_files(_sums(result.files)))),
        source.section(),
    )
    top = (errors, _settings(result.settings), todo)
    title = f"Compensation: {result.control}"
    return Document(title, source.subtitle(), _mark(failed), f"{first} {space}", top, sections)


def _mark(failed: bool) -> Mark:
    return Mark.BAD if failed else Mark.NEUTRAL


def _errors(
    errors: Mapping[str, float],
    std: Mapping[str, float],
    source: Source,
    goes: Mapping[str, str],
) -> tuple[Table, bool]:
    """Errors with U, tolerance and where each goes; whether a tolerance is exceeded."""
    figures = [
        Figure(name, called(name), value, std.get(name), unit_of(name))
        for name, value in errors.items()
    ]
    table, decisions = figures_table(ERRORS, figures, source.tolerance)
    if any(place not in ("", name) for name, place in goes.items()):
        rows = [(*row, goes.get(name, "")) for name, row in zip(errors, table.rows, strict=True)]
        table = Table.of(ERRORS, (*table.columns, "goes to"), rows)
    return table, "fail" in decisions


def _goes_to(name: str, set_: CncParameters) -> str:
    """Say which parameter holds an error, and how much of its effect none holds."""
    left = next((one.share_left for one in set_.removable if one.name == name), 0.0)
    if left > MIN_LEFT:
        return f"none: {100 * left:.0f} % of its effect stays"
    if name in set_.centres_um:
        return f"centre of {name[3:]} along {name[1]}"
    return f"zero of {name[1]}" if name[1] == name[3] and name[1] in set_.zeros_arcsec else ""


def _to_set(set_: CncParameters) -> Table:
    """Parameters with the change, in µm or arcsec and in the control's unit, and its sign."""
    rows: list[tuple[Cell, ...]] = []
    for label, value, unit in set_.settings():
        per, keyed = (3600.0, "°") if unit == "arcsec" else (1000.0, "mm")
        size, text = _signed(value, 2), _signed(value / per, 5, f" {keyed}")
        rows.append((label, "note it", size, unit, text, _positive(label)))
    title = "What is changed in the control: new value = old value + change"
    return Table.of(
        title, ("", "old value", "change", "unit", "change in mm or degrees", "positive"), rows
    )


def _positive(label: str) -> str:
    """Say what a positive change means."""
    if label.startswith("zero of "):
        return "the control sends the axis further in +"
    axis = label.partition(" along ")[2][:1]
    return f"the control takes it further in +{axis} (machine)" if axis else ""


def _sign_test(test: SignTest) -> str:
    """Say what shows whether a control takes the values with their sign."""
    first, second = (
        ", ".join(f"{k} {v:g}°" for k, v in posture.items()).replace("-", "−")
        for posture in test.postures
    )
    x, y, z = test.place_mm
    return (
        "Test the signs before a part is made: with tool centre point control on, measure the "
        f"centre of a ball on the table near X {x:g}, Y {y:g}, Z {z:g} mm at {first} and at "
        f"{second}. Both places lie {test.before_um:.1f} µm apart now, {test.after_um:.1f} µm with "
        f"the new values; {test.opposite_um:.1f} µm mean that the control takes the opposite signs."
    )


def _reached(result: CompensationForecast) -> tuple[str, ...]:
    """Say what else than parameters there is, and what it leaves."""
    said = [one for one in result.sentences() if one.startswith("An error map")]
    names = [name for name in result.files if name.endswith("error_map.csv")]
    if said and names:
        said.append(
            f"The map is in {names[0]}, for a control that takes a table of X, Y, Z corrections. "
            "Use the map or the parameters, never both: with the map the parameters keep their old "
            "values. A kinematics component that knows the errors leaves as much (trunnion "
            "compensate --control linuxcnc)."
        )
    exact = result.by_name(EXACT)
    if exact is not None and exact.max_interval_um is not None:
        low, high = exact.max_interval_um
        said.append(
            "The errors are known with an uncertainty: for it alone, the best that X, Y and Z can "
            f"do leaves {low:.2g} to {high:.2g} µm at most (95 %), an error map no less."
        )
    return tuple(said)


def _settings(settings: tuple[Setting, ...]) -> Table:
    """Every number with what it means and its sign."""
    rows: list[tuple[Cell, ...]] = []
    for one in settings:
        digits = 4 if one.unit else 7
        old = "note it" if one.old is None else _signed(one.old, digits)
        new = _signed(one.new, digits)
        why = "; ".join(filter(None, (one.meaning, one.why, one.holds)))
        rows.append((one.name, one.where, old, new, one.unit, one.sign, why))
    heads = ("", "in", "old value", "new value", "unit", "positive", "what it is")
    return Table.of("What is set: the new value takes the place of the old one", heads, rows)


def _signed(value: float, digits: int, unit: str = "") -> Shown:
    return Shown(value, f"{value:+.{digits}f}{unit}".replace("-", "−"))


def _sums(files: Mapping[str, str]) -> dict[str, str]:
    return {name: hashlib.sha256(text.encode()).hexdigest() for name, text in files.items()}


def _files(files: Mapping[str, str]) -> list[Any]:
    if not files:
        return []
    return [Table.of("Files, with their SHA-256", ("file", "SHA-256"), list(files.items()))]

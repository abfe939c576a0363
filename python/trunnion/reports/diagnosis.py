"""The report of a diagnosis: verdict, results, what to do, then the evidence."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from trunnion.base.report import Result, Shown, Table, significant
from trunnion.base.units import capital
from trunnion.data.axis_log import AxisLog
from trunnion.data.positioning import Positioning
from trunnion.diagnosis.contributions import bias_table
from trunnion.diagnosis.records import NO_CAUSE, percent
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.selection import WITHIN
from trunnion.files.table import Table as DataTable
from trunnion.plot.diagnosis import (
    alternatives_picture,
    cause_picture,
    diagnostics,
    record_of,
    residual_picture,
    touched,
)
from trunnion.plot.others import ladder_picture
from trunnion.plot.picture import Picture
from trunnion.plot.ranking import contributions_picture
from trunnion.reports.advice import known_of, outliers_of, to_do
from trunnion.reports.budget import budget_section, held_by_u
from trunnion.reports.causes import SURE, Found
from trunnion.reports.document import Document, Group, Item, Mark, Points, Section
from trunnion.reports.hover import hovered
from trunnion.reports.results import figures_table, location_errors
from trunnion.reports.source import Source
from trunnion.reports.space import in_space
from trunnion.reports.standard import (
    Standard,
    drawn,
    figures_of,
    of_errors,
    standard_results,
    titled,
)
from trunnion.reports.tables import error_tables
from trunnion.reports.verdict import verdict_of_diagnosis
from trunnion.setup.names import called

MARKS = {
    "consistent": Mark.GOOD,
    "explained": Mark.NEUTRAL,
    "ambiguous": Mark.DOUBT,
    "unexplained": Mark.BAD,
}
KINDS = {"Ballbar": "ball-bar test", "Sweep": "rotary axis", "AxisLog": "axis log"}
MAX_OUTLIERS = 50
MAX_SETS = 8
MAX_PICTURES = 8  # of the measurement
CLOSE, WORSE = 1.0, 3.0  # in −2 ln L: a set fits as well, worse
NOT_TOLD = (
    "If one of these acts, these readings do not show it. Where amounts are stated, so much of it "
    "would make an error of the machine wrong by so much."
)
AS_THEY_ARE = (
    "Figures of the standard take the readings as they are, with all causes in them: their U is "
    "another than that of a cause beside which the others are taken off."
)
NOT_JUDGED = "No limits are stated for these sizes: whether they matter is not judged here."
LEFT = "Residuals after the causes"


def diagnosis_document(result: Result, source: Source) -> Document:
    """Return the document of a diagnosis."""
    assert isinstance(result, Diagnosis)
    d, found = result, Found(result)
    errors, decisions = _errors(d, source)
    standard = [
        (name, r)
        for name, one in zip(_names_of(d, source), source.data, strict=True)
        for r in standard_results(one)
    ]
    judged = [titled(t, name) for name, r in standard if (t := _judged(r, source)).rows]
    measured, causes = _measurement(d, source, standard), _pictures(d, source)
    shown = [*(measured[:1] if standard else []), *causes]
    shown = shown[: 2 if errors.rows or judged else 1]
    measured, causes = ([p for p in of if p not in shown] for of in (measured, causes))
    verdict = verdict_of_diagnosis(found)
    if "fail" in decisions:
        verdict += " A tolerance is exceeded."
    elif "undecided" in decisions:
        verdict += " Of a tolerance it is not decided: the uncertainty is too large."
    limits = [NOT_JUDGED] if d.causes and not source.tolerance else []
    limits += held_by_u(d.model, d.data)
    known = known_of(d)
    kinds = ", ".join(dict.fromkeys(map(_kind, source.data))) or "diagnosis"
    return Document(
        f"{capital(kinds)}: {_in_short(found)}",
        source.subtitle(),
        Mark.BAD if "fail" in decisions else MARKS[d.verdict],
        verdict,
        (
            *found.tables(),
            to_do(found, source),
            *limits,
            *((errors,) if errors.rows else ()),
            *shown,
            *judged,
            *((AS_THEY_ARE,) if judged and d.causes else ()),
        ),
        (
            Section("Each cause" if d.causes else "Pictures", tuple(causes)),
            Section("For the error table of the control", tuple(error_tables(found, standard))),
            Section("The measurement", (*measured, *_figures(standard))),
            Section("How much each cause explains" if d.causes else "Noise", tuple(_ladder(found))),
            Section("What else would explain the data", tuple(_alternatives(found))),
            Section("What else is known", (Points(tuple(known)),) if known else ()),
            Section("Outliers", tuple(_outliers(d, source))),
            Section(LEFT if d.causes else "Residuals", tuple(_diagnostics(found, source))),
            Section("In space", tuple(in_space(d, source))),
            Section("What these data do not identify", tuple(_lost(found))),
            budget_section(d.model, found.quantity, curves=True),
            source.section(),
            Section("Names in programs", tuple(_names(found))),
        ),
        {
            c.id: Group(capital(found.label(c.id)), record_of(d).rows[touched(d, c.id)])
            for c in d.causes
        },
    )


def _in_short(found: Found) -> str:
    """Say in a few words what was found."""
    d = found.d
    if d.verdict == "consistent":
        return "nothing beyond noise"
    if d.verdict == "unexplained":
        named = _count(len(d.causes))
        return f"{named} found, not all is explained" if d.causes else "no known cause explains it"
    sure, doubt = len(found.certain), len(d.evidence) > 1
    errors = f"{len(found.located)} errors of the machine, " if found.located else ""
    count = f"{errors}{_count(sure)}"
    if doubt:
        listed = any(c.id not in found.certain for c in d.causes)
        more = "more in doubt" if listed else "perhaps one more"
        return f"{count} certain, {more}" if sure else f"{errors}causes in doubt"
    return f"{count} found" if d.causes else f"{errors}nothing but outliers"


def _count(causes: int) -> str:
    """Say how many causes."""
    return f"{causes} cause{'' if causes == 1 else 's'}"


def _kind(data: DataTable) -> str:
    """Name a kind of data as people call it, with the axis where there is one."""
    name = type(data).__name__
    text = KINDS.get(name) or re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
    if isinstance(data, Positioning):
        return f"{text}, {'axis not stated' if data.axis is None else f'{data.axis[0]} axis'}"
    return text


def _judged(result: Result, source: Source) -> Table:
    """Figures of a standard with U and tolerances; none where the result has no uncertainty."""
    return figures_table(result.title(), figures_of(result), source.tolerance)[0]


def _names_of(d: Diagnosis, source: Source) -> Sequence[str]:
    """What each of several measurements is called; '' of a single one."""
    names: Sequence[str] = getattr(d.model, "measurements", ())
    return names if len(names) == len(source.data) > 1 else [""] * len(source.data)


def _measurement(d: Diagnosis, source: Source, standard: Sequence[Standard]) -> list[Item]:
    """Pictures of the readings as the field draws them."""
    own = [
        titled(p, name)
        for name, one in zip(_names_of(d, source), source.data, strict=True)
        for p in drawn(one, **_shown_of(d, one))
    ]
    shown = own or [titled(p, name) for name, r in standard for p in drawn(r)]
    return [hovered(p, source.data) if isinstance(p, Picture) else p for p in shown[:MAX_PICTURES]]


def _figures(standard: Sequence[Standard]) -> list[Item]:
    """What the standard says of the readings."""
    own = [(name, r) for name, r in standard if not figures_of(r)]
    return [titled(item, name) for name, r in own for item in r.tables()]


def _shown_of(d: Diagnosis, data: DataTable) -> dict[str, Any]:
    """Of a log: the axis of the strongest cause that has one, and the servo as identified."""
    if not isinstance(data, AxisLog):
        return {}
    axes = [c.id.rpartition("_")[2] for c in d.causes]
    axis = next((letter for letter in axes if letter in data.axes), None)
    return {"axis": axis, "servo": getattr(d.model, "servo", None)}


def _errors(d: Diagnosis, source: Source) -> tuple[Table, list[str]]:
    """The machine's errors, causes taken off."""
    old = source.setup.machine.errors if source.setup else {}
    figures = location_errors(d.errors_after, d.errors_std, old, d.units)
    title = "Errors of the machine" + (", the causes taken off" if d.causes else "")
    table, decisions = figures_table(title, figures, source.tolerance)
    return table, [str(one) for one in decisions]


def _pictures(d: Diagnosis, source: Source) -> list[Item]:
    """One picture a cause, the strongest first; without a cause what is found, or the residuals."""
    shown: list[Any] = [cause_picture(d, c.id) for c in d.causes]
    if not shown and d.verdict == "consistent":
        shown = of_errors(d.errors_after, d.errors_std)
    if not shown or d.verdict == "unexplained":
        shown = [residual_picture(d), *shown]
    return [hovered(p, source.data) for p in shown]


def _ladder(found: Found) -> list[Item]:
    """What each cause explains, and what the errors of the machine would be without it."""
    d = found.d
    rows = [
        (
            capital(one.label or c.id),
            *(Shown(x, f"{100 * x:.1f} %") for x in (one.share, one.alone_share, one.last_share)),
            *((one.unit,) if c.others else ()),
        )
        for c in d.contributions
        for one in (c, *c.others)
    ]
    heads = ["cause", "explains of the variance", "if it were the only one", "beside all others"]
    several = any(c.others for c in d.contributions)
    heads += ["readings in"] if several else []
    if all(len({cell.text for cell in row[1:4]}) == 1 for row in rows):  # independent causes
        heads, rows = [*heads[:2], *heads[4:]], [(*row[:2], *row[4:]) for row in rows]
    of = "what the errors of the machine leave" if found.located else "the readings"
    shares = Table.of(f"What each cause explains of {of}", heads, rows)
    ranked = contributions_picture(d)
    steps = ladder_picture(d.ladder) if d.ladder is not None and d.ladder.causes else None
    pictures = [p for p in (ranked, steps) if p is not None]
    return [*pictures, *((shares,) if rows else ()), *_biases(d)]


def _biases(d: Diagnosis) -> list[Item]:
    """How far the errors of the machine would be off."""
    table = bias_table(d.contributions, d.errors_std)
    rows = [(row[0], called(str(row[1])), *row[2:]) for row in table.rows]
    heads = ("cause", "error of the machine", "off by", *table.columns[3:])
    title = "How far off the errors of the machine would be if a cause were not taken off"
    return [Table.of(title, heads, rows)] if rows else []


def _alternatives(found: Found) -> list[Item]:
    """Sets of causes with their probability, and how well each fits."""
    d = found.d
    picture = alternatives_picture(d)
    if picture is None:
        return []
    unit = d.gain.unit if not d.gain.others else "noise"
    rows = [
        (
            " + ".join(sorted(map(found.label, a.causes))) or NO_CAUSE,
            Shown(a.probability, percent(a.probability)),
            "best"
            if a is d.evidence[0] and a.distance < CLOSE
            else "as well"
            if a.distance < CLOSE
            else "worse"
            if a.distance > WORSE
            else "a little worse",
            significant(a.rms_um),
        )
        for a in d.evidence[:MAX_SETS]
    ]
    heads = ("set of causes", "probability of the set", "fits", f"rms of the residual ({unit})")
    note = (
        "Of sets that fit as well the one with fewer causes is the more probable: beforehand, a "
        "further cause is taken for unlikely. The probability of a cause, above, is the sum over "
        "all sets that hold it, those that are not listed, too. A cause is certain if its "
        f"probability is above {percent(SURE)} and every set holds it that fits, after the "
        f"penalty for its causes, at least one {math.exp(WITHIN / 2):.0f}th as well as the best "
        "(ratio of likelihoods); otherwise it is in doubt."
    )
    return [picture, Table.of("Sets of causes", heads, rows), note]


def _outliers(d: Diagnosis, source: Source) -> list[Item]:
    if not d.outliers:
        return []
    rows = [
        (place, None if size is None else significant(size, 3), where)
        for place, size, where in outliers_of(d, source.data, MAX_OUTLIERS)
    ]
    heads = ("", f"off by, {record_of(d).unit}", "reading")
    table = Table.of("Readings that belong to no model", heads, rows)
    more = len(d.outliers) - len(rows)
    return [table, *([f"{more} more are not listed."] if more > 0 else [])]


def _diagnostics(found: Found, source: Source) -> list[Item]:
    d = found.d
    if d.residuals is None:
        return []
    shown = [residual_picture(d)] if d.causes and not d.gain.others else []
    own = diagnostics(d, found.quantity)
    twice = shown and any(v.sequence and v.name in shown[0].title for v in record_of(d).covariates)
    return [hovered(p, source.data) for p in (*shown, *own[1 if twice else 0 :])]


def _lost(found: Found) -> list[Item]:
    if not found.d.not_identifiable:
        return []
    rows = [
        (capital(found.quantity(k)), found.in_words(why))
        for k, why in found.d.not_identifiable.items()
    ]
    return [NOT_TOLD, Table.of("Not identifiable", ("", "why, and what it would do"), rows)]


def _names(found: Found) -> list[Item]:
    """Ids of what the page calls by its label."""
    ids = dict.fromkeys([*(c.id for c in found.d.causes), *found.d.labels])
    rows = [(capital(found.label(i)), i) for i in ids]
    return [Table.of("What commands and Python call them", ("", "name"), rows)] if rows else []

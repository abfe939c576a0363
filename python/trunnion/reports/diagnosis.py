"""The report of a diagnosis: verdict, results, what to do, then the evidence."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from trunnion.base.report import Result, Shown, Table, significant
from trunnion.data.axis_log import AxisLog
from trunnion.diagnosis.records import Cause, labelled, percent
from trunnion.diagnosis.result import Diagnosis
from trunnion.files.table import Table as DataTable
from trunnion.files.table import places
from trunnion.machine.effects import Owner
from trunnion.plot.diagnosis import (
    alternatives_picture,
    cause_picture,
    diagnostics,
    ladder_picture,
    record_of,
    residual_picture,
    touched,
)
from trunnion.plot.picture import Picture
from trunnion.plot.ranking import contributions_picture
from trunnion.reports.budget import budget_section
from trunnion.reports.document import Document, Group, Item, Mark, Points, Section
from trunnion.reports.hover import hovered
from trunnion.reports.results import figures_table, location_errors, plain_words
from trunnion.reports.source import Source
from trunnion.reports.space import in_space
from trunnion.reports.standard import drawn, figures_of, of_errors, standard_results
from trunnion.reports.verdict import size_of, verdict_of_diagnosis
from trunnion.setup.names import error_label

MARKS = {
    "consistent": Mark.GOOD,
    "explained": Mark.NEUTRAL,
    "ambiguous": Mark.DOUBT,
    "unexplained": Mark.BAD,
}
NEXT = {
    "Touches": " (trunnion diagnose --next plans touches that do)",
    "Diameters": " (what trunnion diagnose prints says which pass does)",
}
KINDS = {"Ballbar": "a ball-bar test", "Sweep": "a rotary axis", "AxisLog": "an axis log"}
SLOW = {"drift", "warmup", "expansion", "heating"}  # in the id of what changes with time
MAX_OUTLIERS = 50
MAX_PICTURES = 8  # of the measurement
NOT_TOLD = (
    "If one of these acts, these readings do not show it. Where amounts are stated, so much of it "
    "would make an error of the machine wrong by so much."
)
KNOWN = "What is known (± one standard uncertainty)"
SURE = 0.5  # a probability below it is a doubt
TODO = {
    Owner.MACHINE: "{what}: mend it on the machine, or compensate it where the control can.",
    Owner.TIME: "{what}: let the machine warm up, keep the temperature, or measure faster.",
    Owner.INSTRUMENT: "{what}: it is the instrument's, not the machine's; calibrate the "
    "instrument. The results above are free of it.",
    Owner.ARTEFACT: "{what}: it is the artefact's, not the machine's; have the artefact "
    "calibrated. The results above are free of it.",
    Owner.PLACEMENT: "{what}: it is how the artefact stood, not the machine; clamp it anew. "
    "The results above are free of it.",
    Owner.WORKPIECE: "{what}: it belongs to this part, not to the machine.",
}
OF_PARTS = (
    "{what}: correct the program of the next part (trunnion turning correct), or mend it on the "
    "machine."
)


def diagnosis_document(result: Result, source: Source) -> Document:
    """Return the document of a diagnosis."""
    assert isinstance(result, Diagnosis)
    d = result
    sentences = [plain_words(one) for one in d.sentences()]
    errors, decisions = _errors(d, source)
    causes = _causes(d)
    first, *others = _pictures(d, source)
    standard = [r for one in source.data for r in standard_results(one)]
    judged = [_judged(r, source) for r in standard]
    top = [t for t in (causes, errors) if t.rows]
    figures = [t for t in judged if t.rows]
    verdict = verdict_of_diagnosis(d)
    if "fail" in decisions:
        verdict += " A tolerance is exceeded."
    elif "undecided" in decisions:
        verdict += " Of a tolerance it is not decided: the uncertainty is too large."
    kind = ", ".join(dict.fromkeys(_kind(one) for one in source.data))
    return Document(
        f"Diagnosis{f' of {kind}' if kind else ''}: {d.verdict}",
        source.subtitle(),
        Mark.BAD if "fail" in decisions else MARKS[d.verdict],
        verdict,
        (*top, *_to_do(d, source), first, *figures),
        (
            Section("The measurement", tuple(_measurement(d, source, standard))),
            Section(KNOWN, (Points(tuple(sentences[1:])),) if sentences[1:] else ()),
            Section("Each cause" if d.causes else "Pictures", tuple(others)),
            Section("How much each cause explains" if d.causes else "Noise", tuple(_ladder(d))),
            Section("What else would explain the data", tuple(_alternatives(d))),
            Section("Outliers", tuple(_outliers(d, source))),
            Section("What the residual looks like", tuple(_diagnostics(d, source))),
            Section("In space", tuple(in_space(d, source))),
            Section("What these data do not identify", tuple(_lost(d))),
            budget_section(d.model),
            source.section(),
        ),
        {c.id: Group(_label(c), record_of(d).rows[touched(d, c.id)]) for c in d.causes},
    )


def _kind(data: DataTable) -> str:
    """Name a kind of data as people call it."""
    name = type(data).__name__
    return KINDS.get(name) or re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()


def _judged(result: Result, source: Source) -> Table:
    """Figures of a standard with U and tolerances; none where the result has no uncertainty."""
    return figures_table(result.title(), figures_of(result), source.tolerance)[0]


def _measurement(d: Diagnosis, source: Source, standard: list[Result]) -> list[Item]:
    """Pictures of the readings as the field draws them, and what the standard says of them."""
    own = [p for one in source.data for p in drawn(one, **_shown_of(d, one))]
    shown = own or [p for r in standard for p in drawn(r)]
    items: list[Item] = [
        hovered(p, source.data) if isinstance(p, Picture) else p for p in shown[:MAX_PICTURES]
    ]
    for r in standard:
        items += [*r.sentences(), *(() if figures_of(r) else r.tables())]
    return items


def _shown_of(d: Diagnosis, data: DataTable) -> dict[str, Any]:
    """Of a log: the axis of the strongest cause that has one, and the servo as identified."""
    if not isinstance(data, AxisLog):
        return {}
    axes = [c.id.rpartition("_")[2] for c in d.causes]
    axis = next((letter for letter in axes if letter in data.axes), None)
    return {"axis": axis, "servo": getattr(d.model, "servo", None)}


def _label(cause: Cause) -> str:
    text = cause.label or cause.id.replace("_", " ")
    return text[:1].upper() + text[1:]


def _errors(d: Diagnosis, source: Source) -> tuple[Table, list[str]]:
    """The machine's errors, causes taken off."""
    old = source.setup.machine.errors if source.setup else {}
    figures = location_errors(d.errors_after, d.errors_std, old, d.units)
    title = "Errors of the machine" + (", the causes taken off" if d.causes else "")
    table, decisions = figures_table(title, figures, source.tolerance)
    return table, [str(one) for one in decisions]


def _causes(d: Diagnosis) -> Table:
    """Each named cause with its size and probability."""
    rows = []
    for c in d.causes:
        size = size_of(d, c)
        share = next((x for x in d.contributions if x.id == c.id), None)
        explains = Shown(share.share, f"{100 * share.share:.1f} %") if share else None
        sure = Shown(c.probability, percent(c.probability))
        rows.append((_label(c), c.id, size, sure, explains))
    left = "the residuals" if d.gain.others else f"the {d.gain.rms_before_um:.3g} {d.gain.unit} rms"
    explained = f"explains, of {left} left"
    columns = ("", "name in programs", "size ± U (k = 2)", "probability, in any set", explained)
    return Table.of("What is wrong", columns, rows)


def _to_do(d: Diagnosis, source: Source) -> list[Item]:
    """Say what follows."""
    lines = []
    owners = getattr(d.model, "owners", {})
    if not owners and d.data is not None and d.causes:
        owners = {e.id: e.owner for e in d.rebuilt_model().effects}
    if d.verdict == "ambiguous":
        lines.append(
            "More than one set of causes fits: act on none that is in doubt before further "
            f"readings have decided{NEXT.get(type(d.data).__name__, '')}."
        )
    if d.verdict == "unexplained":
        lines.append(
            "Something acts that no known cause makes: do not trust the results before it is "
            f"found. Look for what depends on {_dependence(d)}."
        )
    lines += _advice(d, owners)
    if d.outliers:
        lines.append(f"Measure again, or clean probe and artefact: {_places(d, source)}.")
    located = any(error_label(name) != name for name in d.errors_after)
    if located and d.verdict in ("consistent", "explained"):
        lines.append(
            "Have the values for the control written from this estimate (trunnion compensate): "
            "its zeros, points and signs are others than those of the errors in this table."
        )
    if not lines:
        lines.append("Nothing: the readings are as the model says, but for noise.")
    return [Points(tuple(lines), "What to do")]


def _advice(d: Diagnosis, owners: Mapping[str, Owner]) -> list[str]:
    """Say what to do about the causes, together where it is the same."""
    certain = frozenset.intersection(*d.alternatives) if d.alternatives else d.named
    said: dict[str, list[str]] = {}
    for c in d.causes:
        owner = owners.get(c.id, Owner.MACHINE)
        if owner is Owner.MACHINE and SLOW & set(c.id.split("_")):
            owner = Owner.TIME
        parts = type(d.data).__name__ == "Diameters" and owner in (Owner.MACHINE, Owner.TIME)
        text = OF_PARTS if parts else TODO[owner]
        doubt = "" if c.id in certain and c.probability > SURE else "If it is there: "
        said.setdefault(doubt + text, []).append(_label(c))
    return [
        text.format(what="; ".join([first, *(x[:1].lower() + x[1:] for x in others)]))
        for text, (first, *others) in said.items()
    ]


def _dependence(d: Diagnosis) -> str:
    text = (d.unexplained or "").partition("depends on ")[2]
    return text.partition(":")[0] or "the residual below"


def _places(d: Diagnosis, source: Source) -> str:
    return ", ".join(place for _, place in _outlier_places(d.outliers, source.data))


def _outlier_places(rows: Iterable[int], data: tuple[DataTable, ...]) -> list[tuple[int, str]]:
    """Row and place of each outlier; rows of several measurements are counted on."""
    out = []
    for row in rows:
        left, place = row, f"row {row} (counted from 0)"
        for one in data:
            if left < len(one):
                place = places(one, [left])
                break
            left -= len(one)
        out.append((row, place))
    return out


def _pictures(d: Diagnosis, source: Source) -> list[Item]:
    """One picture a cause, the strongest first; without a cause what is found, or what is left."""
    shown: list[Any] = [cause_picture(d, c.id) for c in d.causes]
    if not shown and d.verdict == "consistent":
        shown = of_errors(d.errors_after, d.errors_std)
    if not shown or d.verdict == "unexplained":
        shown = [residual_picture(d), *shown]
    return [hovered(p, source.data) for p in shown]


def _ladder(d: Diagnosis) -> list[Item]:
    picture = ladder_picture(d)
    tables = [t for t in d.tables() if t.title not in ("Estimates", "Sets of causes")]
    kept = [t for t in tables if t.title != "Not identifiable"]
    ranked = contributions_picture(d)
    return [*(p for p in (ranked, picture) if p is not None), *kept]


def _alternatives(d: Diagnosis) -> list[Item]:
    picture = alternatives_picture(d)
    if picture is None:
        return []
    tables = [t for t in d.tables() if t.title == "Sets of causes"]
    return [picture, *tables]


def _outliers(d: Diagnosis, source: Source) -> list[Item]:
    if not d.outliers:
        return []
    record = record_of(d)
    rows = []
    for row, place in _outlier_places(d.outliers[:MAX_OUTLIERS], source.data):
        at = np.flatnonzero(record.rows == row)
        size = float(np.max(np.abs(record.before[at]))) if len(at) else None
        rows.append((place, None if size is None else significant(size)))
    table = Table.of("Readings that belong to no model", ("", f"residual, {record.unit}"), rows)
    more = len(d.outliers) - len(rows)
    return [table, *([f"{more} more are not listed."] if more > 0 else [])]


def _diagnostics(d: Diagnosis, source: Source) -> list[Item]:
    if d.residuals is None:
        return []
    shown = [hovered(p, source.data) for p in diagnostics(d)]
    left = hovered(residual_picture(d), source.data) if d.causes else None
    return [*([left] if left else []), *shown]


def _lost(d: Diagnosis) -> list[Item]:
    if not d.not_identifiable:
        return []
    rows = [
        (labelled(k, d.labels.get(k, "")), plain_words(why))
        for k, why in d.not_identifiable.items()
    ]
    return [NOT_TOLD, Table.of("Not identifiable", ("", "why"), rows)]

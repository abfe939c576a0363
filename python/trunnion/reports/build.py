"""Which document a result makes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trunnion.base.conformity import Conformity, Decision
from trunnion.base.report import Cell, Result, Shown, Table, measured
from trunnion.compensation.forecast import CompensationForecast
from trunnion.compensation.verification import BallVerification
from trunnion.controls.files import ControlFiles
from trunnion.diagnosis.records import chance
from trunnion.diagnosis.result import Diagnosis
from trunnion.machine.estimate import Estimate
from trunnion.models.changes import MachineComparison
from trunnion.plot.dispatch import PICTURES
from trunnion.plot.statistics import correlation_picture, normal_picture, order_picture
from trunnion.reports.budget import budget_section
from trunnion.reports.compensation import compensation_document, control_document
from trunnion.reports.diagnosis import diagnosis_document
from trunnion.reports.document import Document, Item, Mark, Points, Section
from trunnion.reports.results import Figure, figures_table, location_errors, of_interest
from trunnion.reports.source import Source
from trunnion.reports.space import in_space
from trunnion.reports.standard import drawn, figures_of, of_errors
from trunnion.reports.verdict import verdict_of_result

MARKS = {Decision.PASS: Mark.GOOD, Decision.FAIL: Mark.BAD, Decision.UNDECIDED: Mark.DOUBT}
CONFORMITY = {
    Decision.PASS: "All tolerances are kept.",
    Decision.FAIL: "A tolerance is exceeded.",
    Decision.UNDECIDED: "Of a tolerance it is not decided: the uncertainty is too large.",
}
MAX_CORRELATED = 40


def document(result: Result, source: Source) -> Document:
    """Return the document of a result."""
    for kind, build in BUILDERS:
        if isinstance(result, kind):
            return build(result, source)
    return _general(result, source)


def verdict_of(text: str, decisions: list[Decision], plain: Mark) -> tuple[Mark, str]:
    """Return the mark of a verdict with what was decided of tolerances before it."""
    if not decisions:
        return plain, text
    worst = next(d for d in (Decision.FAIL, Decision.UNDECIDED, Decision.PASS) if d in decisions)
    return MARKS[worst], f"{CONFORMITY[worst]} {text}"


def _general(result: Result, source: Source) -> Document:
    """Sentences, tables and pictures as the result has them; figures with their uncertainty."""
    sentences, tables = list(result.sentences()), list(result.tables())
    figures = figures_of(result)
    found, decisions = figures_table("Results", figures, source.tolerance)
    shown = drawn(result)
    if found.rows:
        tables = [found, *tables[1:]]
    text = verdict_of_result(result, figures)
    mark, text = verdict_of(text, decisions, Mark.NEUTRAL)
    if isinstance(result, Conformity):
        mark = MARKS[result.decision]
    sections = (
        Section("What else is known", (Points(tuple(sentences[1:])),) if sentences[1:] else ()),
        Section("Pictures", tuple(shown[1:])),
        Section("Tables", tuple(tables[1:])),
        Section("In space", tuple(in_space(result, source))),
        budget_section(result),
        source.section(),
    )
    return Document(
        result.title(), source.subtitle(), mark, text, (*tables[:1], *shown[:1]), sections
    )


def _estimate(result: Estimate, source: Source) -> Document:
    """Location errors first, then what is known of the fit."""
    old = source.setup.machine.errors if source.setup else {}
    errors, decisions = figures_table(
        "Errors of the machine",
        location_errors(result.errors, result.std_errors, old, {}),
        source.tolerance,
    )
    others = [
        Figure(p.name, p.name, p.value, p.std_error, p.unit)
        for p in result.parameters
        if p.name not in result.errors
    ]
    rest, _ = figures_table("Placement of the artefact, and effects", others, {})
    lost = len([s for s in result.std_errors.values() if not np.isfinite(s)])
    text = of_interest(result.errors, result.std_errors)
    if lost and lost == len(result.std_errors):
        text = " ".join([text, *list(result.sentences())[:1]])
    mark, text = verdict_of(text, decisions, Mark.DOUBT if lost else Mark.NEUTRAL)
    if not getattr(result, "converged", True):
        mark, text = Mark.BAD, "The fit did not converge: do not use these numbers."
    if doubts := result.derived().get("doubts"):
        mark, text = Mark.BAD, f"{doubts[0]} {text}"
    sentences = tuple(result.sentences())
    shown = [*of_errors(result.errors, result.std_errors), *_own(result)]
    sections = (
        Section("What is known of the fit", (Points(sentences),) if sentences else ()),
        Section("Pictures", tuple(shown[1:])),
        Section("Residuals", tuple(_residuals(result))),
        Section("In space", tuple(in_space(result, source))),
        Section("Correlation of the estimates", tuple(_correlation(result))),
        Section("Other parameters", (rest,) if rest.rows else ()),
        budget_section(result),
        source.section(),
    )
    return Document(result.title(), source.subtitle(), mark, text, (errors, *shown[:1]), sections)


def _own(result: Estimate) -> list[Item]:
    """Pictures of a result beside those of its estimates."""
    name = next((PICTURES[k.__name__] for k in type(result).__mro__ if k.__name__ in PICTURES), "")
    return [] if name == "estimates_pictures" else drawn(result)


def _residuals(result: Estimate) -> list[Item]:
    residuals = getattr(result, "residuals_um", None)
    if residuals is None or not len(residuals):
        return []
    values = np.asarray(residuals, dtype=np.float64).ravel()  # of an R-test: X, Y, Z of each
    return [order_picture(values, "µm"), normal_picture(values, "µm")]


def _correlation(result: Estimate) -> list[Item]:
    known = np.diag(result.covariance) > 0 if result.names else np.zeros(0, dtype=bool)
    count = int(known.sum())
    if not 2 <= count <= MAX_CORRELATED:
        return []
    names = [name for name, kept in zip(result.names, known, strict=True) if kept]
    return [correlation_picture(names, result.covariance[np.ix_(known, known)])]


def _comparison(result: MachineComparison, source: Source) -> Document:
    """What changed, with the change and its uncertainty before all else."""
    doubts = len(result.mistakes)
    first, *more = result.sentences()[doubts:]
    tables = result.tables()
    known = [one for one in more if not one.startswith(("Not changed", "Level"))]
    mark = Mark.BAD if doubts else Mark.DOUBT if result.changed else Mark.GOOD
    count = len(result.changed)
    said = f"{count} of {len(result.quantities)} quantities changed" if count else "nothing changed"
    sections = (
        Section("Pictures", tuple(drawn(result))),
        Section("Measurements", (_measurements(result, source),)),
        Section("Over time", tables[1:]),
        source.section(),
    )
    notes = (Points(tuple(known), "What else is known"),) if known else ()
    top = (_changes(result), _by_noise(result), *notes)
    text = " ".join((*result.mistakes, first))
    return Document(f"Comparison: {said}", source.subtitle(), mark, text, top, sections)


def _verification(result: BallVerification, source: Source) -> Document:
    """Whether what is left is what was forecast, before and after at every posture."""
    mark = {True: Mark.GOOD, False: Mark.BAD, None: Mark.NEUTRAL}[result.as_forecast]
    shown = drawn(result)
    sections = (
        Section("What else is known", (Points(result.notes),) if result.notes else ()),
        Section("Pictures", tuple(shown[1:])),
        source.section(),
    )
    return Document(
        result.title(),
        source.subtitle(),
        Mark.BAD if result.mistakes else mark,
        " ".join(result.verdict()),
        (*result.tables(), *shown[:1]),
        sections,
    )


def _changes(result: MachineComparison) -> Table:
    """Each quantity before and after, with the half width of the 95 % interval of the change."""
    rows = []
    for q in result.quantities:
        value, half = measured(q.change, q.high - q.change)
        p = Shown(q.p_value, chance(q.p_value).removeprefix("p ").removeprefix("= "))
        rows.append((q.called, *q.ends, value, half, q.unit, p, "yes" if q.changed else "no"))
    ends = (one.replace("-", "\u2011") for one in (result.names[0], result.names[-1]))
    heads = ("", *ends, "change", "±\u00a0(95\u00a0%)", "unit", "p", "changed")
    return Table.of("Changes", heads, rows)


def _by_noise(result: MachineComparison) -> str:
    """Say what p and the decision rest on."""
    return (
        "p: how often noise alone makes a change as large, over all quantities together (Holm); "
        f"below {result.level:g} it counts as changed. Errors that all measurements share cancel."
    )


def _measurements(result: MachineComparison, source: Source) -> Table:
    """Label, date and file of each measurement."""
    rows: list[tuple[Cell, ...]] = []
    for k, name in enumerate(result.names):
        one = source.data[k] if len(source.data) == len(result.names) else None
        file = ", ".join(one.origin.names) if one is not None and one.origin else ""
        day = f"{result.days[k]:g} days after the first" if k else "the first"
        rows.append(
            (
                name,
                day if result.dated else "not stated (--dates)",
                file,
                None if one is None else len(one),
            )
        )
    return Table.of("Measurements, in order of time", ("", "date", "file", "rows"), rows)


BUILDERS: tuple[tuple[type[Any], Callable[[Any, Source], Document]], ...] = (
    (Diagnosis, diagnosis_document),
    (MachineComparison, _comparison),
    (BallVerification, _verification),
    (Estimate, _estimate),
    (CompensationForecast, compensation_document),
    (ControlFiles, control_document),
)
"""Class of a result → what makes its document; any other result has a general one."""

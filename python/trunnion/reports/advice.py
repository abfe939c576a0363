"""What a reader of a diagnosis should do, and what else there is to know."""

from __future__ import annotations

from typing import cast

import numpy as np

from trunnion.base.errors import TrunnionError
from trunnion.base.report import number, uncertainty
from trunnion.base.units import capital
from trunnion.data.ballbar import Ballbar
from trunnion.data.diameters import Diameters
from trunnion.data.levels import Levels
from trunnion.data.points import Points as PointData
from trunnion.data.positioning import Positioning
from trunnion.data.rotary_test import RotaryTest
from trunnion.data.sweep import Sweep
from trunnion.data.touches import Touches
from trunnion.diagnosis.families import WARM
from trunnion.diagnosis.records import percent, with_unit
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.sentences import unit_in
from trunnion.files.origin import places
from trunnion.files.table import Table as DataTable
from trunnion.models.next_measurement import USEFUL, next_measurement
from trunnion.models.next_passes import next_passes
from trunnion.models.temperatures import WITH_TEMPERATURE
from trunnion.plot.diagnosis import record_of
from trunnion.reports.causes import Found
from trunnion.reports.document import Points
from trunnion.reports.hover import columns_of
from trunnion.reports.results import COVERAGE
from trunnion.reports.source import Source
from trunnion.setup.names import called, error_label

TESTED = (Touches, Ballbar, Positioning, RotaryTest)
"""Data of which the library knows further tests."""
AGAIN = "Look what happened at these readings and measure them again"
CLEANED = {
    (Touches, RotaryTest, PointData): "Clean probe and artefact and measure again",
    (Ballbar,): "Clean the balls and their sockets and measure again",
    (Levels,): "Clean the feet of the level and the surface and read again",
    (Sweep,): "Clean sensors and targets and measure again",
    (Diameters,): "Clean the part from chips and burrs and measure it again there",
}
"""What is done about outliers, by the kind of data."""
MAX_NAMED = 5
MIN_DOUBT = 0.5  # of the uncertainty of an error, from which the doubt is stated
ROUNDING = 1e-9  # µm, arcsec: data without noise have standard errors of 0


def to_do(found: Found, source: Source) -> Points:
    """Say what follows from a diagnosis."""
    d, lines = found.d, []
    if d.verdict == "unexplained":
        lines.append(
            "Something acts that no known cause makes: do not trust the results before it is "
            f"found. Look for what depends on {_dependence(d)}."
        )
    acts = [*([one] for one in _certain(found)), _doubtful(found)]
    acts.append([note for note in d.notes if WITH_TEMPERATURE in note])
    acts.sort(key=lambda some: not any(WARM in line for line in some))  # before all compensation
    lines += [line for some in acts for line in some]
    if d.outliers:
        unit = record_of(d).unit
        named = [
            place if size is None else f"{place}, off by {number(size, 1)} {unit}"
            for place, size, _ in outliers_of(d, source.data, MAX_NAMED)
        ]
        more = f" and {len(d.outliers) - len(named)} more" if len(d.outliers) > MAX_NAMED else ""
        how = next((text for kind, text in CLEANED.items() if isinstance(d.data, kind)), AGAIN)
        lines.append(f"{how}: {'; '.join(named)}{more}.")
    known = {*d.errors_after, *(i for ids in found.doubtful() for i in ids)}
    unseen = [found.quantity(k) for k in d.not_identifiable if k not in known]
    if unseen:
        more = f" and {len(unseen) - MAX_NAMED} more" if len(unseen) > MAX_NAMED else ""
        lines.append(
            f"Not seen by these readings: {', '.join(unseen[:MAX_NAMED])}{more}. Where one of them "
            "acts, errors of the machine can be wrong by more than U: below, what these data do "
            "not identify."
        )
    located = any(error_label(name) != name for name in d.errors_after)
    if located and d.verdict != "unexplained":
        lines.append(
            "Errors of the machine: do not key them in as they stand; a control has other signs "
            "and counts from other points. Who runs trunnion has its values written (trunnion "
            "compensate)."
        )
    return Points(tuple(lines or ["Nothing: the readings are as the model says."]), "What to do")


def _certain(found: Found) -> list[str]:
    """Say what to do about the causes that are certain, together where it is the same."""
    said: dict[str, list[str]] = {}
    for c in found.d.causes:
        if c.id in found.certain:
            said.setdefault(found.family(c.id).advice, []).append(found.label(c.id) + c.or_other)
    return [f"{capital('; '.join(names))}: {advice}" for advice, names in said.items()]


def _doubtful(found: Found) -> list[str]:
    """Say what to do about what is in doubt: the same whatever it is, or what decides it."""
    sets = found.doubtful() if len(found.d.evidence) > 1 else []
    if not any(sets):
        return []
    names = list(dict.fromkeys(found.label(i) for ids in sets for i in ids))
    advice = [{found.family(i).advice for i in ids} for ids in sets]
    first = advice[0]
    named = names if len(names) <= MAX_NAMED else [*names[: MAX_NAMED - 1], "others"]
    shown = " or ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)
    deciding = _deciding(found)
    if len(first) == 1 and all(one == first for one in advice):
        return [f"{capital(shown)}, not known which: {next(iter(first))}", *deciding]
    return [f"{capital(shown)}: do nothing about it before it is decided.", *deciding]


def _deciding(found: Found) -> list[str]:
    """Say which further readings decide, where the library knows some."""
    d = found.d
    if isinstance(d.data, Diameters):
        passes = [one for one in next_passes(d) if one.distinguished]
        return [f"To decide it, {passes[0].label}." for _ in passes[:1]] or [
            "None of the further passes that were tried would decide it."
        ]
    if not isinstance(d.data, (*TESTED, tuple)):
        return []
    try:
        tests = next_measurement(d)
    except TrunnionError:
        return []
    if not tests:
        return []
    best = max(tests, key=lambda test: test.chance)
    what = f"{best.label}, {best.minutes:.0f} min"
    if best.chance >= USEFUL:
        chance = f"it decides with a probability of {percent(best.chance)}"
        return [f"To decide it, measure: {what}; {chance} (trunnion diagnose --next plans it)."]
    return [f"Which it is, none of {len(tests)} further tests that were tried is likely to tell."]


def _dependence(d: Diagnosis) -> str:
    text = (d.unexplained or "").partition("depends on ")[2]
    return text.partition(":")[0] or "the residuals, below"


def outliers_of(
    d: Diagnosis, data: tuple[DataTable, ...], most: int
) -> list[tuple[str, float | None, str]]:
    """Place, residual (the largest of its readings) and columns of outliers, one a row.

    Rows of several measurements are counted on.
    """
    record, out = record_of(d), []
    for row in d.outliers[:most]:
        left, place, where = row, f"row {row} (counted from 0)", ""
        for one in data:
            if left < len(one):
                place, where = places(one, [left]), ", ".join(columns_of(one, left))
                break
            left -= len(one)
        mine = record.after[record.rows == row]
        size = float(mine[np.argmax(np.abs(mine))]) if len(mine) else None
        out.append((place, size, where))
    return out


def known_of(d: Diagnosis) -> list[str]:
    """Say what is known beside causes and errors."""
    lines = [] if d.reservation is None else [d.reservation]
    if d.causes or d.structure is not None:
        for g in (d.gain, *d.gain.others):
            before, after = f"{g.rms_before_um:.3g}", f"{g.rms_after_um:.3g}"
            if before == after:
                continue
            other = f"from {g.heldout_rms_before_um:.3g} to {g.heldout_rms_after_um:.3g}"
            lines.append(
                f"With the causes the rms of the residual goes from {before} to "
                f"{with_unit(after, g.unit)}; of readings that were kept out of the fit and "
                f"predicted, {other} (cross-validation)."
            )
    found = Found(d)
    lines += _widened(found)
    for id_, why in d.unnoticed.items():
        if id_ in d.not_identifiable:  # said there
            continue
        lines.append(f"Not excluded, {found.quantity(id_)}: {found.in_words(why)}.")
    return [*lines, *(note for note in d.notes if WITH_TEMPERATURE not in note)]


def _widened(found: Found) -> list[str]:
    """Say of which errors U is mostly the doubt between two sets."""
    d, lines = found.d, []
    for name in cast("dict[str, frozenset[str]]", d.rivals):
        std, part = d.errors_std[name], d.doubt[name]
        if not np.isfinite(std) or part <= max(MIN_DOUBT * std, ROUNDING):
            continue
        one, other = d.alternatives[0], d.rivals[name]
        pair = [
            " + ".join(sorted(map(found.label, s))) or "no further cause"
            for s in (one - other, other - one)
        ]
        whole, doubt = (f"{uncertainty(COVERAGE * v)} {unit_in(d, name)}" for v in (std, part))
        lines.append(
            f"U of the {called(name)}, {whole}, is mostly ({doubt}) the doubt between "
            f"{' and '.join(pair)}."
        )
    return lines

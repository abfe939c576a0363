"""Readings that may be bad ones, beside the causes that they show or hide."""

from __future__ import annotations

from functools import partial

import numpy as np

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis import outliers as out
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.selection import MAX_CAUSES, search

MAX_SUSPECTS = 12
RESTS = 0.5  # of what a cause explains, from which on it rests on one reading


def far_out(case: Case, f: Fit, level: float = out.OUTLIER_LEVEL) -> Integers:
    """Find readings far out under a fit (indices into the readings it used)."""
    return out.far_out_beside(f.basis, f.white, case.least_noise, level, partial(case.sizes, f))


def proposals(case: Case, found: Explanation, bad: Integers, aside: Integers) -> list[Integers]:
    """Propose further readings to set aside: far out under the causes, or competing with them.

    ``bad``: those that are set aside already; ``aside``: those that are far out of the plain model.
    """
    out_of_causes = []
    if not len(bad) and found.sets and not case.exact(found.fit):
        out_of_causes.append(far_out(case, found.fit))
        out_of_causes.append(_rested_on(case, found.fit))
    suspects = np.union1d(aside, out_of_causes[0]) if out_of_causes else aside
    if 0 < len(suspects) <= MAX_SUSPECTS:
        out_of_causes.append(_among_causes(case, suspects))
    return out_of_causes


def _among_causes(case: Case, suspects: Integers) -> Integers:
    """Let a few suspect readings compete with the causes, each as a cause of its own."""
    n = len(case.model.readings)
    alone = np.zeros((n, len(suspects)))
    alone[suspects, np.arange(len(suspects))] = 1.0
    white = np.asarray(case.whiten(alone)).T[:, None, :, None]
    both = case.candidates.beside(list(white), np.full(len(suspects), out.OUTLIER_LEVEL / n))
    top = search(both, case.plain.white, most=MAX_CAUSES + len(suspects), floor=case.floor).top
    count = len(case.effects)
    return np.sort(suspects[[m - count for m in top.members if m >= count]])


def _rested_on(case: Case, f: Fit) -> Integers:
    """Readings on which a cause rests: more than half of what it explains it explains of one.

    Noise with heavy tails has readings that are not far enough out to be no part of it, and too far
    for the normal noise by which causes are weighed: a shift before the last touches, of which one
    reads in its direction.
    """
    found = []
    for effect in (e for e in case.effects if e.id in f.effects):
        own = case.columns_of(effect, f)
        linear = [i for i, p in zip(own, effect.parameters, strict=True) if p.linear]
        values = [f.effects[effect.id][p.name] for p in effect.parameters if p.linear]
        others = np.delete(f.jacobian, own, axis=1)
        explained = f.jacobian[:, linear] @ values
        explained = explained - others @ np.linalg.lstsq(others, explained, rcond=None)[0]
        rested = rested_on(explained, f.white)
        found += [] if rested is None else [rested]
    return np.unique(found).astype(np.intp)


def rested_on(explained: Floats, left: Floats) -> int | None:
    """Reading on which a cause rests, if it does so on one.

    ``explained``: what it makes beside the others of its set, (n,); ``left``: what these leave.
    """
    share = explained * (explained + left)
    largest = int(np.argmax(share))
    return largest if share[largest] > RESTS * np.sum(share) else None

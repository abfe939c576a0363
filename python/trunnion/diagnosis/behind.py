"""Sets of causes behind which an effect may be that nothing demands."""

from collections.abc import Collection

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.columns import APART
from trunnion.diagnosis.explanation import Sets
from trunnion.diagnosis.selection import WITHIN, Found, search

MAX_ALTERNATIVES = 50
HIDDEN_SIZES = (1.0, 2.0, 4.0)  # times its least size, an effect that may hide behind causes


def behind(case: Case, best: float, sets: Sets) -> Sets:
    """Sets that explain the data as well with one more effect beside them, of a size that matters.

    Nothing demands the effect, but the others take its share where it is there: a tool that wears
    while it heats up looks like one that heats up less and sooner. The size is supposed and not
    fitted, so that it costs no penalty. In its set the effect is the last.
    """
    c = case.candidates
    known = {frozenset(m) for m, _, _ in sets}
    out: dict[frozenset[int], tuple[dict[int, int], float, float]] = {}
    hidden = {j for j, effect in enumerate(case.effects) if effect.least is not None}
    for j in sorted(hidden):
        effect = case.effects[j]
        change = np.asarray(effect.change(effect.least or {}), dtype=np.float64)
        white = case.white(change)
        own = white - case.plain.basis @ (case.plain.basis.T @ white)
        if not _take_a_share(c, known, own):
            continue
        for times in HIDDEN_SIZES:
            for f in search(c, case.plain.white - times * own, floor=case.floor).found:
                if f.score > best + WITHIN:
                    break
                for members in expand(c, f):
                    with_it = frozenset(members) | {j}
                    # Where it can take another's place, that is said already.
                    swapped = any(with_it > k and j in k and len(with_it - k) == 1 for k in known)
                    if j in members or with_it in known or swapped:
                        continue
                    one = ({**members, j: 0}, max(f.score - best, 0.0), f.rss)
                    if with_it not in out or one[1] < out[with_it][1]:
                        out[with_it] = one
    # A set that holds a smaller one of the kind says it again.
    small = [k for k in (*known, *out) if k & hidden]
    fresh = [one for with_it, one in out.items() if not any(with_it > k for k in small)]
    return sorted(fresh, key=lambda one: one[1])


def _take_a_share(c: Candidates, sets: Collection[frozenset[int]], own: Floats) -> bool:
    """Whether causes of some sets explain any of a white change: not those of other readings."""
    causes = np.isin(c.owner, sorted(set().union(*sets)))
    return bool(np.any(c.gains(own)[causes] > APART**2 * (own @ own)))


def expand(c: Candidates, f: Found) -> list[dict[int, int]]:
    """List all sets that a set of leaders stands for: candidate and its variant."""
    out: list[dict[int, int]] = [{}]
    for b in f.blocks:
        alike = c.alike[int(c.owner[b])]
        out = [{**o, i: int(c.variant[b])} for o in out for i in alike]
    return out[:MAX_ALTERNATIVES]

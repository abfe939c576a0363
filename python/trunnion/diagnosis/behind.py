"""Sets of causes that only a report asks for: what may be behind named causes, or instead."""

from collections.abc import Collection
from copy import copy

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import NAMING_LEVEL, Candidates
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.columns import APART
from trunnion.diagnosis.explanation import Sets
from trunnion.diagnosis.joint_ids import Happened, JointId
from trunnion.diagnosis.scorer import SCORE_DIGITS
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


def differing_instead(case: Case, best: float, sets: Sets) -> Sets:
    """Sets in which what kinds share differs instead of a cause that one kind of measurement shows.

    A machine that was changed between two measurements looks like one with a cause that only one of
    them shows: a drift of the plate for a scale. That kinds differ is named at a level far below
    that of a cause. Instead of such a cause it has the odds of a change between two dates of one
    kind, those of any cause, and is no likelier than what is named.
    """
    c = case.candidates
    effects, named = case.effects[: c.count], frozenset(sets[0][0])
    ids = [JointId.of(effect.id) for effect in effects]
    differing = {j for j, of in enumerate(ids) if of.happened is Happened.DIFFERS}
    own = {j for j in named if j < c.count and effects[j].of_one_kind}
    if not differing or not own or named & differing:
        return []
    found = search(_at_usual_odds(c, differing), case.plain.white, floor=case.floor).found
    near = [f for f in found if f.score <= best + WITHIN]
    near = [f for f in near if f.members & differing and not own <= f.members]
    near.sort(key=lambda f: (round(f.score, SCORE_DIGITS), len(f.members & differing)))
    # Which kind differs from which says the same again.
    known, said = {frozenset(members) for members, _, _ in sets}, set[frozenset[str]]()
    out: Sets = []
    for f in near:
        for members in expand(c, f):
            what = frozenset(ids[j].cause if j in differing else effects[j].id for j in members)
            if what not in said and frozenset(members) not in known:
                said.add(what)
                out.append((members, max(f.score - best, 0.0), f.rss))
    return out


def _at_usual_odds(c: Candidates, some: Collection[int]) -> Candidates:
    """Return candidates, some of them at the level of a usual cause, one among all."""
    new = copy(c)
    usual = np.isin(np.arange(c.count), sorted(some))
    new.level = np.where(usual, NAMING_LEVEL / max(c.multiplicity, 1.0), c.level)
    new.chance = new.by_chance()
    new.penalty = c.penalty + c.inflation * (new.chance - c.chance)
    return new


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

"""What to touch next: touches that distinguish what is equally consistent with the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import instance, whole
from trunnion.base.errors import DataError, InputError
from trunnion.base.report import Result, Table
from trunnion.base.saved import Columns
from trunnion.base.units import Flags, Floats, Integers, unit_of
from trunnion.data.distinct import distinct_rows
from trunnion.data.touches import Touches, without_frame
from trunnion.diagnosis.discrimination import Discrimination, Hypothesis
from trunnion.diagnosis.effect import Effect, EffectValues, Values
from trunnion.diagnosis.fit import fit
from trunnion.diagnosis.records import percent
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.whitening import identity
from trunnion.machine.chain import Chain
from trunnion.models.touches import TouchDiagnosisModel
from trunnion.probing.plan import plan
from trunnion.probing.steps import cycle_of, in_ranges
from trunnion.setup import Setup

MAX_SETS = 8
COUNTS = (16, 32, 64, 128)
PAUSE_S = 60.0
FIND_MM_MIN = 600.0  # feed at which touches are found, as a plan has it unless another is given
MIN_CHANCE = 0.9


@dataclass(frozen=True, eq=False, repr=False)
class ExpectedDiscrimination(Result):
    """New touches, and what they are expected to distinguish.

    Attributes
    ----------
    plan:
        The touches, in an order that turns the axes little; time runs on from the measurement.
    sets:
        How many sets of causes are to be distinguished.
    chance:
        That all sets of causes but one are ruled out; 1 if there is only one set to begin with.
    enough:
        How many such touches would do it with 90 %, or None if none of those tried would.
    alike:
        Pairs of sets that no reachable touch distinguishes.
    std_before, std_after:
        Standard errors of the named causes' parameters ("id.parameter"), now and with the touches.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> found = tn.expected_discrimination(d, 4)
    >>> len(found.tables())
    1
    """

    plan: Touches
    sets: int
    chance: float
    enough: int | None
    alike: tuple[tuple[frozenset[str], frozenset[str]], ...]
    std_before: dict[str, float]
    std_after: dict[str, float]

    def sentences(self) -> Sequence[str]:
        """Say what the touches are expected to show."""
        n = len(self.plan)
        if self.sets < 2:
            lines = [f"There is one set of causes; {n} touches make its parameters more certain."]
        else:
            lines = [
                f"{n} touches distinguish the {self.sets} sets of causes with a probability of "
                f"{percent(self.chance)}."
            ]
        if self.chance < MIN_CHANCE:
            if self.enough is not None:
                lines.append(f"About {self.enough} touches are needed for {percent(MIN_CHANCE)}.")
            else:
                lines.append(f"Not even {COUNTS[-1]} touches reach {percent(MIN_CHANCE)}.")
        for a, b in self.alike:
            one, other = " + ".join(sorted(a)), " + ".join(sorted(b))
            lines.append(f"No reachable touch distinguishes {one} from {other}.")
        return lines

    def tables(self) -> tuple[Table, ...]:
        """Standard errors now and with the touches."""
        rows = [
            (name, now, self.std_after[name], unit_of(name))
            for name, now in self.std_before.items()
        ]
        columns = ("parameter", "std. error now", "with the touches", "unit")
        return (Table.of("Expected standard errors", columns, rows),) if rows else ()

    def to_columns(self) -> Columns:
        """Return the touches."""
        return self.plan.columns


MAX_TOUCHES = 1000
"""Most touches to be chosen at once."""


@checked
def next_touches(d: Diagnosis, n: int = 8) -> Touches:
    """Plan the n touches that best distinguish a diagnosis' alternatives, or sharpen its cause.

    Chosen from what the machine can reach: the artefact's faces at C and the tilting axis every
    30 degrees and at combinations, from both senses of turning, at two feeds (one, where a second
    pass records all touches at its own), after the measurement. What they are expected to show is
    in :func:`expected_discrimination`.

    Raises
    ------
    InputError
        The diagnosis is not one of touches, or n is no positive number.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> len(tn.next_touches(d, 4))
    4
    """
    return expected_discrimination(d, n).plan


@checked
def expected_discrimination(d: Diagnosis, n: int = 8) -> ExpectedDiscrimination:
    """Plan as :func:`next_touches`, and say what the touches are expected to show.

    Raises
    ------
    InputError
        The diagnosis is not one of touches, or n is no positive number.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> found = tn.expected_discrimination(d, 4)
    >>> len(found.plan)
    4
    """
    instance("d", d, Diagnosis, "a Diagnosis, as diagnose gives it")
    if not isinstance(d.data, Touches):
        raise InputError("diagnosis: got one of other data, expected a diagnosis of touches")
    model = cast(TouchDiagnosisModel, d.rebuilt_model())
    n = whole("n", n, 1, MAX_TOUCHES)
    pool = pool_of(model)
    used = np.delete(np.arange(len(model.data)), distinct_rows(d.data).numbers(d.outliers))
    old = model.data[used]
    both = model.bind(without_frame(old).followed_by(without_frame(pool)))
    is_old = np.arange(len(both.data)) < len(old)
    tried = [
        (a.causes, _hypothesis(model, both, d, used, a.start, a.distance))
        for a in d.evidence[:MAX_SETS]
    ]
    named = tried[0][1] if tried else _hypothesis(model, both, d, used, {}, 0.0)
    if named is None:
        raise DataError("diagnosis: got errors with which further touches miss, expected others")
    # A shift whose size the touches hardly tell may put the artefact where no touch meets it.
    known = [(causes, one) for causes, one in tried if one is not None]
    sets = [one for _, one in known] or [named]
    nuisance = both.jacobian(_values(d), {})
    if len(sets) > 1:
        discrimination = Discrimination(nuisance, is_old, sets, d.sigma)
        many = discrimination.choose(max(n, COUNTS[-1]))
        chosen = many[:n]
        chance = discrimination.chance(chosen)
        enough = next(
            (k for k in COUNTS if k > n and discrimination.chance(many[:k]) >= MIN_CHANCE), None
        )
        pairs = discrimination.alike(many)
        alike = tuple((known[i][0], known[j][0]) for i, j in pairs)
    else:
        chosen = _sharpest(nuisance, sets[0].columns, is_old, n)
        chance, enough, alike = 1.0, None, ()
    before, after = _std(d, model.effects, nuisance, sets[0].columns, is_old, chosen)
    ordered = in_good_order(pool[chosen - len(old)], old, model.setup)
    return ExpectedDiscrimination(ordered, len(sets), chance, enough, alike, before, after)


def pool_of(model: TouchDiagnosisModel) -> Touches:
    """Return every touch that is reachable, timed as if it were done after the measurement."""
    setup = model.setup
    feeds = model.data.feed_mm_min
    usual = float(np.median(feeds)) if feeds is not None else FIND_MM_MIN
    chain = Chain(setup)
    tilting, turning = ((x or "").lower() for x in (chain.tilting, chain.turning))
    tilts = (-90.0, -60.0, -30.0, 30.0, 60.0, 90.0)
    pairs = [(t, c) for t in (-60.0, -30.0, 30.0, 60.0) for c in (45.0, 90.0, 180.0, 270.0)]
    turn: dict[str, tuple[float, ...]] = {f"{tilting}_deg": tilts} if tilting else {}
    if turning:
        turn[f"{turning}_deg"] = tuple(float(c) for c in range(0, 360, 30))
    free = {letter: replace(x, range_mm=None, range_deg=None) for letter, x in setup.axes.items()}
    once = replace(setup.plan, slow_feed_mm_min=0.0)  # as they are recorded
    made = plan(
        replace(setup, axes=free, plan=once),
        feeds_mm_min=(usual,) if setup.plan.slow_feed_mm_min else (usual, usual / 3),
        both_senses=True,
        positions_deg=pairs if tilting and turning else (),
        all_faces=True,
        **turn,  # type: ignore[arg-type]
    )
    # In whichever order they are made, each comes from its sense; an axis that the plan has not
    # turned before comes from the positive one.
    senses = {f"{x}_dir": np.where(way == 0, 1, way) for x, way in made.rotary_dir.items()}
    made = made.with_columns(**senses)
    inside = in_ranges(made, setup)
    if not inside.any():
        raise DataError("no touch of the artefact stays within the ranges of [axes] in the set-up")
    made = made[inside]
    if model.data.time_s is None:
        return made
    end = float(np.max(model.data.time_s))
    pace = (end - float(np.min(model.data.time_s))) / max(len(model.data) - 1, 1)
    return made.with_columns(time_s=np.full(len(made), end + PAUSE_S + 4 * pace))


def _hypothesis(
    model: TouchDiagnosisModel,
    both: TouchDiagnosisModel,
    d: Diagnosis,
    used: Integers,
    start: EffectValues,
    distance: float,
) -> Hypothesis | None:
    """Fit a set to the measurement; return what it gives for old and possible touches."""
    effects = [e for e in model.effects if e.id in start]
    at = {k: Values(v) for k, v in start.items()}
    f = fit(model, used, effects, _values(d), at, identity)
    return Hypothesis.at(both, f.nuisance, f.effects, distance, identity)


def _sharpest(nuisance: Floats, columns: Floats, old: Flags, n: int) -> Integers:
    """Choose the touches after which the parameters of interest are best known (D-optimal)."""
    new = np.flatnonzero(~old)
    d = np.concatenate([nuisance, columns], axis=1)
    size = np.linalg.norm(d, axis=0)
    d = d / np.where(size > 0, size, 1.0)
    p = nuisance.shape[1] if columns.shape[1] else 0
    c = np.linalg.inv(d[old].T @ d[old] + 1e-9 * np.eye(d.shape[1]))
    chosen = []
    for _ in range(n):
        cd = d[new] @ c
        spread = 1.0 + np.einsum("ij,ij->i", cd, d[new])
        own = np.linalg.inv(c[p:, p:])
        worth = np.einsum("ij,jk,ik->i", cd[:, p:], own, cd[:, p:]) / spread
        best = int(np.argmax(worth))
        chosen.append(int(new[best]))
        c = c - np.outer(cd[best], cd[best]) / spread[best]
    return np.array(chosen, dtype=np.intp)


def _values(d: Diagnosis) -> Floats:
    """Return the errors and the placement under the extended model."""
    return np.array(list(d.nuisance_after.values()))


def _std(
    d: Diagnosis,
    effects: Sequence[Effect],
    nuisance: Floats,
    columns: Floats,
    old: Flags,
    chosen: Integers,
) -> tuple[dict[str, float], dict[str, float]]:
    """Standard errors of the named causes' parameters before and after."""
    order = [e for e in effects if e.id in d.named]
    names = [f"{e.id}.{q.name}" for e in order for q in e.parameters]
    if len(names) != columns.shape[1]:
        return {}, {}
    full = np.concatenate([nuisance, columns], axis=1)
    size = np.linalg.norm(full, axis=0)
    size = np.where(size > 0, size, 1.0)
    out = []
    for rows in (np.flatnonzero(old), np.concatenate([np.flatnonzero(old), chosen])):
        x = full[rows] / size
        w, v = np.linalg.eigh(x.T @ x)
        seen = w > 1e-8
        variance = np.einsum("ij,j,ij->i", v[:, seen], 1 / w[seen], v[:, seen])
        lost = np.einsum("ij,ij->i", v[:, ~seen], v[:, ~seen]) > 1e-6
        std = np.where(lost, np.inf, d.sigma * np.sqrt(variance)) / size
        out.append(dict(zip(names, map(float, std[nuisance.shape[1] :]), strict=True)))
    return out[0], out[1]


def in_good_order(chosen: Touches, old: Touches, setup: Setup) -> Touches:
    """Sort by position of the axes and sense; time runs on as the program needs it."""
    senses = list(chosen.rotary_dir.values())
    out = chosen[np.lexsort([*senses, *chosen.rotary_deg.values()])]
    slow = setup.plan.slow_feed_mm_min
    if slow:  # that at which touches are recorded; nothing says at which they were found
        found = FIND_MM_MIN if slow < FIND_MM_MIN else 2 * slow
        out = out.with_columns(feed_mm_min=np.full(len(out), found))
    if old.time_s is None:
        return out.with_columns(time_s=None)
    end = float(np.max(np.asarray(old.time_s)))
    return out.with_columns(time_s=end + PAUSE_S + cycle_of(out, setup).times()[0])

"""Plans made for a purpose: which positions and touches identify given errors, in least time.

Candidates are the touches that keep clear at positions of the rotary axes every 30°. They are
chosen one at a time by what each gains a second, then exchanged while that helps. The criterion is
A (the sum of the variances of the errors asked for, µm² and arcsec² alike) or D (the determinant
of their covariance, which knows no units), with everything else that is unknown estimated beside
them. A plan repeated k times has a k-th of the variances: without a limit the plan is the one of
least criterion × time, the shortest way to any uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, positive, whole, within
from trunnion.base.errors import DataError, InputError, TrunnionError
from trunnion.base.statistics import LinearFit, linear_fit
from trunnion.base.units import Floats, Integers
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import in_words, named_combination
from trunnion.probing.model import TouchModel, known_sigma_um, stops_of
from trunnion.probing.plan import plan
from trunnion.probing.steps import cycle_of, in_ranges
from trunnion.setup import Setup
from trunnion.setup.names import canonical_error_name

Criterion = Literal["A", "D"]

TURNS_DEG = tuple(float(c) for c in range(0, 360, 30))
TILTS_DEG = (-90.0, -60.0, -30.0, 30.0, 60.0, 90.0)
PAIRED_DEG = ((-60.0, -30.0, 30.0, 60.0), (45.0, 90.0, 180.0, 270.0))
UNKNOWN_STDS = (10.0, 100.0, 1000.0)
"""µm, arcsec: what is unknown of each parameter before the first touch, in turns of the search.
Where nothing at all is known, one touch alone gains nothing: its partner is missing."""
MAX_TOUCHES = 1000
PATIENCE = 30
"""Touches without a better plan after which no further is tried."""
MAX_EXCHANGES = 60
IDENTIFIED, UNIDENTIFIED = 0.3, 1e6
"""Share of what is unknown beforehand below which an error is identified; factor of the objective
where one is not."""
MIN_GAIN = 1e-4
"""Share of the objective below which an exchange is not worth its while."""


@checked
def plan_for(
    setup: Setup,
    errors: Sequence[str],
    *,
    criterion: Criterion = "A",
    max_minutes: float | None = None,
    max_touches: int | None = None,
    feed_mm_min: float = 600.0,
) -> Touches:
    """Plan the touches that identify these location errors best, in the shortest time.

    Parameters
    ----------
    setup
        Machine, artefact, probe; the ranges of ``[axes]`` and the times of ``[plan]`` and
        ``[control]`` count.
    errors
        Location errors, ``("EA0A", "EB0C")``; the others and the placement are unknown as well.
    criterion
        "A": least sum of their variances, µm² and arcsec² alike; "D": least determinant of their
        covariance.
    max_minutes, max_touches
        Limits of the program's time (:func:`probing_program`) and of the touches; the plan is then
        the best within them. Without a limit it is the one whose repetition gains most a minute.
    feed_mm_min
        Feed of the approaches.

    Returns
    -------
    Touches
        A plan, as :func:`plan` makes it.

    Raises
    ------
    InputError
        No errors, a limit that is no positive number, limits within which nothing is identified.
    UnknownNameError
        A location error that the machine lacks.
    DataError
        No touch that can be reached identifies one of the errors.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> plan = tn.plan_for(setup, ("EX0C",), max_touches=12)
    >>> len(plan)
    12
    """
    chain = Chain(setup)
    where = f"errors of machine {setup.machine.name}"
    named = [choose(where, canonical_error_name(name), chain.location_errors) for name in errors]
    if not named:
        raise InputError("errors: got none, expected location errors, ('EA0A', 'EB0C')")
    most = MAX_TOUCHES if max_touches is None else whole("max_touches", max_touches, 1, MAX_TOUCHES)
    limit_s = np.inf if max_minutes is None else 60.0 * positive("max_minutes", max_minutes)
    pool = candidates(setup, positive("feed_mm_min", feed_mm_min))
    search = _Search.of(pool, setup, named)
    is_limited = max_touches is not None or max_minutes is not None
    chosen = search.found(most, limit_s, is_limited)
    if is_limited:  # what may be left out of the plan without limits is another beginning
        whole_plan = search.found(MAX_TOUCHES, np.inf, is_limited=False)
        chosen = search.better(chosen, search.pruned(whole_plan, most, limit_s), most, limit_s)
    # Where an error is not identified as yet, a determinant says little.
    if criterion == "D":
        search = replace(search, criterion="D", unknown_std=UNKNOWN_STDS[-1])
        chosen = search.improved(chosen, most, limit_s, is_limited)
    made = ordered(pool[np.array(chosen, dtype=np.intp)], setup)
    while len(made) > 1 and cycle_of(made, setup).times()[1] > limit_s:
        chosen = search.without_least(chosen)
        made = ordered(pool[np.array(chosen, dtype=np.intp)], setup)
    if left := not_identified(_fit(made, setup), TouchModel(setup), named):
        raise InputError(
            f"max_minutes, max_touches: got a limit of {len(made)} touches, expected more: no plan "
            f"was found within it that identifies {', '.join(left)}"
        )
    return made.with_columns(time_s=cycle_of(made, setup).times()[0])


@checked
def plan_by_axis(
    setup: Setup, positions: int = 3, *, reach_deg: float = 60.0, feed_mm_min: float = 600.0
) -> Touches:
    """Plan touches at a few positions of each rotary axis, the other one at rest.

    As the cycles of controls measure a sphere on the table (Siemens CYCLE996 at three positions of
    each axis, Heidenhain KinematicsOpt, Renishaw AxiSet); any artefact will do.

    Parameters
    ----------
    setup
        Machine, artefact and probe.
    positions
        How many of each axis, from 2: all around for the one that turns the work, from end to end
        for the one that tilts.
    reach_deg
        Ends of the tilting axis, both ways from where the table faces the tool.
    feed_mm_min
        Feed of the approaches.

    Returns
    -------
    Touches
        A plan, as :func:`plan` makes it.

    Raises
    ------
    InputError
        Fewer than two positions, a reach that is no angle up to 180°.

    Examples
    --------
    >>> import trunnion as tn
    >>> ball = tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(60.0, 0.0, 80.0))
    >>> plan = tn.plan_by_axis(tn.Setup(ball))
    >>> sorted(set(plan.c_deg.round().tolist())), sorted(set(plan.a_deg.round().tolist()))
    ([0.0, 120.0, 240.0], [-60.0, 0.0, 60.0])
    """
    count = whole("positions", positions, 2, MAX_TOUCHES)
    reach = within("reach_deg", reach_deg, 0.0, 180.0, "deg")
    chain = Chain(setup)
    turns = tuple(float(c) for c in np.arange(count) * 360.0 / count)
    tilts = tuple(float(t) for t in _level(chain) + np.linspace(-reach, reach, count))
    arguments = _angles(chain, turns, tilts)
    return plan(setup, feeds_mm_min=(feed_mm_min,), **arguments)  # type: ignore[arg-type]


def candidates(setup: Setup, feed_mm_min: float = 600.0) -> Touches:
    """Return every touch that keeps clear, at positions of the rotary axes every 30 degrees.

    Raises DataError: none stays within the ranges of the axes.
    """
    chain = Chain(setup)
    free = {letter: replace(x, range_mm=None, range_deg=None) for letter, x in setup.axes.items()}
    level = _level(chain)
    pairs = [(level + t, c) for t in PAIRED_DEG[0] for c in PAIRED_DEG[1]]
    made = plan(
        replace(setup, axes=free),
        feeds_mm_min=(feed_mm_min,),
        positions_deg=pairs if chain.tilting and chain.turning else (),
        all_faces=True,
        **_angles(chain, TURNS_DEG, tuple(level + t for t in TILTS_DEG)),  # type: ignore[arg-type]
    )
    made = made[in_ranges(made, setup)]
    if not len(made):
        raise DataError("no touch of the artefact stays within the ranges of [axes] in the set-up")
    return made


def _level(chain: Chain) -> float:
    """Position of the tilting axis, as the control counts, at which the table faces the tool."""
    if chain.tilting is None:
        return 0.0
    return float(chain.level_deg * chain.senses[chain.letters.index(chain.tilting)])


def _angles(
    chain: Chain, turns: Sequence[float], tilts: Sequence[float]
) -> dict[str, Sequence[float]]:
    """Arguments of :func:`plan` for positions of the axes that there are."""
    given = {chain.turning: turns, chain.tilting: tilts}
    return {f"{letter.lower()}_deg": angles for letter, angles in given.items() if letter}


def ordered(touches: Touches, setup: Setup) -> Touches:
    """Sort by the tilting axis, then the others; senses of turning as the axes then come."""
    chain = Chain(setup)
    tilting = (chain.tilting or "").lower()
    angles = touches.rotary_deg
    first = [angles[x] for x in angles if x != tilting]
    made = touches[np.lexsort([*first, *([angles[tilting]] if tilting in angles else [])])]
    senses = {f"{x}_dir": _senses(v, x == tilting) for x, v in made.rotary_deg.items()}
    return made.with_columns(**senses)


def _senses(angles: Floats, goes_straight: bool) -> Integers:
    """Sense of the last turn: straight there, or always the positive one once it has turned."""
    way = np.sign(np.diff(angles, prepend=0.0))
    turned = np.maximum.accumulate(np.where(way != 0, np.arange(len(way)) + 1, 0))
    last = np.where(turned > 0, way[np.maximum(turned - 1, 0)], 0.0)
    found: Integers = (last if goes_straight else np.ones(len(way))).astype(np.intp)
    return found


def missing_positions(touches: Touches, setup: Setup) -> list[str]:
    """Say which positions of the rotary axes would identify what these touches do not.

    Each is tried: the first, of those that add few positions, after which every location error
    is identified, else the one that identifies most of them.
    """
    model = TouchModel(setup)
    before = not_identified(_fit(touches, setup), model, model.error_names)
    if not before:
        return []
    best, advice = before, ""
    for text, arguments in _trials(setup):
        try:
            more = plan(setup, all_faces=True, **arguments)
        except TrunnionError:  # out of reach, or of the range of an axis
            continue
        left = not_identified(_fit(touches, setup, more), model, before)
        if len(left) < len(best):
            best, advice = left, text
        if not left:
            break
    names = ", ".join(before)
    if not advice:
        reachable = "no position that is tried with this artefact identifies them"
        return [f"This plan does not identify {names}: {reachable}."]
    rest = f", which leaves {', '.join(best)}" if best else ""
    return [f"This plan does not identify {names}: add {advice}{rest}."]


def _trials(setup: Setup) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield what may be missing, few positions at first: in words, and as arguments of a plan."""
    chain = Chain(setup)
    turning, tilting, level = chain.turning, chain.tilting, _level(chain)
    turns = (0.0, 90.0, 180.0, 270.0)
    around = f"{turning} = 0, 90, 180, 270°"
    if turning:
        yield around, _angles(chain, turns, ())
    for tilt in (60.0, 90.0, 30.0) if tilting else ():
        both = (level + tilt, level - tilt)
        # One of them alone where an axis tilts further to one side.
        for tilts in (both, both[:1], both[1:]):
            said = ", ".join(f"{each:g}" for each in tilts)
            text = f"{tilting} = {said if level or len(tilts) == 1 else f'±{tilt:g}'}°"
            yield text, _angles(chain, (), tilts)
            if turning:
                yield f"{text} and {around}", _angles(chain, turns, tilts)
                pairs = [(t, c) for t in tilts for c in turns]
                yield f"{text} at {around}", {**_angles(chain, (), ()), "positions_deg": pairs}


def _fit(touches: Touches, setup: Setup, more: Touches | None = None) -> LinearFit:
    """Return what touches, and those of another plan, identify."""
    model = TouchModel(setup)
    rows = [t for t in (touches, more) if t is not None]
    jacobian = np.vstack([model.core.linearise(model.moves(t), model.values())[1] for t in rows])
    return linear_fit(jacobian, np.zeros(len(jacobian)), hold=~model.unknown)


def not_identified(fit: LinearFit, model: TouchModel, names: Sequence[str]) -> list[str]:
    """Names of those that are not identified."""
    return [name for name in names if np.isinf(fit.std[model.names.index(name)])]


@dataclass(frozen=True, eq=False)
class _Search:
    """Candidates by their rows (divided by the noise, (n, p)), stops and times.

    wanted: Columns asked for.
    touch_s, stop_s: Time of a touch, and of going to another position.
    unknown_std: What is unknown of each parameter before the first touch.
    """

    rows: Floats
    wanted: Integers
    stops: Integers
    touch_s: float
    stop_s: float
    criterion: Criterion = "A"
    unknown_std: float = UNKNOWN_STDS[0]

    @classmethod
    def of(cls, pool: Touches, setup: Setup, names: Sequence[str]) -> _Search:
        """Linearise the candidates, and refuse what none of them identifies."""
        model = TouchModel(setup)
        found = _fit(pool, setup)
        if left := not_identified(found, model, names):
            why = [in_words(named_combination(model.names, row)) for row in found.combinations]
            raise DataError(
                f"errors: got {', '.join(left)}, expected such as touches of this artefact can "
                f"identify: no position that it can be touched in does. {' '.join(why)}"
            )
        _, jacobian = model.core.linearise(model.moves(pool), model.values())
        stops = stops_of(pool)
        steps = np.diff(np.asarray(pool.time_s))
        turns = np.diff(stops) != 0
        touch_s = float(np.median(steps[~turns])) if not turns.all() else float(np.median(steps))
        stop_s = max(float(np.median(steps[turns])) - touch_s, 0.0) if turns.any() else 0.0
        unknown = list(model.unknown_names)
        return cls(
            rows=jacobian[:, model.unknown] / (known_sigma_um(setup, pool) or 1.0),
            wanted=np.array([unknown.index(name) for name in names]),
            stops=stops,
            touch_s=touch_s,
            stop_s=stop_s,
        )

    def covariance(self, chosen: Sequence[int]) -> Floats:
        """Covariance of all unknowns, (p, p)."""
        x = self.rows[list(chosen)]
        beforehand = np.eye(x.shape[1]) / self.unknown_std**2
        return np.asarray(np.linalg.inv(x.T @ x + beforehand), dtype=np.float64)

    def value(self, covariance: Floats) -> float:
        """Criterion of a covariance, a variance."""
        own = covariance[np.ix_(self.wanted, self.wanted)]
        if self.criterion == "A":
            return float(np.trace(own))
        return float(np.exp(np.linalg.slogdet(own)[1] / len(own)))

    def after(self, covariance: Floats, sign: float) -> Floats:
        """Criterion after each candidate is added (sign 1) or taken away (-1), (n,)."""
        moved = self.rows @ covariance
        spread = 1.0 + sign * np.einsum("ij,ij->i", moved, self.rows)
        spread = np.maximum(spread, 1e-12)
        own = moved[:, self.wanted]
        if self.criterion == "A":
            less = np.sum(own**2, axis=1) / spread
            return np.asarray(self.value(covariance) - sign * less, dtype=np.float64)
        inverse = np.linalg.inv(covariance[np.ix_(self.wanted, self.wanted)])
        share = 1.0 - sign * np.einsum("ij,jk,ik->i", own, inverse, own) / spread
        found = self.value(covariance) * np.maximum(share, 0.0) ** (1 / len(inverse))
        return np.asarray(found, dtype=np.float64)

    def seconds(self, chosen: Sequence[int]) -> float:
        """Time of some candidates, about."""
        return self.touch_s * len(chosen) + self.stop_s * len(set(self.stops[list(chosen)]))

    def objective(self, value: float, seconds: float, is_limited: bool) -> float:
        """What is to be small: the criterion within limits, else criterion × time."""
        return value if is_limited else value * seconds

    def more_s(self, chosen: Sequence[int]) -> Floats:
        """Time that each candidate adds, (n,)."""
        is_new = ~np.isin(self.stops, self.stops[list(chosen)])
        return np.asarray(self.touch_s + self.stop_s * is_new, dtype=np.float64)

    def grown(self, most: int, limit_s: float, is_limited: bool) -> list[int]:
        """Add the candidate that gains most a second, up to the limits or the best objective."""
        chosen: list[int] = []
        best: tuple[float, list[int]] = (np.inf, [])
        while len(chosen) < min(most, len(self.rows)):
            covariance = self.covariance(chosen)
            cost = self.more_s(chosen)
            gain = np.log(self.value(covariance) / np.maximum(self.after(covariance, 1.0), 1e-300))
            worth = gain / cost
            worth[chosen] = -np.inf
            if not is_limited or np.isfinite(limit_s):
                worth[self.seconds(chosen) + cost > limit_s] = -np.inf
            else:  # touches are what is scarce
                worth = np.where(np.isfinite(worth), gain, -np.inf)
            if not np.isfinite(worth.max()):
                break
            chosen.append(int(np.argmax(worth)))
            value = self.value(self.covariance(chosen))
            found = self.objective(value, self.seconds(chosen), is_limited)
            if found < best[0]:
                best = (found, list(chosen))
            if len(chosen) - len(best[1]) >= PATIENCE:
                break
        return best[1]

    def found(self, most: int, limit_s: float, is_limited: bool) -> list[int]:
        """Add touches, then exchange them, as if ever less were known beforehand."""
        chosen = self.grown(most, limit_s, is_limited)
        for unknown_std in UNKNOWN_STDS:
            search = replace(self, unknown_std=unknown_std)
            chosen = search.improved(chosen, most, limit_s, is_limited)
        return chosen

    def pruned(self, chosen: list[int], most: int, limit_s: float) -> list[int]:
        """Leave out what is missed least until the limits hold."""
        search = replace(self, unknown_std=UNKNOWN_STDS[-1])
        while len(chosen) > 1 and (len(chosen) > most or self.seconds(chosen) > limit_s):
            chosen = search.without_least(chosen)
        return chosen

    def better(self, one: list[int], other: list[int], most: int, limit_s: float) -> list[int]:
        """The better of two within limits, the second one after exchanges."""
        search = replace(self, unknown_std=UNKNOWN_STDS[-1])
        other = search.improved(other, most, limit_s, is_limited=True)
        return min((one, other), key=lambda x: search.value(search.covariance(x)))

    def improved(self, chosen: list[int], most: int, limit_s: float, is_limited: bool) -> list[int]:
        """Leave out, add or exchange one touch at a time while that helps."""

        def score(touches: list[int]) -> float:
            covariance = self.covariance(touches)
            found = self.objective(self.value(covariance), self.seconds(touches), is_limited)
            worst = float(np.sqrt(covariance[self.wanted, self.wanted].max()))
            return found * (1.0 if worst < IDENTIFIED * self.unknown_std else UNIDENTIFIED)

        best = score(chosen)
        for _ in range(MAX_EXCHANGES):
            trials = [[x for x in chosen if x != out] for out in chosen]
            trials += [[x for x in chosen if self.stops[x] != s] for s in set(self.stops[chosen])]
            trials = [trial for trial in trials if trial]
            grown = [t for t in (self._added(rest, limit_s, is_limited) for rest in trials) if t]
            if len(chosen) < most and (one := self._added(chosen, limit_s, is_limited)):
                grown.append(one)
            found = min([*grown, *trials], key=score, default=chosen)
            if score(found) > best * (1.0 - MIN_GAIN):
                break
            chosen, best = found, score(found)
        return chosen

    def _added(self, chosen: list[int], limit_s: float, is_limited: bool) -> list[int] | None:
        """The touches with the best further one; None: none within the limit."""
        values = self.after(self.covariance(chosen), 1.0)
        seconds = self.seconds(chosen) + self.more_s(chosen)
        scores = values if is_limited else values * seconds
        scores[chosen] = np.inf
        scores[seconds > limit_s] = np.inf
        best = int(np.argmin(scores))
        return [*chosen, best] if np.isfinite(scores[best]) else None

    def without_least(self, chosen: list[int]) -> list[int]:
        """The touches without the one that is missed least."""
        values = self.after(self.covariance(chosen), -1.0)
        least = min(chosen, key=lambda x: values[x])
        return [x for x in chosen if x != least]

"""Structure without a name, and the recorded quantity that it depends on.

A dictionary of *terms*, each a few columns: a function of one covariate (harmonics, polynomials,
waves of unknown length, a jump, a local error, a class of its own) times one component by which a
disturbance can enter the readings. A term is no cause. It says that something is there, and what it
goes with.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from scipy import special

from trunnion.base.rows import seen_of
from trunnion.base.statistics import MANY_ROWS, Spanned
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.columns import ROUNDING, storage
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.functions import DEPENDENT, Made, Part
from trunnion.diagnosis.functions_of import Shown, functions_of
from trunnion.diagnosis.gains import gains_beside
from trunnion.diagnosis.jumps import best_between, best_near, fine_places, near
from trunnion.diagnosis.local_errors import between, likeliest, local
from trunnion.diagnosis.model import Covariate, Model
from trunnion.diagnosis.of_some import OfSome
from trunnion.diagnosis.quantities import Said, at_an_instant, in_measurement, saying
from trunnion.diagnosis.smooth import over_range
from trunnion.diagnosis.term import Place, Term
from trunnion.diagnosis.waves import WAVES_BETWEEN, waves
from trunnion.diagnosis.ways import is_angle
from trunnion.diagnosis.whitening import Scaling, Whiten, identity, sizes_of, within

AMONG_PLACES = np.linspace(-0.25, 0.25, 17)  # waves: finer, beside a cause of many columns
SCAN_LEVEL = 0.01
UNNAMED_TERM_PENALTY = 10.0  # a term has to explain exp(5) times better than causes do


@dataclass(frozen=True)
class _Terms:
    """Terms of one kind of a covariate, ``first`` and next ones: each number in all ways."""

    first: int
    covariate: Covariate
    kind: str
    numbers: Sequence[object]
    ways: Sequence[str]

    def __len__(self) -> int:
        return len(self.numbers) * len(self.ways)

    def term(self, number: int) -> Term:
        """Return one of them."""
        at, way = divmod(number, len(self.ways))
        v = self.covariate
        return Term(v.name, self.kind, self.numbers[at], self.ways[way], v.unit)


class Dictionary:
    """All terms of a model's covariates and components, for some of its readings.

    Time and memory are linear in readings: a covariate of classes has at most
    ``MAX_CLASSES`` terms.

    model, rows: Whose covariates, and which readings.
    whiten: Applied to the columns, which have unit length afterwards.
    known: Dictionary with other weights, whose functions serve again where they are the same.

    quantities: What each covariate says, of few readings of each measurement; else None.
    count: Of the terms. Those in all components at once are numbered after them: what disturbs a
        machine rarely does so along one axis.
    """

    def __init__(
        self,
        model: Model,
        rows: Integers,
        whiten: Whiten = identity,
        known: "Dictionary | None" = None,
    ) -> None:
        self._begin(model, rows, whiten)
        if known is not None and known._serves(model, rows, whiten):
            self._said, self.count, self.quantities = known._said, known.count, known.quantities
            self._hidden = known._hidden
            for made in known._made:
                self._keep(made)
        else:
            self._say()
        longest = max((part.longest for part in self._parts), default=0.0)
        for part in self._parts:
            part.store(storage(self._numbers))
            part.complete(ROUNDING * longest)

    @classmethod
    def of_all(cls, model: Model, whiten: Whiten, known: "Dictionary | None") -> "Dictionary":
        """Return the terms of all readings: the known ones, if they are of these."""
        rows = np.arange(len(model.readings))
        if known is None or not (known._of(model, rows) and whiten is known._whiten):
            return cls(model, rows, whiten, known)
        return known

    @classmethod
    def joined(
        cls, model: Model, whiten: Whiten, parts: Sequence[tuple[slice, "Dictionary"]]
    ) -> "Dictionary":
        """Return the terms of several measurements, which are below each other in a model.

        ``parts``: of each its readings there, and its own terms, of the same covariates.
        """
        new = object.__new__(cls)
        new._begin(model, np.arange(len(model.readings)), whiten)
        first = 0  # of the covariates of a part
        every = list[Said]()
        for at, own in parts:
            place = {v.name: i for i, v in enumerate(own._covariates, start=first)}
            first += len(own._covariates)
            for said in own._said:
                v = new._covariates[place[said.covariate.name]]
                new._said.append(replace(said, first=new.count + said.first, covariate=v))
            new._parts += [part.among(new.count, at.start) for part in own._parts]
            new._hidden = np.concatenate([new._hidden, new.count + own._hidden])
            new.count += own.count
            for x in own.quantities or ():
                some = slice(at.start + x.some.start, at.start + x.some.stop)
                v = new._covariates[place[x.covariate.name]]
                every.append(x._replace(covariate=v, some=some))
        new.quantities = every if all(own.quantities is not None for _, own in parts) else None
        return new

    def within(self, readings: Sequence[slice]) -> "Dictionary":
        """Return the same of which only terms of some measurements gain, by their readings."""
        new, starts = copy(self), {at.start for at in readings}
        new._parts = [part for part in self._parts if part.some.start in starts]
        new._beside, new._known = None, {}
        return new

    def _begin(self, model: Model, rows: Integers, whiten: Whiten) -> None:
        """Have no terms."""
        self._model, self._rows, self._whiten = model, rows, whiten
        self._said, self._parts, self._by_ways, self._made = [], [], {}, []
        self._covariates = tuple(model.covariates)
        self._beside: tuple[Floats, list[list[Floats]]] | None = None
        self._known: dict[int, tuple[Fit, Floats, Integers]] = {}
        self._hidden = np.zeros(0, dtype=np.intp)

    count = 0
    quantities: Sequence[Said] | None = None
    _said: list[_Terms]
    _parts: list[Part]
    _by_ways: dict[tuple[int, tuple[int, ...]], Part]
    _made: list[Made]  # of which these parts consist
    _numbers = 0  # of all functions that are kept
    _hidden: Integers  # waves and local errors that the readings do not show

    @property
    def terms(self) -> list[Term]:
        """What each block of columns stands for; :meth:`term` makes one of them."""
        return [said.term(number) for said in self._said for number in range(len(said))]

    @cached_property
    def at_once(self) -> list[tuple[int, ...]]:
        """Terms of one component each that together are one function in all components.

        Of a size of its own in each. None where an instant has one reading, as of a touch.
        """
        out: list[tuple[int, ...]] = []
        components, known = self._model.components, dict[tuple[str, ...], list[tuple[int, ...]]]()
        for said in self._said:
            key = said.covariate.name, *said.ways
            if key not in known:
                known[key] = at_an_instant(said.covariate, said.ways, components)
            firsts = range(said.first, said.first + len(said), len(said.ways))
            out += [tuple(first + i for i in own) for own in known[key] for first in firsts]
        return out

    def in_each(self, term: int) -> tuple[int, ...]:
        """Terms of one component each that a term consists of."""
        return (term,) if term < self.count else self.at_once[term - self.count]

    def term(self, number: int) -> Term:
        """What a block of columns stands for."""
        if number >= self.count:
            each = [self.term(i) for i in self.in_each(number)]
            return replace(each[0], component=" and ".join(x.component for x in each))
        said = next(x for x in reversed(self._said) if x.first <= number)
        return said.term(number - said.first)

    def of_kind(self, kind: str) -> Integers:
        """Numbers of the terms of a kind, ascending."""
        some = [np.arange(x.first, x.first + len(x)) for x in self._said if x.kind == kind]
        return np.concatenate(some) if some else np.zeros(0, dtype=np.intp)

    def _say(self) -> None:
        """Make the functions of all covariates, and keep them."""
        every = saying(self._covariates, self._model.components, self._rows)
        if len(self._rows) < MANY_ROWS:
            self.quantities = list(every)
        for x in self.quantities or every:
            v = x.covariate
            has = None if v.known is None else v.known[self._rows[x.some]]
            all_ways = list(x.enter)[:1] if v.classes else list(x.enter)
            shown = Shown(x, all_ways)
            for functions, terms in functions_of(x, has):
                ways = all_ways
                if not v.classes and terms[0].kind == "class":
                    ways = [way for way in all_ways if is_angle(way)]
                if not len(functions) or not ways:  # no reading shows an angle
                    continue
                first = {}
                for some in terms:
                    self._said.append(_Terms(self.count, v, some.kind, some.numbers, ways))
                    first[some.width] = self.count
                    own = self.count + shown.hidden(some)
                    self._hidden = np.concatenate([self._hidden, own])
                    self.count += len(self._said[-1])
                enter = tuple(x.enter[way] for way in ways)
                self._keep(Made(functions, first, enter, x.some))

    def _serves(self, model: Model, rows: Integers, whiten: Whiten) -> bool:
        """Whether the functions are those of a dictionary with these weights."""
        weights = whiten is identity or isinstance(whiten, Scaling)
        return weights and self._of(model, rows) and bool(self._made)

    def _of(self, model: Model, rows: Integers) -> bool:
        """Whether the terms are of these readings."""
        return model is self._model and np.array_equal(rows, self._rows)

    def _keep(self, made: Made) -> None:
        """Keep terms in the part of their readings and ways, in the precision for so many."""
        key = made.some.start, tuple(map(id, made.ways))
        if key not in self._by_ways:
            n = len(self._model.readings)
            part = Part(made.ways, made.some, self._rows, n, self._whiten)
            self._by_ways[key] = part
            self._parts.append(part)
        part = self._by_ways[key]
        kind = storage(self._numbers)
        self._numbers += part.add(made, kind)
        again = part.by_reading and kind is np.float64
        self._made = [*self._made, made] if again else []

    @property
    def level(self) -> float:
        """Level at which each term is more than chance: all share one."""
        return SCAN_LEVEL / max(self.count, 1)

    def chance(self, f: Fit) -> Floats:
        """Drop of -2 ln L that each term reaches by chance beside a fit, shape (t,)."""
        return self.chance_of(self.of_fit(f)[1])

    def chance_of(self, rank: Integers) -> Floats:
        """The same of terms that add so many columns, shape (t,)."""
        rank = np.maximum(rank, 1)
        of_rank = special.chdtri(np.arange(1, rank.max(initial=1) + 1), self.level)
        return np.asarray(of_rank[rank - 1], dtype=np.float64)

    def of_fit(self, f: Fit) -> tuple[Floats, Integers]:
        """Gains and ranks of all terms for the residuals of a fit (kept), shapes (t,)."""
        known = self._known.get(id(f))
        if known is None:
            known = self._known[id(f)] = (f, *self.gains(f.white, f.basis))
        return known[1], known[2]

    def gains(
        self, r: Floats, basis: Floats, sums: Floats | None = None
    ) -> tuple[Floats, Integers]:
        """Gain in RSS of every term alone, and how many columns it adds.

        ``r``: residuals (n,), or many of them (n, s), orthogonal to ``basis`` (n, q), which holds
        all that is fitted; ``sums``: of those with these weights (s, m) instead. Shapes (t,) or
        (t, s), and (t,).
        """
        several = r.reshape(len(r), -1)
        count = several.shape[1] if sums is None else sums.shape[1]
        gain = np.zeros((self.count, count))
        rank = np.zeros(self.count, dtype=np.intp)
        known = self._beside if self._beside is not None and self._beside[0] is basis else None
        both = np.concatenate([basis, several], axis=1) if known is None else several
        products = [part.products(both) for part in self._parts]
        if known is None:
            width = basis.shape[1]
            acting = [np.flatnonzero(seen_of(basis[part.some])) for part in self._parts]
            own_of = zip(products, acting, strict=True)
            known = self._beside = basis, [[x[:, some] for x in own] for own, some in own_of]
            products = [[x[:, width:] for x in own] for own in products]
        for part, taken, along in zip(self._parts, known[1], products, strict=True):
            for x, t, z in zip(part.wide, taken, along, strict=True):
                own = z if sums is None else z @ sums
                gain[x.numbers], rank[x.numbers] = x.gains(t, own)
        gain[self._hidden], rank[self._hidden] = 0.0, 0
        return gain[:, 0] if r.ndim == 1 else gain, rank

    def block(self, term: int) -> Floats:
        """Columns of a term, shape (n, k)."""
        own = self.own_block(term)
        out = np.zeros((len(self._rows), own.shape[1]))
        out[self.readings(term)] = own
        return out

    def readings(self, term: int) -> slice:
        """Which readings of the dictionary a term is of: in others all is 0."""
        return in_measurement(self._along(self.term(term)), self._rows)

    def variants(self, term: int, places: Sequence[Place] = ()) -> Floats | OfSome:
        """Columns of a term, shape (v, n, k); those between the terms of the scan, too.

        ``places``: further ones of a jump or a local error.

        What a wave leaves of one a quarter of a period longer over the range would be explained by
        causes that are not there, and so would what a local error or a jump leaves of one beside
        it. Waves in places have causes of their own, of any length, but where these have sizes of
        their own in each class of readings.
        """
        own, at = self._variants(term, places), self.readings(term)
        return own if at == slice(0, len(self._rows)) else OfSome(own, at)

    def own_block(self, term: int) -> Floats:
        """Columns of a term, of its own readings only, (m, k)."""
        if term >= self.count:
            return np.concatenate([self.own_block(i) for i in self.in_each(term)], axis=1)
        found = (part.block(term) for part in self._parts)
        return next(x for x in found if x is not None)

    def _variants(self, term: int, places: Sequence[Place] = ()) -> Floats:
        """Columns of variants of a term, of its own readings only, (v, m, k)."""
        if term >= self.count:
            return np.concatenate([self._variants(i) for i in self.in_each(term)], axis=2)
        of = self.term(term)
        along = self._along(of)
        named = not along.sequence and all(e.spread is None for e in self._model.effects)
        if of.kind not in ("local", "jump") and (of.kind != "wave" or named):
            return self.own_block(term)[None]
        values = self._values(along)
        own = self._distinct(along)
        low, high = own[0], own[-1]
        if of.kind == "jump":
            about = near(own, float(str(of.number)))
            return self._jumps(of, np.unique([*about, *cast("Sequence[float]", places)]))
        if of.kind == "local":
            further = cast("Sequence[tuple[float, float]]", places)
            return self._local(of, *between(*of.place_and_width, further))
        counts = (high - low) / float(str(of.number))
        counts = counts + (WAVES_BETWEEN if along.sequence else AMONG_PLACES)
        columns = waves(np.pi * counts, over_range(values, low, high)).transpose(1, 0, 2)
        return self._white(of, along, columns)

    def _local(self, of: Term, places: Floats, widths: Floats) -> Floats:
        """Columns of a local error at places, of widths, of its own readings only, (v, m, 1)."""
        along = self._along(of)
        columns = local(self._values(along), places[:, None], widths[:, None], along.period)
        return self._white(of, along, columns[:, None])

    def _along(self, of: Term) -> Covariate:
        """Return the quantity of a term."""
        return next(v for v in self._covariates if v.name == of.covariate)

    def _acting(self, along: Covariate) -> Integers:
        """Those of the readings that have a quantity."""
        return self._rows if along.known is None else self._rows[along.known[self._rows]]

    def _values(self, along: Covariate) -> Floats:
        """Values of a quantity in the readings of its measurement, (m,)."""
        rows = self._rows[in_measurement(along, self._rows)]
        return np.asarray(along.values, dtype=np.float64)[rows]

    def _distinct(self, along: Covariate) -> Floats:
        """Different values of a quantity in the readings that have it, ascending."""
        return np.unique(np.asarray(along.values, dtype=np.float64)[self._acting(along)])

    def _jumps(self, of: Term, places: Floats) -> Floats:
        """Columns of a jump at some places, of its own readings only, (v, m, 1)."""
        along = self._along(of)
        behind = self._values(along) >= places[:, None]
        return self._white(of, along, behind.astype(np.float64)[:, None])

    def _gains_of_jumps(
        self, of: Term, r: Floats, basis: Floats | Spanned
    ) -> Callable[[Floats], Floats]:
        """Gains (t,) of a jump at some places (t,), for residuals (n,)."""
        at = in_measurement(self._along(of), self._rows)
        basis, r = basis[at], r[at]
        return lambda places: gains_beside(self._jumps(of, places), basis, r)

    def _white(self, of: Term, along: Covariate, columns: Floats) -> Floats:
        """White columns (v, m, k) of unit length of functions of a quantity (v, k, m)."""
        rows = self._rows[in_measurement(along, self._rows)]
        if of.component:
            columns = columns * np.asarray(self._model.components[of.component])[rows]
        if along.known is not None:
            columns = columns * along.known[rows]
        if self._sizes is not None and not np.any(np.isnan(self._sizes[rows])):
            white = columns / self._sizes[rows]
        elif (own := within(self._whiten, rows)) is not None:
            white = np.asarray(own(columns.transpose(2, 0, 1))).transpose(1, 2, 0)
        else:
            every = np.zeros((len(self._model.readings), *columns.shape[:2]))
            every[rows] = columns.transpose(2, 0, 1)
            white = np.asarray(self._whiten(every))[rows].transpose(1, 2, 0)
        size = np.linalg.norm(white, axis=2, keepdims=True)
        return np.asarray((white / np.where(size > 0, size, 1.0)).transpose(0, 2, 1))

    @cached_property
    def _sizes(self) -> Floats | None:
        """By what each of the model's readings is divided, as of :func:`.whitening.sizes_of`."""
        return sizes_of(self._whiten, len(self._model.readings))

    def placed(self, term: int, f: Fit) -> tuple[Term, float]:
        """What a term stands for, and its gain beside a fit; a jump is where it gains most."""
        of = self.term(term)
        if of.kind != "jump":
            return of, float(self.of_fit(f)[0][term])
        place, gain = self.place_of_jump(term, f.white, f.basis)
        return replace(of, number=place), gain

    def place_of_jump(self, term: int, r: Floats, basis: Floats) -> tuple[float, float]:
        """Place between its neighbours where a jump gains most, for residuals (n,); the gain."""
        of = self.term(term)
        gains = self._gains_of_jumps(of, r, basis)
        return best_near(self._distinct(self._along(of)), float(str(of.number)), gains)

    def place_of_local(
        self, term: int, r: Floats, basis: Floats | Spanned, least: float
    ) -> tuple[tuple[float, float], float]:
        """Place and width near a term where a local error gains most, for residuals (n,); gain.

        ``least``: of one that gains less neither is exact.
        """
        of, at = self.term(term), self.readings(term)
        own, left = basis[at], r[at]

        def gains(places: Floats, widths: Floats) -> Floats:
            return gains_beside(self._local(of, places, widths), own, left)

        return likeliest(*of.place_and_width, gains, least)

    def best_jumps(
        self, r: Floats, basis: Floats | Spanned, among: Flags
    ) -> Iterator[tuple[int, float]]:
        """Jump of each quantity in each component that gains most, for residuals (n,).

        The term of the scan that is nearest, and the place of the jump. ``among``: readings of
        which one at least has the quantity, (n,) of the model.
        """
        for x in (x for x in self._said if x.kind == "jump"):
            if not np.any(among[self._acting(x.covariate)]):
                continue
            own = self._distinct(x.covariate)
            scanned, some = np.asarray(x.numbers, dtype=np.float64), fine_places(own, len(r))
            for way in range(len(x.ways)):
                gains = self._gains_of_jumps(x.term(way), r, basis)
                best = int(np.argmax(gains(own[some])))
                low, high = some[max(best - 1, 0)], some[min(best + 1, len(some) - 1)]
                place, _ = best_between(own, int(low), int(high), gains)
                near_it = int(np.argmin(np.abs(scanned - place)))
                yield x.first + near_it * len(x.ways) + way, place

    def refined(self, gain: Floats, r: Floats, basis: Floats, sums: Floats | None = None) -> Floats:
        """Gains (t, s) as of :meth:`gains`, that of the best local error at its best variant.

        Of a large one its neighbours of the scan leave more than many causes do.
        """
        those = self.of_kind("local")
        if not len(those):
            return gain
        gain = gain.copy()
        best = those[np.argmax(gain[those], axis=0)]
        for term in np.unique(best).tolist():
            own = np.flatnonzero(best == term)
            columns, at = self._variants(term)[:, :, 0], self.readings(term)
            square = np.sum(columns**2, axis=1) - np.sum((columns @ basis[at]) ** 2, axis=1)
            along = columns @ (r[at][:, own] if sums is None else r[at] @ sums[:, own])
            most = np.max(along**2 / np.maximum(square, DEPENDENT)[:, None], axis=0)
            gain[term, own] = np.maximum(gain[term, own], most)
        return gain

"""The causes of a diagnosis in the words of a report: one size and one probability for each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trunnion.base.report import Cell, Shown, Table, rough
from trunnion.base.units import ARCSEC, Floats, capital, parameter_words, unit_of
from trunnion.data.positioning import Positioning
from trunnion.diagnosis.families import EITHER, OWNED, RADIUS_MM, Family, family_of, meaning
from trunnion.diagnosis.records import Cause, percent, value_in_words
from trunnion.diagnosis.result import Diagnosis
from trunnion.machine.effects import Owner
from trunnion.plot.diagnosis import MAX_PARAMETERS, Explained, root_of
from trunnion.reports.results import COVERAGE, largest_of, plain_words
from trunnion.setup.names import called, error_label, fitted_in_words

SURE = 0.5  # a probability below it is a doubt
_HARMONIC = re.compile(r"(a|cosine)([xyz]?\d*)(_.+)")
_COEFFICIENT = re.compile(r"a\d+_.+")
_OTHER_HALF = {"a": "b", "cosine": "sine"}
WORDS = {"tau": "time constant", "hx": "along X", "hy": "along Y"}


@dataclass(frozen=True, eq=False)
class Found:
    """What a diagnosis found, cause by cause."""

    d: Diagnosis

    @cached_property
    def owners(self) -> Mapping[str, Owner]:
        """What each cause belongs to."""
        d = self.d
        known: Mapping[str, Owner] = getattr(d.model, "owners", {})
        if known or d.data is None or not d.causes:
            return known
        return {e.id: e.owner for e in d.rebuilt_model().effects}

    @cached_property
    def certain(self) -> frozenset[str]:
        """Causes that are in every set and more probable than not."""
        d = self.d
        every = frozenset.intersection(*d.alternatives) if d.alternatives else d.named
        return frozenset(c.id for c in d.causes if c.id in every and c.probability > SURE)

    def family(self, id_: str) -> Family:
        """Family of a cause."""
        instead = next((c.instead for c in self.d.causes if c.id == id_), "")
        return family_of(id_, self.owners.get(id_, Owner.MACHINE), instead)

    @property
    def of_machine(self) -> list[Cause]:
        """Causes of the machine, of heat or of the part."""
        return [c for c in self.d.causes if c not in (*self.of_others, *self.of_either)]

    @property
    def of_either(self) -> list[Cause]:
        """Causes of the instrument, or of a machine that is as warm everywhere: not known which."""
        return [c for c in self.d.causes if c.instead]

    @property
    def of_others(self) -> list[Cause]:
        """Causes of the instrument, the artefact or the clamping."""
        return [c for c in self.d.causes if self.family(c.id) in OWNED.values()]

    def label(self, id_: str) -> str:
        """What people call a cause."""
        named = {c.id: c.label for c in self.d.causes}
        return named.get(id_) or self.d.labels.get(id_) or id_.replace("_", " ")

    def quantity(self, name: str) -> str:
        """Say in words what a parameter of a model, or an error, is."""
        id_, dot, parameter = name.partition(".")
        known = {c.id: len(c.parameters) for c in self.d.causes}
        if not dot and name not in known and name not in self.d.labels:
            return fitted_in_words(name)
        alone = not dot or known.get(id_) == 1
        return self.label(id_) if alone else f"{self.label(id_)}, {_in_words(parameter)}"

    def in_words(self, text: str) -> str:
        """Return what is said of effects that readings do not show, without names of programs."""
        ids = {*self.d.labels, *(c.id for c in self.d.causes)}
        words = re.sub(r"\w+", lambda m: self.label(m[0]) if m[0] in ids else m[0], text)
        return plain_words(words)

    def chance(self, id_: str) -> float:
        """Probability of all sets that hold a cause."""
        known = {c.id: c.probability for c in self.d.causes}
        listed = sum(a.probability for a in self.d.evidence if id_ in a.causes)
        return known.get(id_, listed)

    def sized(self, id_: str) -> str:
        """Name a cause with its size, where it is known, and its probability."""
        cause = next((c for c in self.d.causes if c.id == id_), None)
        size = "" if cause is None else f", {self.size(cause)}"
        reserve = "" if cause is None else cause.reserve
        either = "" if cause is None else cause.or_instead
        return f"{self.label(id_)}{either}{size} ({percent(self.chance(id_))}{reserve})"

    def doubtful(self) -> list[list[str]]:
        """Of each set of causes what is not certain, the most probable set first."""
        return [sorted(a.causes - self.certain) for a in self.d.evidence]

    def in_doubt(self, most: int) -> str:
        """Name what is in doubt, each cause once with its probability; of many sets the first.

        A set says what is new in it, and beside which causes that were named.
        """
        sets, named, said = self.doubtful(), [], set[str]()
        for ids in sets[:most]:
            new = [i for i in ids if i not in said]
            if new:
                again = [self.label(i) for i in ids if i in said]
                named.append(" together with ".join([*again, *map(self.sized, new)]))
            said |= set(new)
        if (more := len(sets) - most) > 1:
            named.append(f"one of {more} other sets")
        head = "In doubt" if all(sets) else "Perhaps also"
        return f"{head}: {'; or '.join(named)}."

    def size(self, c: Cause) -> str:
        """Say the size of a cause with U (k = 2)."""
        if not any(map(np.isfinite, c.std_errors.values())):
            return c.size()
        if not _is_curve(c):
            return said(c.parameters, c.std_errors, root_of(self.d, c))
        of, at, most = self._largest(c)
        u = float(np.linalg.norm(of.spread[at]))
        return f"up to {value_in_words(most, COVERAGE * u or None, of.unit)}"

    def _largest(self, c: Cause) -> tuple[Explained, int, float]:
        """Return a cause with the reading that it changes most, and by how much."""
        of = Explained.of(self.d, c.id)
        change = np.abs(of.change) * of.rows
        at = int(np.argmax(change))
        return of, at, float(change[at])

    def meaning(self, c: Cause) -> str:
        """Say what size and sign mean at the machine."""
        data = self.d.data
        travel = None
        if isinstance(data, Positioning) and not data.rotary:
            travel = float(np.ptp(data.target))
        family = self.family(c.id)
        other = family in (*OWNED.values(), EITHER)
        text = "" if other else meaning(c.id, c.parameters, travel)
        if _is_curve(c):
            return text or "not the same at every place: see its picture"
        if text and not family.grows:
            return text
        of, _, most = self._largest(c)
        reach = f"up to {rough(most)} {of.unit} in these readings"
        if any(name.startswith("tau_") for name in c.parameters):
            reach += "; the amplitude is where it would end"
        return f"{text}: {reach}" if text else reach

    @cached_property
    def located(self) -> dict[str, float]:
        """Location errors of the machine, where these data give any."""
        return {k: v for k, v in self.d.errors_after.items() if error_label(k) != k}

    def _largest_errors(self) -> list[tuple[Cell, ...]]:
        """The largest location errors, with what they do."""
        rows: list[tuple[Cell, ...]] = []
        for name, size in largest_of(self.located, self.d.errors_std).items():
            angle = abs(self.located[name]) * ARCSEC if unit_of(name) == "arcsec" else 0.0
            at = f"{rough(1e3 * angle * RADIUS_MM)} µm at a distance of {RADIUS_MM:g} mm"
            rows.append(
                (capital(called(name)), size, at if angle else "so far beside its place", None)
            )
        return rows

    def _chance(self, c: Cause) -> Shown:
        return Shown(c.probability, percent(c.probability))

    def _name(self, c: Cause) -> str:
        doubt = "" if c.id in self.certain else " (in doubt)"
        return capital(self.label(c.id)) + c.or_other + doubt

    def tables(self) -> list[Table]:
        """What was found of the machine, what may be its, then what is not the machine's."""
        heads = ("", f"size ± U (k = {COVERAGE:g})", "what that means", "probability")
        first = self._largest_errors()
        return [
            Table.of(
                title,
                heads,
                [
                    *errors,
                    *(
                        (self._name(c), self.size(c), self.meaning(c), self._chance(c))
                        for c in sorted(causes, key=lambda c: c.id not in self.certain)
                    ),
                ],
            )
            for title, causes, errors in (
                ("What was found", self.of_machine, first),
                ("Found, the instrument's or the machine's", self.of_either, []),
                ("Found beside it, not the machine's", self.of_others, []),
            )
            if causes
        ]


def _is_curve(c: Cause) -> bool:
    """Whether the parameters are coefficients of a curve, which say nothing one by one."""
    names = list(c.parameters)
    lone = [n for n in names if _COEFFICIENT.fullmatch(n) and f"b{n[1:]}" not in names]
    return len(names) > MAX_PARAMETERS or len(lone) > 1


def said(values: Mapping[str, float], std: Mapping[str, float], root: Floats) -> str:
    """Say parameters with U; cosine and sine of a harmonic as its amplitude."""
    names, parts, done = list(values), [], set()
    for k, name in enumerate(names):
        match = _HARMONIC.fullmatch(name)
        other = f"{_OTHER_HALF[match[1]]}{match[2]}{match[3]}" if match else ""
        if match and other in values:
            at = [k, names.index(other)]
            pair = np.array([values[name], values[other]])
            size = float(np.hypot(*pair))
            u = float(np.linalg.norm(pair @ root[at])) / size if size > 0 else std[name]
            known = np.isfinite(std[name]) and np.isfinite(std[other])
            along = match[2].rstrip("0123456789").upper()
            of = f"amplitude in {along}" if along else "amplitude"
            parts.append(f"{of} {_value(size, u if known else np.inf, unit_of(name))}")
            done.add(other)
        elif name not in done:
            text = _value(values[name], std[name], unit_of(name))
            parts.append(text if len(values) == 1 else f"{_in_words(name)} {text}")
    return ", ".join(parts)


def _in_words(parameter: str) -> str:
    words = parameter_words(parameter)
    return WORDS.get(words, words)


def _value(value: float, std: float | None, unit: str) -> str:
    """Say a value with U; one whose place the readings only enclose as it is."""
    if std is not None and not np.isfinite(std) and unit == "mm":
        return f"about {value_in_words(value, None, unit)}"
    return value_in_words(value, None if std is None else COVERAGE * std, unit)

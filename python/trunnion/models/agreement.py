"""Whether several measurements of one machine say the same of what they share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.report import rough
from trunnion.base.statistics import basis_of_all
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.fit import first_values
from trunnion.diagnosis.records import value_in_words
from trunnion.diagnosis.refit import Refit, refit
from trunnion.diagnosis.result import Diagnosis

if TYPE_CHECKING:
    from trunnion.models.joint import JointModel
    from trunnion.models.parts import Acts, Part

LEVEL = 1e-8
"""At which "other in one measurement" is named: no set that has the shared cause instead comes near
one that has this, but for a difference that noise makes in less than 1 of 1000. Instead of a cause
that one kind alone shows it is an alternative at the odds of any cause
(:func:`~trunnion.diagnosis.behind.differing_instead`)."""
SCALE_OF_RUNS = 2e-6
"""The same of a scale in positioning runs alone, beside measurements with a length of their own: a
hundredth of what a cause among fifty has. Their instrument takes another temperature for the
material; else a machine of just that scale, and a part or a bar as much longer, are named."""
POSITIONING = "positioning"
WITH_A_LENGTH = frozenset({"touches", "points", "diameters", "ballbar"})
LINEAR_SCALES = frozenset({"scale_x", "scale_y", "scale_z"})
MIN_SEEN = 1e-4
"""Of what all measurements see of a cause, squared over their noise: less tells no difference."""
TINY = 1e-300
APART = "the measurements contradict each other"
OR_CHANGED = "(or the machine was changed between them)"
OPPOSITE = (
    ": the same with the other sign, as of a direction or a sense of approach that is reversed"
)
FAR = 4.0  # standard errors
MIN_AXES = 2
ONE_RUN = "A positioning run of one axis, diagnosed together with these, says which it is"


def errors_apart(parts: Sequence[Part], index: Sequence[Integers]) -> Iterator[tuple[str, int]]:
    """Kinds of measurement, each with a shared error that it may see otherwise than the others.

    index: Of each part the numbers of its nuisance parameters among all of them.
    """
    for k in sorted({int(k) for own in index for k in own}):
        sharing = [(i, int(np.flatnonzero(own == k)[0])) for i, own in enumerate(index) if k in own]
        if _of_several_kinds(parts, (i for i, _ in sharing)):
            seen = [(parts[i].kind, _seen_of_error(parts[i], own)) for i, own in sharing]
            yield from ((kind, k) for kind in _seeing(seen))


def effects_apart(
    parts: Sequence[Part], acting: Mapping[str, Sequence[Acts]], alike: str
) -> Iterator[tuple[str, str, float]]:
    """Kinds of measurement, each with a shared effect that it may see otherwise than the others.

    With the level of this candidate. acting: Id → the parts that it acts on, and how. alike: Id of
    the scale of all axes: other in an artefact or a bar, that is its size.
    """
    of_runs = _scales_of_runs(parts, acting, alike)
    for name, acts in acting.items():
        if _of_several_kinds(parts, (a.part for a in acts)):
            seen = [(parts[a.part].kind, _seen_of_effect(parts[a.part], a)) for a in acts]
            for kind in _seeing(seen):
                if name in of_runs and kind == POSITIONING:
                    yield kind, name, SCALE_OF_RUNS
                elif name != alike:
                    yield kind, name, LEVEL


def _scales_of_runs(
    parts: Sequence[Part], acting: Mapping[str, Sequence[Acts]], alike: str
) -> set[str]:
    """Ids of the scales of which positioning runs may have one of their own."""
    kinds = {name: {parts[a.part].kind for a in acts} for name, acts in acting.items()}
    of_axes = [name for name in kinds if name in LINEAR_SCALES and POSITIONING in kinds[name]]
    some = [*of_axes, alike] if alike and len(of_axes) > 1 else of_axes
    return {name for name in some if kinds[name] <= {POSITIONING, *WITH_A_LENGTH}}


def _of_several_kinds(parts: Sequence[Part], some: Iterable[int]) -> bool:
    return len({parts[i].kind for i in some}) > 1


def _seeing(seen: Sequence[tuple[str, float]]) -> tuple[str, ...]:
    """Kinds that see enough of what they share to differ in it; of one alone none."""
    by_kind: dict[str, float] = {}
    for kind, size in seen:
        by_kind[kind] = by_kind.get(kind, 0.0) + size
    least = MIN_SEEN * sum(by_kind.values())
    kinds = tuple(kind for kind, size in by_kind.items() if size > least)
    return kinds if len(kinds) > 1 else ()


def _seen_of_effect(part: Part, acts: Acts) -> float:
    """Squares of an effect's columns over the noise, one unit of each parameter."""
    model = part.model
    columns = part.white_columns(model.start, acts, [first_values(acts.effect)])[0].T
    return _left(columns, part.fitted, model.rank_tolerance)


def _seen_of_error(part: Part, k: int) -> float:
    """Squares of the column of a nuisance parameter over the noise, beside the others."""
    white = part.white_jacobian
    others = np.delete(white, k, axis=1)
    return _left(white[:, [k]], basis_of_all(others), part.model.rank_tolerance)


def _left(columns: Floats, basis: Floats, tolerance: float) -> float:
    """Sum of squares of columns beside others, of which there is an orthonormal basis."""
    left = columns - basis @ (basis.T @ columns)
    seen, every = (np.einsum("ij,ij->j", x, x) for x in (left, columns))
    return float(np.sum(np.where(seen > tolerance * every, seen, 0.0)))


@dataclass(frozen=True)
class Said:
    """What each kind of measurement says of one quantity: value and standard error."""

    name: str
    unit: str
    by_kind: Mapping[str, tuple[float, float]]

    def sentence(self) -> str:
        """Say it."""
        each = (
            f"{value_in_words(value, std, self.unit)} in {kind}"
            for kind, (value, std) in self.by_kind.items()
        )
        return f"{self.name} is {', '.join(each)}{OPPOSITE if self.opposite else ''}"

    @property
    def opposite(self) -> bool:
        """Whether two say the same with the other sign, each far from nothing."""
        values, std = np.array(list(self.by_kind.values())).T
        size = max(float(np.linalg.norm(std)), TINY)
        far = bool(np.all(abs(values) > FAR * std))
        return len(values) == 2 and far and abs(float(np.sum(values))) < FAR * size

    @property
    def distance(self) -> float:
        """Range of the values over their standard errors."""
        values, std = np.array(list(self.by_kind.values())).T
        return float(np.ptp(values) / max(float(np.linalg.norm(std)), TINY))


def with_contradictions(found: Diagnosis, model: JointModel) -> Diagnosis:
    """Say which measurement says what of a cause that the likeliest set takes apart."""
    names = sorted({model.apart[i][1] for i in found.named if i in model.apart})
    if not names:
        return _with_possible_changes(found, model)
    each = {name: _said(found, model, name) for name in names}
    said = {name: one.sentence() + _elsewhere(found, one) for name, one in each.items()}
    text = f"{APART}: {'; '.join(said.values())} {OR_CHANGED}"
    lost = {name: f"{APART}: {one}" for name, one in said.items() if name in found.errors_std}
    unknown = dict.fromkeys(lost, np.inf)
    return replace(
        found,
        verdict="unexplained",
        unexplained=text if found.unexplained is None else f"{text}; {found.unexplained}",
        errors_std={**found.errors_std, **unknown},
        not_identifiable={**found.not_identifiable, **lost},
        model=replace(found.model, std_errors={**found.model.std_errors, **unknown}),
    )


def _with_possible_changes(found: Diagnosis, model: JointModel) -> Diagnosis:
    """Ask for changes of the machine that are among the alternatives only."""
    every = frozenset().union(*found.alternatives) & model.apart.keys()
    if not every:
        return found
    names = " and ".join(sorted({model.apart[i][1] for i in every}))
    note = (
        f"{names} may be other in one kind of measurement than in the others: was the machine "
        "changed between them (a crash, work on it), or is one of them wrong?"
    )
    return replace(found, notes=(*found.notes, note))


def _elsewhere(found: Diagnosis, said: Said) -> str:
    """Say how far apart the middles are of measurements in which a backlash that grows differs.

    Circles are about the middle of their own coordinates, stops about that of the axis.
    """
    kind, _, axis = said.name.rpartition("_")
    (rate,) = found.effects.get(f"{kind}_slope_{axis}", {"": 0.0}).values()
    if kind != "backlash" or rate == 0.0:
        return ""
    away_mm = 1e3 * float(np.ptp([value for value, _ in said.by_kind.values()])) / abs(rate)
    return (
        f", as where their middles are {rough(away_mm)} mm apart along {axis.upper()}: it grows "
        f"by {rough(abs(rate))} µm/m"
    )


def warm_alike(found: Diagnosis, model: JointModel) -> list[str]:
    """Say what parts that are all as warm look like, of measurements of one kind alone.

    The scales of all axes, as much each, or an expansion of each part: one kind does not tell.
    """
    grown = [e for e in model.parts[0].model.effects if e.looks_like]
    scales = [e.id for e in model.effects if e.id in LINEAR_SCALES]
    if len({part.kind for part in model.parts}) > 1 or model.alike.axes or not grown:
        return []
    own, said = grown[0], grown[0].label or grown[0].id
    if any(i.endswith(f":{own.id}") for i in found.named):
        return [own.not_distinguished]
    sizes = {
        c.id: (c.parameters["ppm"], c.std_errors["ppm"]) for c in found.causes if c.id in scales
    }
    if len(scales) < MIN_AXES or len(sizes) < len(scales):
        return []
    if Said("", "ppm", sizes).distance > FAR:
        return []
    which = " and ".join(scales)
    return [
        f"{which} are alike: the readings do not distinguish them from {said}, as much in all "
        f"measurements. {ONE_RUN}."
    ]


def _said(found: Diagnosis, model: JointModel, name: str) -> Said:
    """What each kind says of a shared error or effect, fitted beside all else that was found.

    Of an effect of several parameters: of the one that differs most.
    """
    by_kind = {kind: i for i, (kind, of) in model.apart.items() if of == name}
    is_error = any(x.name == name for x in model.nuisance)
    own = list(by_kind.values())[is_error:]  # of an error the first kind has the shared value
    shared = [name] if name == model.alike.id else []  # other than in runs it is the shared one
    if shared:
        lengths = sorted(WITH_A_LENGTH & {part.kind for part in model.parts})
        by_kind = {" and ".join(lengths): name} | by_kind
    others = {i: v for i, v in found.effects.items() if i not in (*by_kind.values(), name)}
    free = []
    if name in model.alike.scales and others.pop(model.alike.id, None) is not None:
        # What a kind says of an axis is all of its scale, not what it is beside that of all axes.
        free = [i for i in model.alike.scales if i != name and i not in others]
    zero = {i: {p.name: 0.0 for p in model.effect(i).parameters} for i in (*own, *shared, *free)}
    fitted = refit(model, {**others, **zero}, np.zeros(0, dtype=np.intp))
    shown = []
    for p in model.effect(own[0]).parameters:
        of_all = [name] if is_error else [f"{x}.{p.name}" for x in shared]
        terms = {
            kind: [*of_all, *([f"{i}.{p.name}"] if i in own else [])] for kind, i in by_kind.items()
        }
        values = {kind: _sum(fitted, some) for kind, some in terms.items()}
        many = len(model.effect(own[0]).parameters) > 1
        shown.append(Said(f"{name}.{p.name}" if many else name, p.unit, values))
    return max(shown, key=lambda one: one.distance)


def _sum(fitted: Refit, names: list[str]) -> tuple[float, float]:
    """Sum of some parameters, and its standard error."""
    at = [fitted.names.index(n) for n in names]
    if fitted.not_identifiable[at].any():
        return float(fitted.values[at].sum()), np.inf
    variance = float(fitted.covariance[np.ix_(at, at)].sum())
    return float(fitted.values[at].sum()), float(np.sqrt(max(variance, 0.0)))

"""What to measure next, across instruments: which further test settles a diagnosis' doubt soonest.

Every set of causes that is left is fitted to the measurement and predicts the readings of further
tests: a repeat in reversed order, chosen touches, a touches pass, a circle of a ball-bar, a
positioning run of a linear axis. A test of another instrument joins the measurement as in a joint
diagnosis (:mod:`.joint`); what only that test shows (its instrument's length or drift, the scale of
a further axis) may take any size, so that it cannot settle what it could imitate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, positive
from trunnion.base.report import Result, Table
from trunnion.base.stored import fitting, plain
from trunnion.base.units import Flags, Floats
from trunnion.data.ballbar import Ballbar
from trunnion.data.positioning import Positioning
from trunnion.data.touches import Touches, without_frame
from trunnion.diagnosis.discrimination import Discrimination, Hypothesis
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import Alternative, percent
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.whitening import Scaled, identity
from trunnion.models.ballbar.model import BallbarModel
from trunnion.models.joint import JointModel
from trunnion.models.kinds import measured_of
from trunnion.models.next_touches import MAX_SETS, in_good_order, next_touches, pool_of
from trunnion.models.parts import Part
from trunnion.models.positioning import PositioningModel
from trunnion.models.touches import TouchDiagnosisModel
from trunnion.probing.plan import plan
from trunnion.probing.steps import cycle_of, with_starts
from trunnion.setup import Setup

MOUNTING_MINUTES: Mapping[str, float] = {"touches": 2.0, "ballbar": 10.0, "positioning": 30.0}
NOISE_UM = 0.5  # of a ball-bar, and of stops of an axis
USEFUL = 0.5  # chance from which a test comes before those that are only quick
NO_HELP = 0.005  # chance below which a test is said not to settle the doubt
FEW, FEED = 8, 600.0
TARGETS, CYCLES, STOP_S = 11, 5, 5.0
TRAVEL_MM = (-150.0, 150.0)  # where the set-up states no range
RADIUS_MM, CIRCLE_FEED, ARC_STEP_DEG = 100.0, 1000.0, 3.0
PLANES = {"XY": (0, 1, 0.0, 360.0), "YZ": (1, 2, 0.0, 180.0), "ZX": (0, 2, 0.0, 180.0)}
"""Axes of a circle, and where its arc begins and ends: a spindle leaves half of a vertical one."""
PLANS: Mapping[str, type[Touches | Ballbar | Positioning]] = {
    "touches": Touches,
    "ballbar": Ballbar,
    "positioning": Positioning,
}


@dataclass(frozen=True, eq=False, repr=False)
class NextMeasurement(Result):
    """A further test, and what it is expected to settle.

    Attributes
    ----------
    label : str
        What to measure.
    kind : str
        Kind of the data that it gives.
    minutes : float
        Time that it takes, with mounting the instrument.
    chance : float
        Probability that one set of causes is left after it.
    apart : dict
        For each other set of causes its distance from the named one in the new readings, in
        standard deviations.
    plan : Touches, Ballbar or Positioning
        What to measure: nominal readings, one a row.

    Examples
    --------
    >>> import trunnion as tn
    >>> d = tn.diagnose(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    >>> tn.next_measurement(d)  # nothing is in doubt
    ()
    """

    label: str
    kind: str
    minutes: float
    chance: float
    apart: Mapping[frozenset[str], float]
    plan: Touches | Ballbar | Positioning

    def sentences(self) -> Sequence[str]:
        """Say what to measure, how long it takes and what it is expected to settle."""
        if not self.helps:
            expected = f"does not settle the doubt (probability below {100 * NO_HELP:.1f} %)"
        else:
            expected = f"settles the doubt with a probability of {percent(self.chance)}"
        return (f"{self.label}: {self.minutes:.0f} min, {expected}.",)

    @property
    def helps(self) -> bool:
        """Whether it may settle the doubt at all; where none does, another instrument is needed."""
        return self.chance >= NO_HELP

    def summary(self) -> str:
        """Return one line."""
        return self.sentences()[0]

    def tables(self) -> tuple[Table, ...]:
        """Distance of each other set of causes."""
        rows = [(" + ".join(sorted(causes)), distance) for causes, distance in self.apart.items()]
        columns = ("other causes", "distance from the named, σ")
        return (Table.of("Expected discrimination", columns, rows),)

    def to_dict(self) -> dict[str, Any]:
        """Plain values; sets of causes as lists."""
        apart = [{"causes": sorted(c), "distance": plain(d)} for c, d in self.apart.items()]
        own = {name: getattr(self, name) for name in ("label", "kind", "minutes", "chance")}
        result = {"result": type(self).__name__, **own, "apart": apart}
        return {**result, "plan": self.plan.described()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> NextMeasurement:
        """Return the test that `to_dict` described."""
        with fitting(cls.__name__):
            apart = {frozenset(a["causes"]): float(a["distance"]) for a in values["apart"]}
            kind = choose("kind", values["kind"], PLANS)
            planned = PLANS[kind].from_description(values["plan"])
            minutes, chance = float(values["minutes"]), float(values["chance"])
            return cls(str(values["label"]), kind, minutes, chance, apart, planned)


@checked
def next_measurement(
    diagnosis: Diagnosis,
    setup: Setup | None = None,
    *,
    mounting_minutes: Mapping[str, float] | None = None,
) -> tuple[NextMeasurement, ...]:
    """Rank further tests by the probability per minute that they settle what is in doubt.

    Tried are, of a measurement of touches, the same touches in reversed order and eight that
    :func:`next_touches` chooses; of several together, the same of the last one of touches, eight
    chosen for the sets of all; without touches a pass of these, if the set-up has an artefact; a
    circle of a ball-bar in XY, YZ and ZX, in both senses; a positioning run of X, Y and Z, of 11
    targets in five cycles (ISO 230-2). Tests with a probability of a half or more come first.

    Parameters
    ----------
    diagnosis
        One measurement's, or that of several together.
    setup
        The set-up of the further tests; by default that of the diagnosis.
    mounting_minutes
        Time to mount the instrument of "touches", "ballbar" and "positioning"; 2, 10 and 30 minutes
        by default.

    Returns
    -------
    tuple of NextMeasurement
        The best first; ``helps`` is false of those that do not settle the doubt. Empty where no
        sets of causes are in doubt. Structure that no cause makes is no such doubt: its notes say
        what to measure. At most eight sets of causes are compared, the most probable ones.

    Raises
    ------
    InputError
        The diagnosis has no data.
    UnknownNameError
        ``mounting_minutes`` names another kind.

    Notes
    -----
    Readings of another instrument are supposed to have a noise of 0.5 µm. The probability is that,
    whichever set is true, every other ends more than 6 in -2 ln L from it, whatever the size of
    causes that only the further test shows. Further touches with the artefact left as it is are one
    measurement with the first ones: diagnose ``first.followed_by(further)``.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> tn.next_measurement(d)[0].kind
    'touches'
    """
    mounting = dict(MOUNTING_MINUTES)
    for name, minutes in (mounting_minutes or {}).items():
        choose("mounting_minutes", name, MOUNTING_MINUTES)
        mounting[name] = positive(f"mounting_minutes[{name!r}]", minutes)
    sets = diagnosis.evidence[:MAX_SETS]
    if len(sets) < 2:
        return ()
    place = diagnosis.setup if setup is None else setup
    place = place if isinstance(place, Setup) else None
    known = _Known.of(diagnosis, sets)
    tests = (*_more_touches(diagnosis, known), *_other_kinds(diagnosis, known, place))
    found = [_expected(test, known, mounting[test.kind]) for test in tests]
    useful = [one for one in found if one is not None]
    return tuple(sorted(useful, key=lambda n: (n.chance < USEFUL, -n.chance / n.minutes)))


@dataclass(frozen=True)
class _Known:
    """What was measured, as a joint model, and the sets that are in doubt, fitted to it.

    ``nuisance``: values of what is always fitted, as the diagnosis found them.
    """

    model: JointModel
    nuisance: Floats
    sets: Sequence[Alternative]
    fits: Sequence[Fit]

    @classmethod
    def of(cls, diagnosis: Diagnosis, sets: Sequence[Alternative]) -> _Known:
        """Fit the sets of a diagnosis to its measurement."""
        model, ids = _joint(diagnosis)
        values = diagnosis.nuisance_after
        start = [values.get(x.name, values.get(x.name.partition(":")[2])) for x in model.nuisance]
        nuisance = np.array(start, dtype=np.float64)
        rows, whiten, fits = np.arange(len(model.readings)), model.whitener(np.zeros(0)), []
        for one in sets:
            at = {ids[name]: Values(values) for name, values in one.start.items()}
            effects = [e for e in model.effects if e.id in at]
            fits.append(fit(model, rows, effects, nuisance, at, whiten))
        return cls(model, nuisance, sets, fits)

    def continued(self, values: Floats, both: JointModel) -> Floats:
        """Values of what is always fitted, and where that of a further test starts."""
        return np.concatenate([values, both.start[len(values) :]])


@dataclass(frozen=True)
class _Test:
    """A further test, and the model of it together with what was measured.

    ``old``: which readings of both there are; ``own``: effects that only the test shows.
    """

    label: str
    kind: str
    minutes: float
    plan: Touches | Ballbar | Positioning
    both: JointModel
    old: Flags
    own: tuple[str, ...] = ()


def _expected(test: _Test, known: _Known, mounting: float) -> NextMeasurement | None:
    """Return what a test is expected to settle; None: it cannot be said of two sets.

    An error whose size the measurement hardly tells may put the artefact where no touch meets it.
    """
    weighed = _discrimination(test, known)
    if weighed is None:
        return None
    sets, discrimination = weighed
    new = np.flatnonzero(~test.old)
    apart = discrimination.distances(new)
    return NextMeasurement(
        test.label,
        test.kind,
        test.minutes + mounting,
        discrimination.chance(new),
        {causes: apart[i] for i, causes in enumerate(sets) if i},
        test.plan,
    )


def _discrimination(
    test: _Test, known: _Known
) -> tuple[list[frozenset[str]], Discrimination] | None:
    """Return the sets of which the readings of a test can be said, and how it tells them apart.

    None: the named one, which is the first, or all others are none of them.
    """
    both, whiten = test.both, test.both.whitener(np.zeros(0))
    sets: list[frozenset[str]] = []
    hypotheses: list[Hypothesis] = []
    for one, f in zip(known.sets, known.fits, strict=True):
        nuisance = known.continued(f.nuisance, both)
        hypothesis = Hypothesis.at(both, nuisance, f.effects, one.distance, whiten)
        if hypothesis is not None:
            sets.append(one.causes)
            hypotheses.append(hypothesis)
        elif not sets:
            return None
    if len(sets) < 2:
        return None
    start = known.continued(known.nuisance, both)
    columns = [both.jacobian(start, {})]
    for name in test.own:
        effect = both.effect(name)
        unit = effect.values(1.0 for _ in effect.parameters)
        columns.append(both.effect_jacobian(start, effect, unit))
    white = np.asarray(whiten(np.concatenate(columns, axis=1)))
    return sets, Discrimination(white, test.old, hypotheses, 1.0)


# --- the tests


def _more_touches(diagnosis: Diagnosis, known: _Known) -> Iterator[_Test]:
    """Further touches, with the artefact where the last measurement of touches had it."""
    parts = known.model.parts
    i = max((i for i, p in enumerate(parts) if p.kind == "touches"), default=None)
    if i is None:
        return
    measured = cast(TouchDiagnosisModel, parts[i].model)
    reverse = _reversed(measured.data)
    yield _follows(known, i, "the same touches in reversed order", reverse)
    if isinstance(diagnosis.data, Touches):
        new = next_touches(diagnosis, FEW)
        yield _follows(known, i, f"{FEW} touches of next_touches, the artefact left as it is", new)
        return
    reachable = pool_of(measured)
    every = _follows(known, i, "all that are reachable", reachable)
    weighed = _discrimination(every, known)
    if weighed is not None:
        chosen = weighed[1].choose(FEW) - np.flatnonzero(~every.old)[0]
        new = in_good_order(reachable[chosen], measured.data, measured.setup)
        yield _follows(known, i, f"{FEW} touches chosen for it, the artefact left as it is", new)


def _follows(known: _Known, i: int, label: str, new: Touches) -> _Test:
    """Touches that follow those of part ``i``: they are one measurement."""
    parts = known.model.parts
    part, before = parts[i], cast(TouchDiagnosisModel, parts[i].model)
    model = before.bind(without_frame(before.data).followed_by(without_frame(new)))
    n, more = len(before.readings), len(model.readings)
    whiten = Scaled(identity, part.whiten.size)
    longer = Part(part.name, part.kind, model, np.arange(more), whiten, candidates=part.candidates)
    both = JointModel([*parts[:i], longer, *parts[i + 1 :]], before=known.model)
    start = sum(len(p.model.readings) for p in parts[:i])
    old = np.ones(len(both.readings), dtype=bool)
    old[start + n : start + more] = False
    return _Test(label, "touches", _minutes(new, before.setup), new, both, old)


def _reversed(old: Touches) -> Touches:
    """The same touches, the last first, each axis turned the other way to them."""
    back = old[np.arange(len(old))[::-1]]
    back = back.with_columns(**{f"{x}_dir": -way for x, way in back.rotary_dir.items()})
    if old.time_s is None:
        return back
    time = np.asarray(old.time_s)
    pause = float(np.ptp(time)) / max(len(time) - 1, 1)
    return back.with_columns(time_s=2 * time.max() + pause - time[::-1])


def _minutes(touches: Touches, setup: Setup) -> float:
    """How long a program of touches runs."""
    feed = FEED if touches.feed_mm_min is None else None
    return float(cycle_of(with_starts(touches, setup, feed), setup).times()[0][-1]) / 60.0


def _other_kinds(diagnosis: Diagnosis, known: _Known, setup: Setup | None) -> Iterator[_Test]:
    """Tests of other instruments beside the measurement."""
    model = known.model
    names = {e.id for e in model.effects}
    for label, kind, minutes, noise, new in _candidates(diagnosis, setup):
        name = kind if all(p.kind != kind for p in model.parts) else f"{kind} next"
        n = len(new.readings)
        part = Part(name, kind, new, np.arange(n), Scaled(identity, noise))
        # What several measurements may have in common or differ in is no freedom of the test.
        both = JointModel([*model.parts, part], before=model)
        own = tuple(e.id for e in both.effects if e.linear and e.id not in names)
        old = np.arange(len(both.readings)) < len(model.readings)
        yield _Test(label, kind, minutes, new.data, both, old, own)


def _joint(diagnosis: Diagnosis) -> tuple[JointModel, Mapping[str, str]]:
    """The diagnosed measurement as a joint model, and what that calls its effects."""
    if isinstance(diagnosis.data, tuple):
        model = cast(JointModel, diagnosis.rebuilt_model())
        return model, {e.id: e.id for e in model.effects}
    one = measured_of(diagnosis)
    joint = JointModel([one.part(one.kind, 0, one.used)])
    return joint, joint.ids_of_part(0)


def _candidates(
    diagnosis: Diagnosis, setup: Setup | None
) -> Iterator[tuple[str, str, float, float, Model]]:
    """Label, kind, minutes at work, noise and model of tests of other instruments."""
    data = diagnosis.data if isinstance(diagnosis.data, tuple) else (diagnosis.data,)
    has_touches = any(isinstance(one, Touches) for one in data)
    if setup is not None and setup.artefact.kind != "none" and not has_touches:
        made = plan(setup)
        made = made.with_columns(time_s=cycle_of(made, setup).times()[0])
        noise = setup.probe.repeatability_um or NOISE_UM
        model = TouchDiagnosisModel(made, setup)
        yield "a pass of touches", "touches", _minutes(made, setup), noise, model
    for plane in PLANES:
        circle = _circle(plane)
        label = f"a circle of a ball-bar in {plane}, both senses"
        yield label, "ballbar", _spent(circle), NOISE_UM, BallbarModel(circle)
    ranges = {} if setup is None else setup.axis_ranges()
    for axis in "XYZ":
        run = _run(axis, ranges.get(axis, TRAVEL_MM))
        label = f"a positioning run of {axis}"
        yield label, "positioning", _spent(run), NOISE_UM, PositioningModel(run)


def _spent(data: Ballbar | Positioning) -> float:
    """Minutes from the first to the last reading."""
    return float(np.ptp(np.asarray(data.time_s))) / 60.0


def _circle(plane: str) -> Ballbar:
    """Arc of a ball-bar in both senses."""
    first, second, begin, end = PLANES[plane]
    angles = np.radians(np.arange(begin, end + ARC_STEP_DEG / 2, ARC_STEP_DEG))
    angles = np.concatenate([angles, angles[::-1]])
    places = np.zeros((len(angles), 3))
    places[:, first], places[:, second] = RADIUS_MM * np.cos(angles), RADIUS_MM * np.sin(angles)
    step_s = 60.0 * RADIUS_MM * np.radians(ARC_STEP_DEG) / CIRCLE_FEED
    return Ballbar(
        setup=np.full(len(angles), plane),
        x_mm=places[:, 0],
        y_mm=places[:, 1],
        z_mm=places[:, 2],
        length_mm=np.full(len(angles), RADIUS_MM),
        sense=np.repeat([1, -1], len(angles) // 2),
        feed_mm_min=np.full(len(angles), CIRCLE_FEED),
        time_s=step_s * np.arange(len(angles)),
    )


def _run(axis: str, limits: tuple[float, float]) -> Positioning:
    """Stops of a linear axis at targets that are not quite evenly spaced (ISO 230-2)."""
    low, high = limits
    uneven = np.modf(np.arange(TARGETS) * (np.sqrt(5.0) - 1.0) / 2.0)[0] - 0.5
    up = np.linspace(low, high, TARGETS) + 0.1 * (high - low) / TARGETS * uneven
    target = np.tile(np.concatenate([up, up[::-1]]), CYCLES)
    return Positioning(
        target_mm=target,
        measured_mm=target,
        direction=np.tile(np.repeat([1, -1], TARGETS), CYCLES),
        cycle=np.repeat(np.arange(1, CYCLES + 1), 2 * TARGETS),
        axis=np.full(len(target), axis),
        time_s=STOP_S * np.arange(len(target)),
    )

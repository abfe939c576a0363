"""Likely mistakes of measured data, named beside their refusal or their diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from trunnion.data.approach import approach_doubts
from trunnion.data.axis_log import AxisLog
from trunnion.data.diameters import Diameters
from trunnion.data.levels import Levels
from trunnion.data.meant import BETTER, likely_better, meant_named
from trunnion.data.mistaken import of_each, size_notes
from trunnion.data.pace import pace_doubts
from trunnion.data.positioning import Positioning
from trunnion.data.rotary_test import RotaryTest
from trunnion.data.shifted import displaced_rows
from trunnion.data.touches import Touches
from trunnion.data.turned import turn_doubts
from trunnion.diagnosis.effect import EffectValues
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.plain import plain_fit
from trunnion.diagnosis.result import Diagnosis
from trunnion.machine.sizes import LARGE_UM, SURE_SIGMAS, in_other_units
from trunnion.models.exchanged import exchanged
from trunnion.models.joint import JointModel
from trunnion.models.several import Measured
from trunnion.probing.mistakes import mistakes_named
from trunnion.setup import Setup

OWN_RULES = (Touches, AxisLog, Positioning)
"""Kinds whose models say themselves what was mistaken."""

CAUSE = "What is not explained has a likely cause: "
MIN_FREEDOM = 5
SURE_PROBABILITY = 0.95
"""Of a named cause that no mistake is taken for."""
FROM_CHUCK = ("bending", "chuck_tilt")
"""Causes of diameters that are the largest at the free end, of one sign."""
MIN_OF_OVERHANG = 0.3
"""Of the overhang, that measured places of a part reach."""

Build = Callable[[Any, Any], Model]


def scatter_by(build: Build) -> Callable[[Any, Any], float]:
    """Return the rms of what the plain model of data leaves.

    Infinite with too few readings, or places that are far smaller than the set-up says.
    """

    def scatter(data: Any, setup: Any) -> float:
        model = build(data, setup)
        if isinstance(data, Diameters) and not _of_overhang(data, model):
            return np.inf
        found = plain_fit(model)
        return float(np.sqrt(found.rss / found.dof)) if found.dof >= MIN_FREEDOM else np.inf

    return scatter


def _of_overhang(data: Diameters, model: Any) -> bool:
    """Whether places of diameters are on a part that sticks out as far as the set-up says.

    No other column tells how long the part is: on a tiny one any readings fit.
    """
    return bool(np.max(data.z_mm) >= MIN_OF_OVERHANG * model.conditions.overhang_mm)


@contextmanager
def refusal_explained(data: Any, setup: Any, build: Build) -> Iterator[None]:
    """Add the likely cause to an error about data that cannot belong to their model."""
    if isinstance(data, Touches) and isinstance(setup, Setup):
        with mistakes_named(data, setup):
            yield
    elif isinstance(data, OWN_RULES):
        yield
    else:
        with meant_named(data, setup, scatter_by(build)):
            yield


def with_mistakes(found: Diagnosis, model: Any, data: Any, setup: Any, build: Build) -> Diagnosis:
    """Return the diagnosis of a measurement with what is likely mistaken about its data.

    model: What they were diagnosed by.
    """
    left = found.gain.rms_before_um, found.gain.rms_after_um
    unexplained = left if found.verdict == "unexplained" else None
    mistakes = _mistakes(model, data, setup, build, unexplained, _sure_causes(found))
    own = (note for note in mistakes if note not in found.notes)
    return replace(found, mistakes=mistakes, notes=(*own, *found.notes))


def with_mistakes_of_each(
    found: Diagnosis, model: JointModel, measured: Sequence[Measured], setup: Any, build: Build
) -> Diagnosis:
    """Return a joint diagnosis with what is likely mistaken about each of its measurements."""
    sure, said = _sure_causes(found), {}
    for i, (part, one) in enumerate(zip(model.parts, measured, strict=True)):
        _, own = model.of_part(i, model.start, sure)
        said[part.name] = _mistakes(part.model, one.data, setup, build, one.unexplained_rms, own)
    cause = exchanged(found, model, measured)
    mistakes = (*([f"{CAUSE}{cause}"] if cause else []), *of_each(said))
    named = {f"{name}: {text}" for name, texts in said.items() for text in texts}
    others = (note for note in found.notes if note not in named)
    return replace(found, mistakes=mistakes, notes=(*mistakes, *others))


def _sure_causes(found: Diagnosis) -> EffectValues:
    """Values of the named causes that are beyond doubt, by id."""
    return {c.id: c.parameters for c in found.causes if c.probability >= SURE_PROBABILITY}


def _mistakes(
    model: Any,
    data: Any,
    setup: Any,
    build: Build,
    unexplained: tuple[float, float] | None,
    causes: EffectValues,
) -> tuple[str, ...]:
    """Say what is likely mistaken about data that were diagnosed, alone or with others.

    model: What they were diagnosed by; that of touches knows it.
    unexplained: Rms of what the plain model and the causes leave, if no cause explains the data.
    causes: Of these data, beyond doubt.
    """
    if isinstance(data, Touches):
        return tuple(model.mistakes(causes))
    said = [*size_notes(data)]
    if isinstance(data, RotaryTest) and isinstance(setup, Setup):
        said += _far_places(model, setup)
    said += pace_doubts(data)
    if isinstance(data, Levels):
        said += turn_doubts(data)
    if isinstance(data, Positioning):
        said += approach_doubts(data)
    if other := data.displaced if isinstance(data, Positioning) else displaced_rows(data):
        said.append(f"Readings belong to other rows: {other}")
    if isinstance(setup, Setup) and (doubt := in_other_units(setup.machine.errors)):
        said.append(f"[machine.errors] has {doubt}")
    if unexplained is not None and isinstance(data, AxisLog):
        said += getattr(build(data, setup), "scale_doubts", ())
    if unexplained is not None and isinstance(data, Diameters):
        said += [f"{CAUSE}{text}" for text in _from_free_end(data, setup, build, unexplained[1])]
    if unexplained is not None and not isinstance(data, Positioning):
        cause = likely_better(data, setup, scatter_by(build), *unexplained)
        said += [f"{CAUSE}{cause}"] if cause else []
    return tuple(said)


def _from_free_end(data: Diameters, setup: Any, build: Build, left: float) -> list[str]:
    """Say with which cause of a cut a part fits whose places count from its free end.

    left: Rms of what the causes that were found leave.
    """
    given: Any = build(data, setup)
    overhang = given.conditions.overhang_mm
    places = overhang - np.asarray(data.z_mm)
    if np.min(places) < 0.0:
        return []
    model = build(data.with_columns(z_mm=places), setup)
    plain = model.jacobian(np.zeros(len(model.nuisance)), {})
    found = []
    for id_ in FROM_CHUCK:
        effect = model.effect(id_)
        start = {p.name: 0.0 for p in effect.parameters}
        column = model.effect_jacobian(np.zeros(len(model.nuisance)), effect, start)
        terms = np.column_stack([plain, column])
        size, *_ = np.linalg.lstsq(terms, model.readings.values, rcond=None)
        off = model.readings.values - terms @ size
        rms = float(np.sqrt(off @ off / max(len(off) - terms.shape[1], 1)))
        if size[-1] > 0.0 and rms <= BETTER * left:
            found.append((rms, effect.label))
    return [
        f"the data fit to {rms:.3g} µm with one cause ({label}) if z_mm counts from the free end "
        f"of the part: it counts from the chuck, {overhang:g} mm less these places."
        for rms, label in sorted(found)[:1]
    ]


def _far_places(model: Model, setup: Setup) -> list[str]:
    """Ask about positions of axes that are farther from the set-up than those of any machine."""
    plain = plain_fit(model)
    std = np.sqrt(np.diag(plain.covariance) * plain.rss / max(plain.dof, 1))
    std_of = {
        x.name: np.inf if plain.not_identifiable[i] else std[i]
        for i, x in enumerate(model.nuisance)
    }
    far = {
        name: off
        for name, value in model.location_errors(plain.nuisance, {}).items()
        if name[1] in "XYZ"
        and abs(off := value - setup.machine.errors.get(name, 0.0)) > LARGE_UM
        and abs(off) > SURE_SIGMAS * std_of.get(name, np.inf)
    }
    if not far:
        return []
    listed = ", ".join(f"{name} {off:+.0f} µm" for name, off in far.items())
    return [
        f"More than 1 mm from the set-up: {listed}. Are the places of the ball (x_mm, y_mm, z_mm, "
        "from the origin of the axes) and of the axes (point_mm) right, and in mm?"
    ]

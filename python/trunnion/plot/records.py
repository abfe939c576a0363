"""What a diagnosis is made of, and what to measure next: a cause, its share, gain, structure."""

from __future__ import annotations

import numpy as np

from trunnion.base.units import capital, unit_of
from trunnion.diagnosis.contributions import Contribution
from trunnion.diagnosis.records import NO_CAUSE, Cause, Gain
from trunnion.diagnosis.structure import Structure
from trunnion.diagnosis.ways import is_angle
from trunnion.models.next_measurement import NextMeasurement
from trunnion.models.next_passes import MIN_DISTANCE, NextPass
from trunnion.models.next_touches import ExpectedDiscrimination
from trunnion.plot.others import values_pictures
from trunnion.plot.picture import Axis, Picture, line
from trunnion.plot.statistics import bars_picture, change_picture, with_limit
from trunnion.plot.style import BLUE, MUTED
from trunnion.plot.touches import touches_pictures

MAX_NAMES = 24
PLACES = 400
UNSEEN = 1e-9


def cause_pictures(cause: Cause) -> list[Picture]:
    """Return the parameters of a cause with U (k = 2), a picture for each unit."""
    title = capital(cause.label or cause.id)
    return values_pictures(title, cause.parameters, cause.std_errors)


def contribution_pictures(c: Contribution) -> list[Picture]:
    """Return the share that a cause explains, and how it biases the plain model's errors."""
    title = capital(c.label or c.id)
    shares = {
        "in the order of the causes": 100 * c.share,
        "as the only cause": 100 * c.alone_share,
        "as the last cause": 100 * c.last_share,
    }
    found = [bars_picture(title, "Share of the variance explained", "%", shares, digits=3)]
    bias = {k: v for k, v in c.bias.items() if abs(v) > UNSEEN}
    return found + values_pictures("Bias of the plain model by it", bias, {}, "Bias")


def gain_pictures(gain: Gain) -> list[Picture]:
    """Return the residual rms without and with the causes, a picture for each unit."""
    return [
        bars_picture(
            "Residual without and with the causes",
            "rms of the residual",
            one.unit,
            {
                "fit, plain model": one.rms_before_um,
                "fit, with the causes": one.rms_after_um,
                "cross-validated, plain model": one.heldout_rms_before_um,
                "cross-validated, with the causes": one.heldout_rms_after_um,
            },
            digits=3,
        )
        for one in gain.by_unit().values()
    ]


def structure_pictures(s: Structure) -> list[Picture]:
    """Return the curve of unexplained structure over what it depends on; else its parameters."""
    effect = s.effect
    if effect.shape == "class":
        return values_pictures(capital(effect.label), s.parameters, s.std_errors)
    fixed, values = effect.at_values(s.parameters)
    low, high = effect.low, effect.high
    if effect.shape == "harmonic":
        high = low + effect.turn
    at = np.linspace(low, high, PLACES)
    curve = fixed.columns_at(at) @ np.array(list(values.values()))
    where = f" along {effect.component}" if effect.component else ""
    changed = f"the {effect.component}" if is_angle(effect.component) else f"a reading{where}"
    return [
        Picture(
            capital(effect.label),
            Axis(capital(effect.covariate), effect.unit),
            Axis(f"Change of {changed}", effect.reading_unit),
            (
                line([low, high], [0.0, 0.0], colour=MUTED, width=0.8),
                line(at, curve, "fitted", colour=BLUE, width=2.2),
            ),
        )
    ]


def next_picture(one: NextMeasurement | NextPass) -> Picture:
    """Return how far a further test sets each other set of causes from the named one."""
    ranked = sorted(one.apart.items(), key=lambda pair: -pair[1])[:MAX_NAMES]
    values = {" + ".join(sorted(causes)) or NO_CAUSE: size for causes, size in ranked}
    minutes = f", {one.minutes:.0f} min" if isinstance(one, NextMeasurement) else ""
    p = bars_picture(
        f"{capital(one.label)}{minutes}",
        "Distance from the named causes",
        "σ",
        values,
        digits=3,
        note=f"Beyond {MIN_DISTANCE:g} σ the test distinguishes them.",
    )
    return with_limit(p, MIN_DISTANCE, "distinguished", colour=MUTED)


def discrimination_pictures(found: ExpectedDiscrimination) -> list[Picture]:
    """Return the standard errors of the causes, now and with the new touches, and the touches."""
    units = dict.fromkeys(unit_of(name) for name in found.std_before)
    made = []
    for unit in units:
        mine = [name for name in found.std_before if unit_of(name) == unit][:MAX_NAMES]
        before, after = (
            {name: std[name] for name in mine} for std in (found.std_before, found.std_after)
        )
        title = "Standard errors of the causes"
        said = ("now", "with the new touches")
        made.append(change_picture(title, "Standard error", unit, before, after, said))
    return [*made, *touches_pictures(found.plan)]

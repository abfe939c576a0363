"""What recorded temperatures say of a change of scale between measurements of one machine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from trunnion.base.report import plus_minus
from trunnion.base.units import capital
from trunnion.diagnosis.joint_ids import Happened, JointId
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.changes import MachineComparison
from trunnion.models.joint import JointModel

COLUMN = "temperature_c"
WITH_TEMPERATURE = "goes with a change of temperature"
MIN_K = 0.1  # difference of temperatures from which it is stated: thermometers of shops
MATERIALS = "steel has about 11.5 ppm/K, aluminium 23, scales of glass 8 to 10"
MAX_SHOP_C = 100.0  # mean of a measurement, above which it is no temperature of a shop
MAX_PPM_K = 40.0  # of materials that machines are made of


def mean_temperature(data: Any) -> float | None:
    """Mean of the recorded temperatures of a measurement, °C; None without a column of them."""
    values = getattr(data, "columns", {}).get(COLUMN)
    if values is None or not len(values):
        return None
    found = np.asarray(values)
    mean = float(found.mean()) if found.dtype.kind in "fiu" else float("nan")
    return mean if np.isfinite(mean) else None


def _of_lengths(data: Any) -> float | None:
    """Mean temperature of a measurement of lengths: a uniform one changes no angle."""
    return None if getattr(data, "rotary", False) else mean_temperature(data)


def _asked(*means: float) -> str:
    """Ask whether temperatures are absolute ones; empty where they may be °C."""
    return "; are these K, not °C?" if max(means) > MAX_SHOP_C else ""


def expansion_of(change: str, ppm: float, std: float, ends: Sequence[tuple[str, float]]) -> str:
    """Say by how many K measurements differ, and which expansion a change of length would be.

    change: What changed. ends: Name and mean temperature of what it is counted from, and to.
    Empty where the temperatures hardly differ.
    """
    (before, cold), (after, warm) = ends
    kelvin = warm - cold
    if abs(kelvin) < MIN_K:
        return ""
    rate, spread = ppm / kelvin, abs(std / kelvin)
    more = f"{abs(kelvin):.1f} K {'more' if kelvin > 0 else 'less'}"
    asked = _asked(cold, warm)
    text = (
        f"{capital(change)} {WITH_TEMPERATURE} ({COLUMN}): {cold:.1f} °C in "
        f"{before}, {warm:.1f} °C in {after}, {more}{asked}. As a thermal expansion it "
        f"would be {plus_minus(rate, spread)} ppm/K ({MATERIALS})"
    )
    if not -MAX_PPM_K / 4 < rate < MAX_PPM_K:
        return f"{text}: no material of machines has that, temperature alone does not make it."
    return f"{text}."


def temperature_notes(found: Diagnosis, model: JointModel, data: Sequence[Any]) -> Iterator[str]:
    """Say of scales that are others in one of several measurements what temperatures say of them.

    data: Of each part of the model.
    """
    names = [part.name for part in model.parts]
    mean = [_of_lengths(one) for one in data]
    for cause in found.causes:
        of = JointId.of(cause.id)
        if of.happened is None or "ppm" not in cause.parameters or of.measurement not in names:
            continue
        at = names.index(of.measurement)
        others = [i for i in range(len(names)) if of.cause in model.ids_of_part(i).values()]
        others = [i for i in others if (i != at if of.happened is Happened.DIFFERS else i < at)]
        known = {names[i]: t for i in others if (t := mean[i]) is not None}
        warm = mean[at]
        if warm is None or not known:
            continue
        sign = -1.0 if of.happened is Happened.ENDED else 1.0  # its size is that until then
        before = " and ".join(known), float(np.mean([*known.values()]))
        ends = (before, (of.measurement, warm))
        size = sign * cause.parameters["ppm"]
        if said := expansion_of(cause.label or cause.id, size, cause.std_errors["ppm"], ends):
            yield said


def with_temperatures(found: MachineComparison, data: Sequence[Any]) -> MachineComparison:
    """Return a comparison that says what temperatures say of the scales that changed.

    data: Of each measurement; none where they are not known.
    """
    known = [_of_lengths(one) for one in data]
    if len(known) != len(found.names) or known[0] is None or known[-1] is None:
        return found
    ends = ((found.names[0], known[0]), (found.names[-1], known[-1]))
    notes = [
        expansion_of(f"change of {q.called}", q.change, q.std_error, ends)
        for q in found.quantities
        if q.changed and q.unit == "ppm"
    ]
    return replace(found, notes=(*found.notes, *filter(None, notes)))


def recorded(data: Any) -> str:
    """Say in which temperatures a result's data were measured; empty: none are recorded."""
    several = data if isinstance(data, list | tuple) else (data,)
    known = [t for one in several if (t := mean_temperature(one)) is not None]
    if not known:
        return ""
    low, high = min(known), max(known)
    span = f"{low:.1f} °C" if high - low < MIN_K else f"{low:.1f} to {high:.1f} °C"
    return f"{span} (column {COLUMN}, mean of a measurement{_asked(*known)})"

"""What touches depend on, and the ways by which a disturbance enters them, without a set-up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.diagnosis.model import TURNED, Covariate


@dataclass(frozen=True)
class TouchDescription:
    """What touches depend on, as far as it does not take a set-up to say so."""

    data: Touches
    reading_unit: ClassVar[str] = "µm"

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Axis positions, senses, time or order, feed, place, direction, point."""
        data = self.data
        out = [
            Covariate(f"{name.upper()} position", np.asarray(deg), "deg", 360.0, turns=True)
            for name, deg in data.rotary_deg.items()
        ]
        if data.time_s is not None:
            out.append(Covariate("time", np.asarray(data.time_s), "s", sequence=True, turns=True))
        order = np.arange(len(data))
        out.append(Covariate("order of measurement", order, sequence=True, turns=True))
        if data.feed_mm_min is not None:
            out.append(Covariate("feed", np.asarray(data.feed_mm_min), "mm/min"))
        nominal = nominal_mm(data)
        out += [Covariate(f"{axis} place", nominal[:, i], "mm") for i, axis in enumerate("XYZ")]
        azimuth = np.degrees(np.arctan2(data.dir_y, data.dir_x))
        flat = np.hypot(data.dir_x, data.dir_y) > 1e-6
        azimuth = np.where(flat, azimuth, 0.0)
        out.append(Covariate("approach azimuth", azimuth, "deg", period=360.0, known=flat))
        out += [
            Covariate(f"sense of {letter.upper()}", np.asarray(sense), words=TURNED, turns=True)
            for letter, sense in data.rotary_dir.items()
        ]
        if data.point is not None:
            out.append(Covariate("point", np.asarray(data.point), classes=True))
        return tuple(out)

    @property
    def components(self) -> Mapping[str, Floats]:
        """A displacement along a machine axis enters with the approach's component."""
        d = self.data.direction
        return {"X": d[:, 0], "Y": d[:, 1], "Z": d[:, 2]}


def nominal_mm(data: Touches) -> Floats:
    """Ball centre at contact, (n, 3), rounded to what a plan may have asked for."""
    return np.asarray(np.round(data.position_mm * 2) / 2)

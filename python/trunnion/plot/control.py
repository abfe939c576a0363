"""What goes into a control: settings old and new, what they leave, corrected programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trunnion.base.report import SHOWN
from trunnion.base.units import ARCSEC
from trunnion.compensation.forecast import EXACT, MAP, NOTHING, PARAMETERS, CompensationForecast
from trunnion.compensation.parameters import Removable
from trunnion.compensation.printed_zeros import PrintedZeros
from trunnion.compensation.uncertainty import ResidualInterval
from trunnion.compensation.verification import BallVerification
from trunnion.controls.files import ControlFiles, Setting
from trunnion.controls.part_program import CorrectedProgram
from trunnion.plot.picture import Axis, Kind, Picture, arrows, line
from trunnion.plot.statistics import bars_picture, change_picture, with_limit
from trunnion.plot.style import BLUE, MUTED, OCHRE, VERMILLION
from trunnion.setup.names import called

MAX_SETTINGS = 24  # of a unit
NORMAL_SHARE = 1.25  # of the tilt: the reach of its map


def setting_pictures(settings: Setting | Sequence[Setting]) -> list[Picture]:
    """Return numbers of a control, old and new, a picture for each unit."""
    listed = (settings,) if isinstance(settings, Setting) else settings
    found = []
    for unit in dict.fromkeys(one.unit for one in listed):
        mine = [one for one in listed if one.unit == unit]
        before = {one.name: one.old for one in mine if one.old is not None}
        after = {one.name: one.new for one in mine[:MAX_SETTINGS]}
        title = "What is set in the control"
        if len(mine) > MAX_SETTINGS:
            title += f": {MAX_SETTINGS} of {len(mine)} values"
        if before:
            found.append(change_picture(title, "Value", unit, before, after, ("old", "new")))
        else:
            found.append(bars_picture(title, "New value", unit, after, digits=4))
    return found


def control_files_pictures(made: ControlFiles) -> list[Picture]:
    """Return the largest error without and with the files, then what is set."""
    small = f" (less than {SHOWN:g} µm)" if made.after_um < SHOWN else ""
    left_um = 0.0 if small else made.after_um  # rounding of the computer is no number for people
    left = bars_picture(
        f"{made.control}, machine as estimated",
        "Largest volumetric error",
        "µm",
        {"without the files": made.before_um, f"with the files{small}": left_um},
        digits=3,
    )
    if made.interval_um is not None:
        left = with_intervals(left, {1: made.interval_um}, "with its uncertainty, 95 %")
    return [left, *setting_pictures(made.settings)]


def with_intervals(p: Picture, at: Mapping[int, tuple[float, float]], label: str) -> Picture:
    """Return bars with an interval beside some of them: place → from and to."""
    tick = 0.18
    ends = [np.r_[np.repeat(span, 3), np.nan] for span in at.values()]
    places = [k + tick * np.array([-1, 1, 0, 0, -1, 1, 0]) for k in at]
    shown = line(np.concatenate(ends), np.concatenate(places), label, colour=VERMILLION)
    top = max([*(high for _, high in at.values()), *(p.x.limits or (0.0, 0.0))])
    x = Axis(p.x.label, p.x.unit, limits=(p.x.limits[0] if p.x.limits else 0.0, 1.15 * top))
    notes = tuple((max(x, at.get(int(y), (0.0, x))[1]), y, text) for x, y, text in p.notes_at)
    return replace(p, x=x, series=(*p.series, shown), notes_at=notes)


def forecast_picture(found: CompensationForecast) -> Picture:
    """Return the largest error that each way to compensate leaves, and its interval."""
    ways = [one for one in found.left if one.name in (NOTHING, PARAMETERS, MAP, EXACT)]
    values = {one.name: one.max_um if one.max_um >= SHOWN else 0.0 for one in ways}
    p = bars_picture(
        "Largest volumetric error left", "Largest volumetric error", "µm", values, digits=3
    )
    spans = {k: span for k, one in enumerate(ways) if (span := one.max_interval_um)}
    return with_intervals(p, spans, "with its uncertainty, 95 %") if spans else p


def residual_interval_picture(r: ResidualInterval) -> Picture:
    """Return the bounds on what a compensation will leave, and the intervals."""
    percent = f"{100 * r.level:g} %"
    bounds = {"largest": r.max_bound_um, "rms": r.rms_bound_um}
    p = bars_picture(
        f"Volumetric error after compensation, below with {percent} probability",
        "Volumetric error",
        "µm",
        bounds,
        digits=3,
    )
    return with_intervals(p, {0: r.max_um, 1: r.rms_um}, f"{percent} interval")


def ball_verification_picture(found: BallVerification) -> Picture:
    """Return how far a ball on the table leaves its mean place, before and after, and forecast."""
    before = {} if found.max_before_um is None else {"before": found.max_before_um}
    values = {**before, "after": found.max_after_um}
    title = f"Ball on the table at {len(found.after_um)} postures"
    p = bars_picture(title, "Largest distance from its mean place", "µm", values, digits=3)
    if found.forecast_um is None:
        return with_intervals(p, {len(before): found.touches_um}, "touches alone, 95 %")
    return with_intervals(p, {len(before): found.forecast_um}, "forecast, 95 %")


def corrected_program_picture(made: CorrectedProgram) -> Picture:
    """Return the largest error of the tool point before and after, beside the tolerance."""
    before = {} if made.before_um is None else {"program as it was": made.before_um}
    values = {**before, "corrected program": made.left_um}
    title = f"Corrected program: {made.moves_after} moves, {made.moves_before} before"
    p = bars_picture(title, "Largest error of the tool point", "µm", values, digits=3)
    return with_limit(p, made.tolerance_um, "tolerance", colour=OCHRE, dash="dash")


def removable_picture(one: Removable) -> Picture:
    """Return what one unit of an error makes, without parameters and with the best ones."""
    values = {"without compensation": one.before_um, "with the best parameters": one.left_um}
    label, unit = "Volumetric error, rms", f"µm per {one.unit}"
    return bars_picture(called(one.name), label, unit, values, digits=3)


def printed_zeros_pictures(found: PrintedZeros) -> list[Picture]:
    """Return the tilt of the table's normal as the control sees it, and the origin offsets."""
    x, y = (v / ARCSEC for v in found.normal[:2])
    reach = NORMAL_SHARE * max(abs(x), abs(y), 1.0)
    solutions = " or ".join(
        f"A = {a:+.4f}°, C = {c:+.2f}°" for a, c in zip(found.a_deg, found.c_deg, strict=True)
    ).replace("-", "−")
    limits = (-reach, reach)
    tilt = Picture(
        f"Normal of the table; zeros by (22) to (24): {solutions}",
        Axis("Tilt towards X", "arcsec", limits=limits),
        Axis("Tilt towards Y", "arcsec", limits=limits),
        (
            line([-reach, reach, np.nan, 0, 0], [0, 0, np.nan, -reach, reach], colour=MUTED),
            arrows([0.0], [0.0], [x], [y], "normal", colour=BLUE, width=2.0),
        ),
        Kind.MAP,
    )
    work = {f"along {name[1].upper()}": value for name, value in found.work.items()}
    label = "Origin offset"
    return [tilt, bars_picture("Origin offsets in the work coordinates", label, "µm", work)]

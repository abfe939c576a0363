"""Values that a shop enters in an error table of a control, of causes that one takes off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trunnion.base.report import Cell, Shown, Table, measured
from trunnion.base.units import capital
from trunnion.data.iso230_2 import Iso2302
from trunnion.diagnosis.families import family_of
from trunnion.diagnosis.records import Cause
from trunnion.plot.coordinates import TURNED
from trunnion.plot.diagnosis import Explained
from trunnion.reports.causes import Found
from trunnion.reports.document import Item
from trunnion.reports.results import COVERAGE, EXPANDED
from trunnion.reports.standard import Standard, titled

STEP_DEG = 15.0
EXACT = 1e-6  # of the largest deviation: it is 0 there by definition
OPPOSITE = "A control adds the opposite of these deviations."
WHOLE = (
    "Mean deviations as measured: scale, curve and reversal are all in them, so nothing is entered "
    "beside them. Offset of the instrument and drift are, too: measure a warm machine."
)


def error_tables(found: Found, standard: Sequence[Standard]) -> list[Item]:
    """Return deviations of an axis by position."""
    out: list[Item] = []
    for c in found.d.causes:
        if family_of(c.id).name == "positioning, rotary axis":
            out += _turned(found, c)
    if found.d.causes:
        stops = [(name, _stops(r)) for name, r in standard if isinstance(r, Iso2302)]
        out += [titled(table, name) for name, table in stops]
        out += [WHOLE] if stops else []
    return [*out, OPPOSITE] if out else []


def _turned(found: Found, c: Cause) -> list[Item]:
    """A cause as an angle of its axis, every 15 degrees."""
    of = Explained.of(found.d, c.id)
    where = of.coordinate
    if where is None or TURNED not in where.weight.name or where.x.unit != "deg":
        return []
    (_, x, fitted), *more = of.curves(where)
    if more or len(x) < 3:
        return []
    size = float(np.abs(fitted).max())
    rows: list[tuple[Cell, ...]] = []
    for at in np.arange(np.ceil(x[0] / STEP_DEG) * STEP_DEG, x[-1], STEP_DEG):
        value, *parts = (float(np.interp(at, x, column)) for column in fitted.T)
        if np.isfinite(value):
            u = COVERAGE * float(np.linalg.norm(parts))
            said = measured(value, u) if u > EXACT * size else (Shown(0.0, "0"), Shown(0.0, "0"))
            rows.append((Shown(float(at), f"{at:g}"), *said))
    heads = ("position, °", f"{TURNED}, arcsec", EXPANDED)
    return [Table.of(capital(found.label(c.id)), heads, rows)]


def _stops(r: Iso2302) -> Table:
    """Mean deviations of a positioning test at its targets, both directions and their mean."""
    rows = [
        (Shown(t, f"{t:g}"), *(Shown(v, f"{v:+.1f}".replace("-", "−")) for v in (up, down, both)))
        for t, up, down, both in zip(
            r.targets.tolist(),
            r.mean_forward.tolist(),
            r.mean_backward.tolist(),
            ((r.mean_forward + r.mean_backward) / 2).tolist(),
            strict=True,
        )
    ]
    unit, place = ("arcsec", "°") if r.unit_name() == "arcsec" else ("µm", "mm")
    heads = [f"target, {place}", *(f"{s}, {unit}" for s in ("forward ↑", "backward ↓", "mean"))]
    return Table.of("Deviations by target", heads, rows)

"""Steps that are recognised in recorded numbers: in which a control, a scale, a display counts."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from trunnion.base.units import Floats

MAX_ROUNDING = 1e-13  # of the largest reading: rounding of numbers
MIN_STEP = 1e-8  # µm, arcsec: what computers make of coordinates of metres
MAX_PARTS = 5  # steps between the nearest readings
SAME_STEP = 0.02
MAX_STEP_SIGMAS = 100.0  # of steps that are recognised; a fit takes much of what rounding leaves
MIN_EXACT = 8  # distinct readings that a step is recognised in although they fit far better
SMALLEST = 1e-3  # µm, arcsec: steps below this are digits that no instrument resolves
COARSER = 1.5  # times a stated step, that a recognised one is to be taken instead
OF_PLAN = 1e-2  # of a step of the places of a plan: what a scale error makes of it, at most


def recognised(values: Floats) -> float:
    """Return the largest step whose multiples readings differ by; 0: none.

    Such a step is the tick of a control, the resolution of an instrument, or the digits of a file.
    """
    distinct = np.unique(values)
    gaps = np.diff(distinct)
    rounding = max(MAX_ROUNDING * float(np.abs(distinct).max(initial=0.0)), MIN_STEP)
    gaps = gaps[gaps > rounding]
    if not len(gaps):
        return 0.0
    off = distinct - distinct[0]
    for step in float(gaps.min()) / np.arange(1, MAX_PARTS + 1):
        if step > rounding and np.all(np.abs(off - step * np.round(off / step)) < SAME_STEP * step):
            return float(step)
    digits = 10.0 ** np.floor(np.log10(float(gaps.min())))
    while digits > rounding:
        count = np.round(off / digits)
        if np.all(np.abs(off - digits * count) < SAME_STEP * digits):
            return float(digits * np.gcd.reduce(count.astype(np.int64)))
        digits /= 10
    return 0.0


def on_grid(values: Floats, step: float) -> bool:
    """Whether values differ by multiples of a step."""
    off = (values - values[:1]) / step
    return bool(np.all(np.abs(off - np.round(off)) < SAME_STEP))


def unstated(
    recorded: Sequence[Floats],
    stated: float,
    sigma: float,
    off: Callable[[], Floats],
    planned: float = 0.0,
) -> float:
    """Coarsest step that is recognised in what was recorded, above the stated one; 0: none.

    Places of a plan lie on a regular grid, too: a step far above the standard deviation of the
    readings is one only where none is stated, and they differ from what a machine without errors
    gives (``off``), or where places of the plan lie on a coarser one (``planned``, 0: not known).
    """
    # Numbers are whole steps from 0, too: seen where all differ by what a plan has between places.
    off = cache(off)
    found = ((recognised(v), one) for one in recorded for v in (one, np.append(one, 0.0)))
    for step, values in sorted(found, key=_first, reverse=True):
        if step <= COARSER * stated:
            break
        many = stated == 0 and step >= SMALLEST and len(np.unique(values)) >= MIN_EXACT
        if step > MAX_STEP_SIGMAS * sigma and not many:
            continue
        more = off()
        if _is_of_plan(step, values, more):
            continue
        seen = np.any(np.abs(more) > SAME_STEP * step) or planned > COARSER * step
        if seen or step <= MAX_STEP_SIGMAS * sigma:
            return step
    return 0.0


def _is_of_plan(step: float, values: Floats, off: Floats) -> bool:
    """Whether places of a plan lie on about this step, which the machine made another."""
    if values.shape != off.shape:
        return False
    planned = recognised(np.append(values - off, 0.0))
    return planned > 0 and MIN_STEP < abs(step - planned) < OF_PLAN * planned


def _first(pair: tuple[float, Floats]) -> float:
    return pair[0]

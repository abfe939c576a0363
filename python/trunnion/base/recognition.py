"""Steps that are recognised in recorded numbers: in which a control, a scale, a display counts."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from operator import itemgetter

import numpy as np

from trunnion.base.units import Floats

MAX_ROUNDING = 1e-13  # of the largest reading: rounding of numbers
MIN_STEP = 1e-8  # µm, arcsec: what computers make of coordinates of metres
MAX_PARTS = 5  # steps between the nearest readings
SAME_STEP = 0.02
FEW = 64  # numbers by which a step is refused before all are tried
MAX_STEP_SIGMAS = 100.0  # of steps that are recognised; a fit takes much of what rounding leaves
MIN_EXACT = 8  # distinct readings that a step is recognised in although they fit far better
SMALLEST = 1e-3  # µm, arcsec: steps below this are digits that no instrument resolves
COARSER = 1.5  # times a stated step, that a recognised one is to be taken instead
UNITS = (1.0, 3.6, 2.54)  # µm or arcsec; degrees, in arcsec; inches, in µm: but for powers of ten
MAX_MULTIPLE = 1000  # of the step of a display, that readings show in its place
SAME_MULTIPLE = 1e-3
MAX_CHANCE = 1e-6  # that readings of a finer display are all multiples of more
OF_PLAN = 1e-2  # of a step of the places of a plan: what a scale error makes of it, at most


def recognised(values: Floats) -> float:
    """Return the largest step whose multiples readings differ by; 0: none.

    Such a step is the tick of a control, the resolution of an instrument, or the digits of a file.
    """
    return next(all_recognised(values), 0.0)


def all_recognised(values: Floats) -> Iterator[float]:
    """Steps whose multiples readings differ by, about, and then by all digits.

    Places of a plan differ by about its step, and exactly by multiples of that of an instrument.
    """
    distinct = np.unique(values)
    gaps = np.diff(distinct)
    rounding = max(MAX_ROUNDING * float(np.abs(distinct).max(initial=0.0)), MIN_STEP)
    gaps = gaps[gaps > rounding]
    if not len(gaps):
        return
    off, least = distinct - distinct[0], float(gaps.min())
    steps = (least / np.arange(1, MAX_PARTS + 1)).tolist()
    digits = [float(10.0 ** np.floor(np.log10(least)))]
    while digits[-1] > rounding:
        digits.append(digits[-1] / 10)
    if about := _first_on(off, [step for step in steps if step > rounding]):
        yield about
    if exact := _first_on(off, digits[:-1]):
        count = np.round(off / exact)
        yield float(exact * np.gcd.reduce(count.astype(np.int64)))


def _first_on(off: Floats, steps: Sequence[float]) -> float:
    """Return the first of some steps of which all numbers are about multiples; 0: none."""
    # Nearly all steps fail by a few numbers: these are tried for all of them at once.
    every, few = np.array(steps), off[:FEW, None]
    likely = np.all(np.abs(few - every * np.round(few / every)) < SAME_STEP * every, axis=0)
    for step in every[likely].tolist():
        if np.all(np.abs(off - step * np.round(off / step)) < SAME_STEP * step):
            return float(step)
    return 0.0


def as_displayed(step: float, distinct: int) -> float:
    """Return the step of a display, 1, 2 or 5·10^k, that a recognised step is a multiple of.

    Few readings all differ by multiples of more than their step, by chance: a reversal of 8 µm is
    no step of 8 µm. The recognised step is kept where so many ``distinct`` readings hardly would,
    where it is one of a display in degrees or inches, and where it is a multiple of none (a tick,
    which is feed times period).
    """
    if not step > 0 or any(_is_round(step / unit) for unit in UNITS):
        return step
    top = int(np.floor(np.log10(step)))
    steps = (digit * 10.0**k for k in range(top, top - 4, -1) for digit in (5.0, 2.0, 1.0))
    for shown in (s for s in steps if step / MAX_MULTIPLE <= s < step):
        times = step / shown
        if abs(times - round(times)) < SAME_MULTIPLE:
            by_chance = times ** (1 - distinct)
            return shown if by_chance > MAX_CHANCE else step
    return step


def displayed(values: Floats, others: Sequence[Floats] = ()) -> float:
    """Return the step that readings are displayed in, as they show it; 0: none.

    ``others``: the same readings otherwise, such as less their targets: where these are few, the
    readings lie on the grid of the targets.
    """
    return next(all_displayed(values, others), 0.0)


def all_displayed(values: Floats, others: Sequence[Floats] = ()) -> Iterator[float]:
    """Steps that readings may be displayed in, as `all_recognised` gives them."""
    distinct = min(len(np.unique(v)) for v in (values, *others))
    return (as_displayed(step, distinct) for step in all_recognised(values))


def _is_round(step: float) -> bool:
    """Whether a step is 1, 2 or 5·10^k."""
    digit = step / 10.0 ** np.floor(np.log10(step) + SAME_MULTIPLE)
    return bool(min(abs(digit - d) for d in (1.0, 2.0, 5.0)) < SAME_MULTIPLE)


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
    readings is one only where none is stated, or readings in stated steps would not all be on it by
    chance; and where they differ from what a machine without errors gives (``off``), or places of
    the plan lie on a coarser one (``planned``, 0: not known).
    """
    # Numbers are whole steps from 0, too: seen where all differ by what a plan has between places.
    off = cache(off)
    known = [np.unique(one) for one in recorded]
    distinct = min(map(len, known), default=0)
    every = zip(known, recorded, strict=True)
    both = ((v, one) for own, one in every for v in (own, np.append(own, 0.0)))
    steps = ((step, one) for v, one in both for step in all_recognised(v))
    found = ((as_displayed(step, distinct), one) for step, one in steps)
    for step, values in sorted(found, key=itemgetter(0), reverse=True):
        if step <= COARSER * stated:
            break
        many = step >= SMALLEST and len(np.unique(values)) >= MIN_EXACT
        if many and stated > 0:  # so many readings in steps of it hardly are all on this one
            many = (stated / step) ** len(np.unique(np.round(off() / stated))) <= MAX_CHANCE
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
    """Whether places of a plan lie on about this step, which the machine made another.

    Or on this very step, of which readings miss multiples: two that differ by it are no step.
    """
    own = values[: len(off)]  # without the 0 from which steps may count
    if own.shape != off.shape:
        return False
    planned = recognised(np.append(own - off, 0.0))
    if not planned > 0 or abs(step - planned) >= OF_PLAN * planned:
        return False
    return abs(step - planned) > MIN_STEP or not _exactly_on(own, step)


def _exactly_on(values: Floats, step: float) -> bool:
    """Whether values differ by multiples of a step to all digits."""
    off = values - values[:1]
    rounding = max(MAX_ROUNDING * float(np.abs(values).max(initial=0.0)), MIN_STEP)
    return bool(np.all(np.abs(off - step * np.round(off / step)) < rounding))

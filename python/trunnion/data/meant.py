"""What may have been meant by data that do not fit their model: tried, and named if it fits.

Nothing is tried unless data are refused or not explained, and no number is changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from trunnion.base.errors import DataError, KinematicsError, TrunnionError
from trunnion.base.units import unit_of
from trunnion.data.apart import rows_apart, said_of
from trunnion.data.deviations import from_deviations, nominal_readings, of_another_bar
from trunnion.data.mistaken import factors, listed, of_number
from trunnion.data.shifted import displaced_rows
from trunnion.files.table import Table
from trunnion.setup import Machine, Setup
from trunnion.setup.machines import presets

T = TypeVar("T", bound=Table)

Scatter: TypeAlias = Callable[[Any, Any], float]
"""``scatter(data, setup)``: rms of what the plain model leaves; it raises where nothing fits."""

SHARE = 0.1
"""Of the scatter: what a guess has to leave at most."""
BETTER = 0.5
"""Of what the causes that were found leave: what a guess has to leave without any, at most."""
MAX_LEFT = 500.0
"""Scatter (µm, arcsec) that a guess leaves at most of data that are refused as they are."""
MAX_RELATIVE = 1e-3
"""Of positions: the same. Smaller positions would scatter less whatever was wrong with them."""
RIVAL_FACTOR = 2.0
"""Guesses that leave up to so many times the scatter of the best are named beside it."""
TOO_LARGE = {"mm": 6e4, "µm": 2e3}
"""Readings beyond these are of another unit."""
MIN_VARIATION = 0.02
"""Of readings in µm, of their size: diameters of one part in place of their errors vary by less."""
MAX_RIVALS = 4
TURNED = " (turned by 180°: all errors have the other sign)"
MAX_ROWS = 500


class Guess(NamedTuple):
    """What may have been meant.

    text: How it reads.
    scale: What the readings were multiplied by, for scatters to be compared.
    subject, factor: Columns that were scaled, and how far; of others "" and 1.
    """

    text: str
    data: Any
    setup: Any
    scale: float = 1.0
    subject: str = ""
    factor: float = 1.0


def out_of_order(text: str) -> DataError:
    """Return the error of rows in another order than the readings were taken.

    It names its cause itself: an axis that counts the other way changes the order, too.
    """
    error = DataError(text)
    error.cause_known = True
    return error


@contextmanager
def meant_named(data: Any, setup: Any, scatter: Scatter) -> Iterator[None]:
    """Add the likely cause to an error about data that cannot belong to their model."""
    try:
        yield
    except (DataError, KinematicsError) as error:
        known = isinstance(error, DataError) and error.cause_known
        if not known and (cause := _likely_cause(data, setup, scatter)):
            text = str(error)
            error.args = (f"{text}{'' if text.endswith('?') else '.'} Likely cause: {cause}",)
        raise


def _likely_cause(data: Any, setup: Any, scatter: Scatter) -> str:
    """Say what makes refused data fit: without a few rows, else as otherwise meant."""
    if isinstance(data, Table) and len(data):
        if displaced := displaced_rows(data):
            return displaced
        for apart in rows_apart(data, nominal_readings(data)):
            with suppress(TrunnionError):
                without = Guess("", some_rows(data[~apart]), setup)
                left = scatter(without.data, setup)
                if _fits(without, left):
                    fit = f"without {'it' if apart.sum() == 1 else 'them'} the data fit to"
                    return f"{said_of(data, apart)}; {fit} {left:.3g} {_unit(data)}."
    return likely_meant(data, setup, scatter, _fits)


def likely_better(data: Any, setup: Any, scatter: Scatter, before: float, after: float) -> str:
    """Say with what data fit far better than with the causes that were found; empty: with none.

    before, after: Scatter of the data as they are, without and with these causes.
    """
    most = min(SHARE * before, BETTER * after)
    return likely_meant(data, setup, scatter, lambda guess, left: left / guess.scale <= most)


def likely_meant(
    data: Any, setup: Any, scatter: Scatter, fits: Callable[[Guess, float], bool]
) -> str:
    """Say with what other unit, sense or machine the data fit; empty: with none that is tried."""
    if not isinstance(data, Table) or not len(data):
        return ""
    tried = []
    for guess in guesses(some_rows(data), setup):
        with suppress(TrunnionError):  # nothing that the model takes, either
            left = scatter(guess.data, guess.setup)
            if fits(guess, left):
                tried.append((left / guess.scale, left, guess))
    if not tried:
        return ""
    best = min(tried, key=lambda one: one[0])[0]
    near = [one for one in tried if one[0] <= RIVAL_FACTOR * best]
    kept = [one for one in near if not any(_nearer(other[2], one[2]) for other in near)]
    texts = [guess.text for _, _, guess in kept[:MAX_RIVALS]]
    if len(kept) > MAX_RIVALS:
        texts.append("what comes to the same")
    left = min(left for _, left, _ in kept)
    return f"the data fit to {left:.3g} {_unit(data)} {', or '.join(texts)}."


def _fits(guess: Guess, left: float) -> bool:
    """Whether data that are refused as they are would be of a machine."""
    columns = {**guess.data.readings, **guess.data.set_positions}
    places = [np.abs(v).max() for n, v in columns.items() if unit_of(n) == "mm"]
    return left <= min(MAX_LEFT, MAX_RELATIVE * 1e3 * max(places, default=np.inf))


def _nearer(other: Guess, guess: Guess) -> bool:
    """Whether another guess scales the same set positions by less."""
    same = other.subject == guess.subject != "" and other.scale == guess.scale == 1.0
    return same and abs(np.log(other.factor)) < abs(np.log(guess.factor))


def guesses(data: Table, setup: Any) -> Iterator[Guess]:
    """Yield what may have been meant."""
    for names in (tuple(data.readings), tuple(data.set_positions)):
        yield from _scaled(data, setup, names)
    yield from _scaled(data, setup, (*data.readings, *data.set_positions), both=True)
    for text, meant, factor in from_deviations(data):
        yield Guess(text, meant, setup, factor)
    for text, meant in of_another_bar(data):
        yield Guess(text, meant, setup)
    for name in (*data.set_positions, *data.readings):
        with suppress(TrunnionError):
            meant = data.with_columns(**{name: -data[name]})
            yield Guess(f"if {name} counts the other way{_sense(name)}", meant, setup)
    for one, other in combinations([name for name in data.vector if name in data.readings], 2):
        with suppress(TrunnionError):
            meant = data.with_columns(**{one: -data[one], other: -data[other]})
            yield Guess(f"if {one} and {other} count the other way{TURNED}", meant, setup)
    for names in (tuple(data.readings), tuple(data.set_positions)):
        for one, other in combinations(names, 2):
            if unit_of(one) == unit_of(other):
                meant = data.with_columns(**{one: data[other], other: data[one]})
                yield Guess(f"if {one} and {other} are exchanged", meant, setup)
    if isinstance(setup, Setup) and any(unit_of(n) == "deg" for n in data.set_positions):
        for preset in presets():
            if preset != setup.machine.name:
                with suppress(TrunnionError):
                    other_setup = replace(setup, machine=Machine(preset))
                    yield Guess(f'with preset = "{preset}"', data, other_setup)


def _scaled(
    data: Table, setup: Any, names: tuple[str, ...], *, both: bool = False
) -> Iterator[Guess]:
    """Columns of one unit are in another, or were converted as if they were.

    both: Readings and set positions, where both have the unit.
    """
    for unit in dict.fromkeys(map(unit_of, names)):
        some = [name for name in names if unit_of(name) == unit]
        if both and len({name in data.readings for name in some}) < 2:
            continue
        singles = [[name] for name in some] if len(some) > 1 and not both else []
        for mine in (some, *singles):
            smaller_fits = _smaller_is_told(data, mine, alone=len(mine) < len(some))
            for said, factor in factors(unit).items():
                if factor < 1 and not (smaller_fits and _vary(data, mine)):
                    continue
                with suppress(TrunnionError):  # too far for positions
                    meant = data.with_columns(**{name: factor * data[name] for name in mine})
                    text = f"if {listed(mine)} {of_number(said, len(mine))} (× {factor:.4g})"
                    scale = factor if mine[0] in data.readings else 1.0
                    # The other readings are as large as before.
                    scale = scale if len(mine) == len(some) else min(scale, 1.0)
                    yield Guess(text, meant, setup, scale, listed(mine), factor)


def _smaller_is_told(data: Table, names: Sequence[str], *, alone: bool = False) -> bool:
    """Whether a model, or their size, tells smaller values of columns from those given.

    Smaller readings are nearer to any model that no column of their unit ties down.
    alone: Other readings of the unit stay: only set positions tie these down.
    """
    unit = unit_of(names[0])
    others = {*data.set_positions, *(() if alone else data.readings)} - set(names)
    tied = any(unit_of(name) == unit for name in others)
    size = max(float(np.abs(data[name]).max()) for name in names)
    return not set(names) & set(data.readings) or tied or size > TOO_LARGE.get(unit, np.inf)


def _vary(data: Table, names: Sequence[str]) -> bool:
    """Whether readings vary by a share of their size: what does not is no small reading."""
    if not set(names) <= set(data.readings) or unit_of(names[0]) != "µm":
        return True
    return any(np.ptp(data[n]) > MIN_VARIATION * np.abs(data[n]).max() for n in names)


def _sense(name: str) -> str:
    """How to say it in the set-up."""
    return f" (sense of axis {name[0].upper()})" if name in ("a_deg", "b_deg", "c_deg") else ""


def _unit(data: Table) -> str:
    """Unit of the residuals."""
    units = {unit_of(name) for name in data.readings}
    return {"mm": "µm", "deg": "arcsec"}.get(min(units), min(units)) if len(units) == 1 else "µm"


def some_rows(data: T) -> T:
    """Take some of many rows, in order: enough to recognise a mistake.

    Of samples of a log the first: each follows from those before it.
    """
    if len(data) <= MAX_ROWS:
        return data
    if (clock := data.kinds.get("time_s")) is not None and clock.required:
        return data[:MAX_ROWS]
    return data[np.sort(np.random.default_rng(0).permutation(len(data))[:MAX_ROWS])]

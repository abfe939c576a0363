"""Ranked bars: what causes contribute, and how often a diagnosis is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.errors import InputError
from trunnion.compensation.parameters import CncParameters
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.many import DiagnosisBatch
from trunnion.plot.picture import Picture, bars
from trunnion.plot.statistics import percent_picture, stacked_picture
from trunnion.plot.style import BLUE, GREEN, MUTED, RED, SKY
from trunnion.setup.names import error_label

RATES = {"found": GREEN, "aliased": SKY, "missed": MUTED, "wrong": RED}
"""Outcomes of a diagnosis with their colours."""


def plot_contributions(d: Diagnosis, *, ax: Any = None, **style: Any) -> Any:
    """Draw the share of each named cause in what the plain model leaves, in percent."""
    picture = contributions_picture(d)
    if picture is None:
        raise InputError("plot_contributions: got a diagnosis without a cause, expected one with")
    return picture.draw(ax, **style)


def contributions_picture(d: Diagnosis) -> Picture | None:
    """Return the causes ranked by their share of the residual mean square; None without any."""
    ranked = sorted(d.contributions, key=lambda c: -c.share)
    if not ranked:
        return None
    left = max(0.0, 1 - sum(c.share for c in ranked))
    names = (*(c.label or c.id for c in ranked), "residual")
    values = 100 * np.array([*(c.share for c in ranked), left])
    named = np.append(np.ones(len(ranked), dtype=bool), False)
    unit = ranked[0].unit
    hover = (*(f"{c.rms_um:.3g} {unit} rms" for c in ranked), "")
    series = (
        bars(np.where(named, values, np.nan), colour=BLUE, hover=hover),
        bars(np.where(named, np.nan, values), colour=MUTED),
    )
    title = "Causes ranked by what they explain"
    return percent_picture(title, "Share of mean square", names, values, series)


def plot_rates(
    names: Sequence[str], rates: Mapping[str, ArrayLike], *, ax: Any = None, **style: Any
) -> Any:
    """Draw rates of a power study as bars that add up to 100 %.

    Parameters
    ----------
    names
        Of the effects.
    rates
        Outcome → rate of each effect in percent, (n,); outcomes in the order in which they are
        stacked, such as "found", "aliased", "missed", "wrong".
    ax, **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes them.
    """
    return rates_picture(names, rates).draw(ax, **style)


def rates_picture(names: Sequence[str], rates: Mapping[str, ArrayLike]) -> Picture:
    """Return rates as stacked bars."""
    for outcome, values in rates.items():
        if (shape := np.shape(values)) != (len(names),):
            raise InputError(f"{outcome}: got shape {shape}, expected one a name, {(len(names),)}")
    return stacked_picture("How often it is right", "Share of the runs", names, rates, RATES)


def plot_cnc_parameters(p: CncParameters, *, ax: Any = None, **style: Any) -> Any:
    """Draw how much of each error the best parameters of a control leave, in percent."""
    found = cnc_parameters_pictures(p)
    if not found:
        raise InputError(
            'plot_cnc_parameters: got parameters by method "direct", expected "least-squares": '
            "they know what is left of each error"
        )
    return found[0].draw(ax, **style)


def cnc_parameters_pictures(p: CncParameters) -> list[Picture]:
    """Return what is left of each error as bars; nothing where it was not asked for."""
    ranked = sorted(p.removable, key=lambda one: -one.share_left)
    if not ranked:
        return []
    left = np.array([100 * one.share_left for one in ranked])
    names = [error_label(one.name) for one in ranked]
    title, label = "What such parameters leave of each error", "Left of its volumetric error, rms"
    return [percent_picture(title, label, names, left)]


def batch_pictures(batch: DiagnosisBatch) -> list[Picture]:
    """Return the explained share of each measurement as bars; nothing where all have failed."""
    done = [
        (name, one)
        for name, one in zip(batch.names, batch.results, strict=True)
        if isinstance(one, Diagnosis)
    ]
    if not done:
        return []
    shares = np.array([100 * sum(c.share for c in one.contributions) for _, one in done])
    names = [f"{Path(name).name}: {one.verdict}" for name, one in done]
    title = "What the causes explain of each measurement"
    return [percent_picture(title, "Share of mean square", names, shares)]

"""Closed forms, least squares and the CasADi identification on the same touches, side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.report import Cell, Result, Shown, Table
from trunnion.data.touches import Touches
from trunnion.probing.closed_form import closed_form
from trunnion.probing.identify import identify
from trunnion.probing.result import ClosedFormResult, IdentificationResult
from trunnion.reference import casadi_baseline
from trunnion.setup import Setup


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """What each method makes of the same touches.

    Attributes
    ----------
    results
        By method; a method that cannot be used on these touches is missing.
    time_ms
        Shortest of three runs, one thread, by method.
    refused
        Why a method is missing, by method.
    truth
        True location errors where they are known, µm and arcsec.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> found = tn.compare_methods(touches, setup)
    >>> round(found.results["least squares"]["EX0C"], 2)
    14.95
    """

    results: Mapping[str, ClosedFormResult | IdentificationResult]
    time_ms: Mapping[str, float]
    refused: Mapping[str, str]
    truth: Mapping[str, float] | None = None

    def sentences(self) -> Sequence[str]:
        """Methods that estimate, and why one is missing."""
        return (
            f"Methods that estimate from these touches: {', '.join(self.results) or 'none'}.",
            *(f"{method}: {reason}" for method, reason in self.refused.items()),
        )

    def _off(self, method: str) -> dict[str, float | None]:
        """Estimates, less the truth where it is known; None for what is not identifiable."""
        result, truth = self.results[method], self.truth or {}
        return {
            name: value - truth.get(name, 0.0)
            if np.isfinite(result.std_errors.get(name, 0.0))
            else None
            for name, value in result.errors.items()
        }

    def tables(self) -> tuple[Table, ...]:
        """Estimates (less the truth where it is known), then what a method sees and its time."""
        names = [name for result in self.results.values() for name in result.errors]
        columns = list(dict.fromkeys(names))
        off = {method: self._off(method) for method in self.results}
        what = "estimate − truth" if self.truth is not None else "estimates"
        rows: list[tuple[Cell, ...]] = []
        for method, result in self.results.items():
            seen = sum(bool(np.isfinite(error)) for error in result.std_errors.values())
            time_ms = self.time_ms[method]
            rows.append(
                (method, result.placement is not None, seen, Shown(time_ms, f"{time_ms:.3f}"))
            )
        return (
            Table.of(
                f"Location errors, {what} (µm, arcsec)",
                ("method", *columns),
                [(method, *(off[method].get(name) for name in columns)) for method in off],
            ),
            Table.of(
                "Methods", ("method", "placement", "identifiable parameters", "time ms"), rows
            ),
        )


@checked
def compare_methods(
    data: Touches, setup: Setup, truth: Mapping[str, float] | None = None
) -> Comparison:
    """Estimate the location errors by every method there is.

    Parameters
    ----------
    data, setup
        Touches and their set-up. Closed forms want the paper's plan.
    truth
        True location errors, for simulated touches.

    Returns
    -------
    Comparison
        CasADi stands in `refused` where it is not installed.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> found = tn.compare_methods(touches, setup)
    >>> sorted(found.results)[:2]
    ['closed form, printed', 'closed form, separating']
    """
    methods: dict[str, Callable[[], IdentificationResult]] = {
        "closed form, printed": partial(closed_form, data, setup, method="printed"),
        "closed form, separating": partial(closed_form, data, setup, method="separating"),
        "least squares": partial(identify, data, setup),
        "least squares, CasADi": partial(casadi_baseline.identify, data, setup),
    }
    results: dict[str, IdentificationResult] = {}
    times: dict[str, float] = {}
    refused: dict[str, str] = {}
    for method, run in methods.items():
        try:
            taken = []
            for _ in range(3):
                begin = time.perf_counter()
                results[method] = run()
                taken.append(time.perf_counter() - begin)
            times[method] = 1e3 * min(taken)
        except (ValueError, ImportError) as error:
            refused[method] = str(error)
    return Comparison(results, times, refused, truth)

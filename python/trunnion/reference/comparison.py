"""Closed forms, least squares and the CasADi identification on the same touches, side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from trunnion.base.report import Table, number
from trunnion.data.touches import Touches
from trunnion.probing.closed_form import closed_form
from trunnion.probing.identify import identify
from trunnion.probing.result import IdentificationResult
from trunnion.reference import casadi_baseline
from trunnion.setup import Setup

__all__ = ["Comparison", "compare_methods"]


@dataclass(frozen=True)
class Comparison:
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
    """

    results: Mapping[str, IdentificationResult]
    time_ms: Mapping[str, float]
    refused: Mapping[str, str]
    truth: Mapping[str, float] | None = None

    def table(self) -> Table:
        """One row a method: estimates (off the truth where it is known), what it sees, its time."""
        first = next(iter(self.results.values()))
        names = list(first.errors)
        rows = []
        for method, result in self.results.items():
            truth = self.truth or {}
            cells = [
                number(result.errors[name] - truth.get(name, 0.0))
                if np.isfinite(result.std_errors.get(name, 0.0))
                else "–"
                for name in names
            ]
            seen = sum(np.isfinite(error) for error in result.std_errors.values())
            placement = "yes" if result.placement is not None else "no"
            rows.append((method, *cells, placement, str(seen), f"{self.time_ms[method]:.3f}"))
        what = "estimate − truth" if self.truth is not None else "estimates"
        return Table.of(
            f"Location errors, {what} (µm, arcsec)",
            ("method", *names, "placement", "parameters seen", "time ms"),
            rows,
        )

    def summary(self) -> str:
        """Table and refusals as text."""
        lines = [f"{method}: {reason}" for method, reason in self.refused.items()]
        return "\n".join([self.table().text(150), *lines])

    def _repr_html_(self) -> str:
        return self.table().html()


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
        CasADi is left out, with a word, where it is not installed.
    """
    methods: dict[str, Callable[[], IdentificationResult]] = {
        "closed form, printed": partial(closed_form, data, setup, method="printed"),
        "closed form, separating": partial(closed_form, data, setup, method="separating"),
        "least squares": partial(identify, data, setup),
        "casadi, Gauss-Newton": partial(casadi_baseline.identify, data, setup),
        "casadi, IPOPT": partial(casadi_baseline.identify, data, setup, solver="ipopt"),
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

"""The picture of ISO 230-2: deviations at the targets from both directions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trunnion.data.iso230_2 import Iso2302, Iso2302Rotary
from trunnion.plot.axes import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_positioning(results: Iso2302 | Iso2302Rotary, *, ax: Axes | None = None) -> Axes:
    """Draw mean deviations from each direction with ±2 s, and the accuracy A as a band."""
    ax = axes_or_new(ax, 7.5, 4.2)
    rotary = isinstance(results, Iso2302Rotary)
    unit = "arcsec" if rotary else "µm"
    forward = (results.mean_forward, results.spread_forward, "from below ↑", "tab:blue")
    backward = (results.mean_backward, results.spread_backward, "from above ↓", "tab:orange")
    for mean, spread, label, colour in (forward, backward):
        ax.fill_between(
            results.targets, mean - 2 * spread, mean + 2 * spread, color=colour, alpha=0.2
        )
        ax.plot(
            results.targets, mean, "o-", color=colour, ms=4, lw=1.3, label=f"{label}, mean ± 2 s"
        )
    low = min((mean - 2 * spread).min() for mean, spread, *_ in (forward, backward))
    high = max((mean + 2 * spread).max() for mean, spread, *_ in (forward, backward))
    for level in (low, high):
        ax.axhline(level, color="0.5", lw=0.8, ls="--")
    ax.set_title(f"Accuracy A = {high - low:.3g} {unit}", loc="left")
    ax.set_xlabel("target, degrees" if rotary else "target, mm")
    ax.set_ylabel(f"deviation, {unit}")
    ax.legend(frameon=False)
    return ax

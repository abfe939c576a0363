"""New axes and figures: the only place that imports pyplot, and only when something is drawn.

pyplot chooses a backend, which a library must not do by being imported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float) -> Figure:
    """Return a new figure of this size in inches, laid out so that nothing is clipped."""
    from matplotlib import pyplot as plt

    return plt.figure(figsize=(width, height), layout="constrained")


def close(figure: Figure) -> None:
    """Let go of a figure that nobody else has seen."""
    from matplotlib import pyplot as plt

    plt.close(figure)


def axes_or_new(
    ax: Any, width: float = 7.0, height: float = 3.6, projection: str | None = None
) -> Any:
    """Return the axes given, or those of a new figure."""
    return new_figure(width, height).add_subplot(projection=projection) if ax is None else ax

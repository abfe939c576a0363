"""Drawings of the explanation pages: a touch, and the signs of location errors. ``make docs``."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

plt.rcParams.update({"svg.hashsalt": "trunnion", "font.size": 9})
FIGURES = Path(__file__).parent / "figures"
NOMINAL, ACTUAL, PART = "0.55", "#c0392b", "#cfe2f3"


def arrow(
    ax: Axes, start: tuple[float, float], end: tuple[float, float], colour: str = "k"
) -> None:
    """Draw a straight arrow."""
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", end, start, arrowprops=style)


def turn(ax: Axes, at: tuple[float, float], radius: float, first: float, last: float) -> None:
    """Draw an arc with an arrow, from an angle to another, degrees."""
    angle = np.radians(np.linspace(first, last, 40))
    x, y = at[0] + radius * np.cos(angle), at[1] + radius * np.sin(angle)
    ax.plot(x[:-1], y[:-1], "k", lw=1.4)
    arrow(ax, (float(x[-4]), float(y[-4])), (float(x[-1]), float(y[-1])))


def axes_of(ax: Axes, right: str, up: str, title: str) -> None:
    """Draw the directions of a view at its lower left corner."""
    arrow(ax, (-4.6, -3.6), (-3.2, -3.6))
    arrow(ax, (-4.6, -3.6), (-4.6, -2.2))
    ax.text(-3.1, -3.6, right, va="center")
    ax.text(-4.6, -2.1, up, ha="center", va="bottom")
    ax.set(xlim=(-5, 5), ylim=(-4.2, 4.2), aspect="equal", title=title)
    ax.axis("off")


def touch() -> None:
    """Ball, face, approach, recorded position."""
    figure, ax = plt.subplots(figsize=(7.2, 3.0), layout="constrained")
    ax.add_patch(Rectangle((2.0, -2.0), 3.4, 3.6, facecolor=PART, edgecolor="k"))
    ax.text(3.7, -0.2, "artefact", ha="center")
    for x, alpha in ((-2.2, 0.35), (1.0, 1.0)):
        ax.add_patch(Circle((x, 0.0), 1.0, facecolor="white", edgecolor="k", alpha=alpha))
        ax.plot([x - 0.12, x - 0.12, x + 0.12, x + 0.12], [2.6, 1.0, 1.0, 2.6], "k", alpha=alpha)
    ax.plot(-2.2, 0.0, "ko", ms=3, alpha=0.35)
    ax.plot(1.0, 0.0, "o", color=ACTUAL, ms=5)
    arrow(ax, (-2.2, 0.0), (0.85, 0.0), ACTUAL)
    ax.text(-0.6, 0.22, "approach", ha="center", color=ACTUAL)
    arrow(ax, (1.0, -1.5), (2.0, -1.5))
    arrow(ax, (2.0, -1.5), (1.0, -1.5))
    ax.plot([1.0, 1.0], [-1.8, 0.0], "k:", lw=0.8)
    ax.text(0.9, -1.5, "effective radius of the ball", ha="right", va="center")
    ax.text(-3.4, 0.0, "start", ha="right", va="center", alpha=0.6)
    ax.text(1.0, 2.75, "recorded: where the ball's centre\nis at the trigger", ha="center")
    ax.set(xlim=(-4.8, 5.6), ylim=(-2.2, 3.7), aspect="equal")
    ax.axis("off")
    save(figure, "touch")


def top_view(ax: Axes) -> None:
    """X to the right, Y up: offsets of C, yaw of A."""
    axes_of(ax, "X", "Y", "From above (Z towards you)")
    ax.add_patch(Circle((0, 0), 2.6, facecolor=PART, edgecolor="k"))
    ax.plot([-4.4, 4.4], [0, 0], color=NOMINAL, ls="-.")
    slope = np.tan(np.radians(10))
    ax.plot([-4.2, 4.2], [-4.2 * slope, 4.2 * slope], color=ACTUAL)
    ax.text(4.3, 0.95, "A axis, +EC0A", color=ACTUAL, ha="right")
    ax.plot(0, 0, "k+", ms=11)
    ax.plot(0.8, 1.2, "o", color=ACTUAL)
    ax.plot([0, 0.8, 0.8], [1.2, 1.2, 0], color=ACTUAL, ls=":")
    ax.text(0.3, 1.4, "+EX0C", ha="center", color=ACTUAL)
    ax.text(0.9, 0.45, "+EY0C", va="center", color=ACTUAL)
    ax.text(1.0, 1.15, "C axis", color=ACTUAL)
    turn(ax, (0, 0), 3.2, 35, 110)
    ax.text(2.4, 3.0, "+C turns the table")


def side_view(ax: Axes) -> None:
    """Y to the right, Z up: place of A."""
    axes_of(ax, "Y", "Z", "Along −X (X towards you)")
    ax.add_patch(Rectangle((-2.6, -0.9), 5.2, 0.9, facecolor=PART, edgecolor="k"))
    ax.plot([0, 0], [-3.2, 3.2], color=NOMINAL, ls="-.")
    ax.plot(0, 0, "k+", ms=11)
    ax.plot(1.3, 0.8, "o", color=ACTUAL)
    ax.plot([0, 1.3, 1.3], [0.8, 0.8, 0], color=ACTUAL, ls=":")
    ax.text(0.65, 0.95, "+EY0A", ha="center", color=ACTUAL)
    ax.text(1.4, 0.4, "+EZ0A", va="center", color=ACTUAL)
    ax.text(1.4, 1.25, "A axis", color=ACTUAL)
    ax.text(0.0, -0.55, "table", ha="center")
    turn(ax, (0, 0), 3.2, 20, 75)
    ax.text(2.2, 3.0, "+A turns the table")


def front_view(ax: Axes) -> None:
    """X to the right, Z up: tilts about Y."""
    axes_of(ax, "X", "Z", "Along +Y (Y away from you)")
    ax.add_patch(Rectangle((-2.6, -0.9), 5.2, 0.9, facecolor=PART, edgecolor="k"))
    ax.plot([0, 0], [-3.2, 3.4], color=NOMINAL, ls="-.")
    ax.plot([-4.4, 4.4], [0, 0], color=NOMINAL, ls="-.")
    lean = np.tan(np.radians(12))
    ax.plot([-3.0 * lean, 3.4 * lean], [-3.0, 3.4], color=ACTUAL)
    ax.plot([-4.0, 4.2], [4.0 * lean, -4.2 * lean], color=ACTUAL)
    ax.text(0.9, 3.3, "C axis, +EB0C", color=ACTUAL)
    ax.text(4.4, -1.5, "A axis, +EB0A", color=ACTUAL, ha="right")
    turn(ax, (0, 0), 2.3, 88, 40)
    ax.text(2.0, 1.7, "+ about Y")


def chain() -> None:
    """Signs of the location errors of a tilting rotary table, in three views."""
    figure, views = plt.subplots(1, 3, figsize=(12.0, 3.9), layout="constrained")
    for view, ax in zip((top_view, side_view, front_view), views, strict=True):
        view(ax)
    save(figure, "chain")


def save(figure: plt.Figure, name: str) -> None:
    """Write a drawing that is the same whenever it is made."""
    figure.savefig(FIGURES / f"{name}.svg", metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    touch()
    chain()

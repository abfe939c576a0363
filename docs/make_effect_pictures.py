"""What each effect does to a small measurement of its kind, from the models: ``make docs``.

One sheet a kind. Each panel is the change of all readings by one unit of each parameter of an
effect, over the recorded quantity that it follows most closely.
"""

import runpy
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt

from trunnion.diagnosis.effect import Effect
from trunnion.models.kinds import Kind, kinds, model_of

FIGURES = Path(__file__).parent / "figures"
COLUMNS = 6
MAX_CURVES = 3
BINS = 12
OF_TIME = ("drift", "warmup", "setup_shift", "zero_shift")
COLOURS = ("#1f4e79", "#c0392b", "#2e8b57")


def shape_of(effect: Effect) -> np.ndarray:
    """Change of the readings by one unit of each linear parameter, (n, k); others at mid-grid."""
    middle = {p.name: p.grid[len(p.grid) // 2] if p.grid else 1.0 for p in effect.parameters}
    return np.asarray(effect.columns(middle))[:, :MAX_CURVES]


def abscissa(effect: Effect, change: np.ndarray, recorded: dict[str, np.ndarray]) -> str:
    """Name of what an effect is drawn over.

    A quantity that it needs, the position of its axis, or the recorded quantity whose groups or
    bins explain most of the change.
    """
    timed = ("time_s",) if effect.id.startswith(OF_TIME) else ()
    placed = ("target_mm",) if effect.id.startswith("reversal_") else ()
    if effect.id.startswith("backlash_slope_"):
        placed = (f"{effect.id[-1]}_mm",)
    of_axis = f"{effect.id.partition('_')[0]}_deg", f"{effect.id.partition('_of_')[2]}_mm"
    for name in (*timed, *placed, *effect.info().needs, *of_axis):
        if name in recorded and not name.endswith("_dir"):
            return name

    def explained(values: np.ndarray) -> float:
        levels, group = np.unique(values, return_inverse=True)
        if len(levels) > BINS:
            group = (np.argsort(np.argsort(values, kind="stable")) * BINS) // len(values)
        means = np.bincount(group, change) / np.maximum(np.bincount(group), 1)
        return float(np.var(means[group]))

    candidates = [
        name for name in recorded if name not in ("point", "cycle", "time_s", "length_mm")
    ]
    return max(candidates or recorded, key=lambda name: explained(recorded[name]))


def recorded_by(model: Any) -> dict[str, np.ndarray]:
    """Numeric columns of a measurement, one value for each reading."""
    columns = model.data.columns
    if "run" in columns:  # a log: everything is seen over time
        columns = {"time_s": columns["time_s"]}
    every = {n: v for n, v in columns.items() if v.dtype.kind in "fi" and np.ptp(v) > 0}
    return {name: values[model.readings.rows] for name, values in every.items()}


def different(models: list[Any]) -> list[tuple[Any, Effect]]:
    """One effect for each line of the table, with its model."""
    alike = runpy.run_path(str(Path(__file__).parent / "make_effects_table.py"))["alike"]
    found: dict[Any, tuple[Any, Effect]] = {}
    for model in models:
        for effect in model.effects:
            found.setdefault(alike(effect.info()), (model, effect))
    return list(found.values())


def sheet(kind: Kind) -> None:
    """Draw every effect of a kind."""
    models = [model_of(*resolve_name(example)()) for example in kind.examples]
    shown = [(m, e) for m, e in different(models) if np.any(shape_of(e))]
    rows = -(-len(shown) // COLUMNS)
    figure, axes = plt.subplots(
        rows, COLUMNS, figsize=(13.0, 1.95 * rows), layout="constrained", squeeze=False
    )
    for ax in axes.flat[len(shown) :]:
        ax.axis("off")
    for ax, (model, effect) in zip(axes.flat, shown, strict=False):
        change = shape_of(effect)
        recorded = recorded_by(model)
        name = abscissa(effect, change[:, 0], recorded)
        for column, colour in zip(change.T, COLOURS, strict=False):
            ax.plot(recorded[name], column, ".", ms=3, color=colour, alpha=0.7)
        ax.axhline(0.0, color="0.7", lw=0.6, zorder=0)
        ax.set_title(effect.id, fontsize=8.5)
        ax.set_xlabel(name, fontsize=7, labelpad=1)
        ax.tick_params(labelsize=6, length=2)
    figure.savefig(FIGURES / f"effects_{kind.name}.png", dpi=80)
    plt.close(figure)


if __name__ == "__main__":
    for each in kinds():
        if each.examples:
            sheet(each)

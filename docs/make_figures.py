"""Figures of README and docs from real runs: ``make docs``."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from matplotlib import pyplot as plt

import trunnion as tn
from trunnion.plot.touches import plot_artefact, plot_estimates
from trunnion.samples.truth import TABLE_2

FIGURES = Path(__file__).parent / "figures"


def overview() -> None:
    """The touches at A = C = 0, and the estimates of the shipped measurement."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    figure = plt.figure(figsize=(13.0, 4.4), layout="constrained")
    grid = figure.add_gridspec(1, 4, width_ratios=(1.2, 0.1, 1.0, 1.0))  # the second: room for Z
    left = figure.add_subplot(grid[0], projection="3d")
    plot_artefact(tn.plan(setup)[:16], setup, ax=left)
    left.set_title("Touches at A = C = 0, 16 of 72", fontsize="medium")
    results = {
        "printed forms": tn.closed_form(touches, setup, "printed"),
        "separating forms": tn.closed_form(touches, setup, "separating"),
        "least squares": tn.identify(touches, setup),
    }
    for place, unit, what in ((2, "µm", "Offsets"), (3, "arcsec", "Tilts")):
        ax = figure.add_subplot(grid[place])
        plot_estimates(results, TABLE_2, ax=ax, unit=unit, legend=False, title=f"{what}, U (k = 2)")
        if unit == "µm":
            ax.legend(loc="lower left", bbox_to_anchor=(0.0, 0.05), frameon=False)
    figure.savefig(FIGURES / "overview.png", dpi=90)
    plt.close(figure)


if __name__ == "__main__":
    FIGURES.mkdir(exist_ok=True)
    overview()

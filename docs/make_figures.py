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
    figure = plt.figure(figsize=(13.0, 5.2), layout="constrained")
    left = figure.add_subplot(1, 2, 1, projection="3d")
    plot_artefact(tn.plan(setup)[:16], setup, ax=left)
    left.set_title("16 of the 72 touches")
    right = figure.add_subplot(1, 2, 2)
    results = {
        "printed forms": tn.closed_form(touches, setup, "printed"),
        "separating forms": tn.closed_form(touches, setup, "separating"),
        "least squares": tn.identify(touches, setup),
    }
    plot_estimates(results, TABLE_2, ax=right)
    right.set_title('Artefact 50 µm and 60" off its place, 0.3 µm repeatability')
    figure.savefig(FIGURES / "overview.png", dpi=90)
    plt.close(figure)


if __name__ == "__main__":
    FIGURES.mkdir(exist_ok=True)
    overview()

"""Figures of docs/results/measured-data.md from the measured files of others: ``make docs``.

Does nothing where ``../shared/measured`` is missing: those files are not part of the project.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt

import trunnion as tn
from trunnion.plot.points import vector_picture

ROOT = Path(__file__).resolve().parents[1]
MEASURED = ROOT / ".." / "shared" / "measured"
FIGURES = ROOT / "docs" / "figures"
JOINTS = ("j1", "j2", "j5", "j6")
TIMES = 4000.0  # magnification of the arrows of the plate
RED, BLUE, GREY = "#c1272d", "#1f5fa8", "#7a7a7a"


def plate() -> None:
    """Errors of the plate, what named causes and the field make of them, and what is left."""
    data = tn.read_points(MEASURED / "plate1597a_2003.csv")
    d = tn.diagnose(data)
    model, source = d.model, d.rebuilt_model()
    assert d.residuals is not None
    whole = d.residuals.before.reshape(-1, 2)
    rigid = np.linalg.qr(source.jacobian(np.zeros(len(source.nuisance)), {}))[0]

    def placed(e: np.ndarray) -> np.ndarray:
        """Take off what a placement makes."""
        flat = e.reshape(-1)
        return (flat - rigid @ (rigid.T @ flat)).reshape(e.shape)

    named = placed(model.error_um(data, smooth=False))
    smooth = placed(model.error_um(data)) - named
    left = model.features_um
    where = [(data.nominal_mm, whole), (data.nominal_mm, named), (data.nominal_mm, smooth)]
    where.append((model.features_mm, left))
    titles = ("placement alone", "named causes", "smooth field", "hole by hole, and noise")
    pictures = []
    for (at, e), title in zip(where, titles, strict=True):
        names = [f"{title}: {np.sqrt(np.mean(e**2)):.1f} µm rms a coordinate"]
        zero = np.zeros(len(at))
        p = vector_picture(at, e, zero, names, title=names[0], magnification=TIMES, bar_um=20.0)
        pictures.append(replace(p, note=f"Arrows × {TIMES:,.0f}."))
    figure = tn.plot.panels(pictures, columns=2, size=(6.6, 5.4), legend=False)
    figure.savefig(FIGURES / "measured_plate.png", dpi=80)
    plt.close(figure)


def order() -> None:
    """What changed between the years, in the order of measurement."""
    one = tn.read_points(MEASURED / "plate1597a_2003.csv")
    two = tn.read_points(MEASURED / "plate1597a_2010.csv")
    a = tn.diagnose(one).rebuilt_model()
    change = (a.bind(two).readings.values - a.readings.values).reshape(-1, 2)
    figure, ax = plt.subplots(figsize=(9, 3.6), layout="constrained")
    for i, (name, colour) in enumerate((("X", RED), ("Y", BLUE))):
        ax.plot(change[:, i], ".", color=colour, alpha=0.25, markersize=4)
        mean = np.convolve(change[:, i], np.ones(21) / 21, mode="valid")
        ax.plot(np.arange(10, 10 + len(mean)), mean, color=colour, label=f"{name}, mean of 21")
    ax.set_xlabel("Row")
    ax.set_ylabel("2010 − 2003 (µm)")
    ax.legend(frameon=False)
    ax.grid(alpha=0.3)
    figure.savefig(FIGURES / "measured_order.png", dpi=80)
    plt.close(figure)


def sweeps() -> None:
    """Residuals of the four axes with the plain circle, and after the diagnosis."""
    figure, axes = plt.subplots(3, 4, figsize=(15, 7.5), layout="constrained", sharex="col")
    for j, (column, joint) in enumerate(zip(axes.T, JOINTS, strict=True)):
        data = tn.read_sweep(MEASURED / f"meca500_{joint}.csv")
        d = tn.diagnose(data)
        assert d.residuals is not None
        circle = tn.fit_circles(data)[1]
        before, after = (r.reshape(-1, 3) for r in (d.residuals.before, d.residuals.after))
        plain = (circle.radial_um, circle.axial_um * np.sign(circle.normal @ d.model.direction))
        for ax, part, i, r in zip(
            column, ("radial", "axial", "tangential"), (0, 2, 1), (*plain, None), strict=True
        ):
            r = before[:, i] if r is None else r
            at = np.argsort(data.angle_deg, kind="stable")
            for y, colour, label in ((r, RED, "circle"), (after[:, i], BLUE, "after")):
                ax.plot(data.angle_deg[at], y[at], ".-", color=colour, linewidth=0.8, label=label)
            ax.axhline(0, color=GREY, linewidth=0.6)
            if j == 0:
                ax.set_ylabel(f"{part} (µm)")
        column[0].set_title(f"{joint.upper()}: {d.verdict}")
        column[2].set_xlabel("Position (°)")
    axes[0, 0].legend(frameon=False)
    figure.savefig(FIGURES / "measured_sweeps.png", dpi=80)
    plt.close(figure)


def report() -> None:
    """Print what the page says."""
    out = sys.stdout
    plates = {y: tn.read_points(MEASURED / f"plate1597a_{y}.csv") for y in (2003, 2010)}
    for year, other in ((2003, 2010), (2010, 2003)):
        d = tn.diagnose(plates[year])
        out.write(f"{year}\n{d.summary()}\n{d.score(plates[other])}\n")
        out.write(f"{tn.repeatable_part(d, plates[other])}\n")
    for joint in JOINTS:
        data = tn.read_sweep(MEASURED / f"meca500_{joint}.csv")
        circle = tn.fit_circles(data)[1]
        d = tn.diagnose(data)
        assert d.residuals is not None
        out.write(f"{joint} {circle.radial_rms_um:.1f} / {circle.axial_rms_um:.1f}\n")
        after = d.residuals.after.reshape(-1, 3)
        out.write(f"after, radial tangential axial: {np.sqrt(np.mean(after**2, axis=0))}\n")
        out.write(f"{d.summary()}\n")


if __name__ == "__main__":
    if MEASURED.is_dir():
        FIGURES.mkdir(exist_ok=True)
        plate()
        order()
        sweeps()
        if "--report" in sys.argv:
            report()

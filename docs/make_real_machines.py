"""Write real-machines.md, and its figures, from runs on the measured files: ``make real-machines``.

The files are looked for in ``TRUNNION_DATA`` or ``../shared/measured``; without them nothing is
written.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import trunnion as tn

ROOT = Path(__file__).resolve().parents[1]
MEASURED = Path(os.environ.get("TRUNNION_DATA", ROOT / ".." / "shared" / "measured"))
PAGE = ROOT / "docs" / "results" / "real-machines.md"
FIGURES = ROOT / "docs" / "figures"
RED, BLUE, GREY = "#c1272d", "#1f5fa8", "#7a7a7a"
MAX_CAUSES = 4
SERVO = {"gain_per_s": 160.18, "time_constant_ms": 11.11}

HEAD = """# Machines whose owners knew the answer

What trunnion says of measurements that nobody here made, beside what their owners knew. This page
is written by `make real-machines` (`docs/make_real_machines.py`) from runs on the files, figures
included; nothing in it is typed in but what was known. `tests/test_real_machines.py` holds the
numbers. The files belong to others: `tn.datasets.about(name)` has source and licence,
`tn.datasets.load(name, folder)` reads them, and two with an open licence come with the package:

```python
import trunnion as tn

print(tn.datasets.names())
print(tn.datasets.about("mill").summary())
log = tn.datasets.load("mill")
print(log.recognised.summary())
```

"""


@cache
def data(name: str) -> Any:
    """Return a set."""
    return tn.datasets.load(name, MEASURED)


@cache
def answer(name: str) -> tn.Diagnosis | str:
    """Return the diagnosis of a set; a refusal as its message, without the folder."""
    try:
        return tn.diagnose(data(name), _setup(name))
    except tn.TrunnionError as error:
        return str(error).replace(str(MEASURED), "...")


def _setup(name: str) -> tn.Setup | None:
    if name not in ("emps", "mill", "servos"):
        return None
    servo = {axis.upper(): dict(SERVO) for axis in data(name).axes}
    return tn.Setup(artefact=tn.Artefact("cuboid"), servo=servo)


def said(name: str) -> str:
    """Return what a diagnosis says in short, as a list."""
    found = answer(name)
    if isinstance(found, str):
        return f"- Refused: {found}"
    model = found.rebuilt_model()
    unit = model.readings.unit
    unit = unit if isinstance(unit, str) else " and ".join(sorted(set(unit)))
    rms = f"{found.gain.rms_before_um:.4g} → {found.gain.rms_after_um:.4g} {unit}"
    lines = [f"- Verdict: **{found.verdict}**. Residual rms {rms}."]
    share = {c.id: c.share for c in found.contributions}
    causes = sorted(found.causes, key=lambda c: -share.get(c.id, 0.0))[:MAX_CAUSES]
    lines += [f"- {c.label[0].upper() + c.label[1:]} (`{c.id}`): {c.size()}" for c in causes]
    if len(found.causes) > MAX_CAUSES:
        lines.append(f"- and {len(found.causes) - MAX_CAUSES} smaller ones")
    if found.unexplained:
        lines.append(f"- Not explained: {found.unexplained.rstrip('.')}.")
    remarks = (*(() if found.reservation is None else (found.reservation,)), *model.remarks)
    return "\n".join([*lines, *(f"- {remark}" for remark in remarks)])


# --- pictures


def stops(ax: Axes, name: str) -> None:
    """Deviations of every stop, both directions."""
    d = data(name)
    for sense, colour, text in ((1, RED, "forward"), (-1, BLUE, "backward")):
        mine = d.direction == sense
        ax.plot(d.target[mine], d.deviation[mine], ".", color=colour, ms=3, label=text)
    ax.set(title=name, xlabel="target, deg" if d.rotary else "target, mm")
    ax.set_ylabel(f"deviation, {d.unit}")


def positioning() -> None:
    """All sets of stops."""
    figure, axes = plt.subplots(1, 5, figsize=(17, 3.4), layout="constrained")
    for ax, name in zip(axes, ("ess_x", "ess_z", "muts_y", "slit", "tank"), strict=True):
        stops(ax, name)
    axes[0].legend(frameon=False)
    _save(figure, "real_positioning")


def rotation() -> None:
    """Resolver; reflectors; robot."""
    figure, axes = plt.subplots(1, 3, figsize=(14, 3.6), layout="constrained")
    d = data("resolver")
    axes[0].plot(d.target, d.deviation / 3600, color=RED)
    axes[0].set(title="resolver − counter", xlabel="counter, deg", ylabel="deg")
    p = data("reflectors")
    for colour, place in zip((RED, BLUE, GREY), np.unique(p.nominal_mm, axis=0), strict=True):
        mine = np.flatnonzero(np.all(p.nominal_mm == place, axis=1))
        moved = 1e3 * (p.x_mm[mine] - place[0])
        axes[1].plot(mine / 3, moved, ".", ms=1.5, color=colour)
    axes[1].set(title="reflectors at rest, x", xlabel="order", ylabel="µm")
    s = data("ur5")
    circle = tn.fit_circles(s)[1]
    back = np.append(np.diff(s.angle_deg), 0.0) > 0
    for mine, colour, text in ((~back, RED, "there"), (back, BLUE, "back")):
        axes[2].plot(s.angle_deg[mine], circle.radial_um[mine] / 1e3, ".", ms=1.5, color=colour)
        axes[2].plot([], [], color=colour, label=text)
    axes[2].set(title="robot, radial", xlabel="joint, deg", ylabel="mm from one circle")
    axes[2].legend(frameon=False)
    _save(figure, "real_rotation")


def lathe() -> None:
    """Level across the bed, before and after."""
    figure, ax = plt.subplots(figsize=(8, 3.4), layout="constrained")
    for name, colour in (("lathe_bed_found", RED), ("lathe_bed_bent_back", BLUE)):
        d = data(name)
        ax.plot(d.position_mm, d.across_um_m, ".-", color=colour, label=name.replace("_", " "))
    ax.set(xlabel="position, mm", ylabel="across, µm/m")
    ax.legend(frameon=False)
    _save(figure, "real_lathe")


def servo() -> None:
    """Following error of the ball-screw axis, before and after the diagnosis."""
    d, found = data("emps"), answer("emps")
    figure, ax = plt.subplots(figsize=(9, 3.4), layout="constrained")
    ax.plot(d.time_s, 1e3 * (d.x_cmd_mm - d.x_act_mm), color=GREY, label="following error")
    if not isinstance(found, str) and found.residuals is not None:
        left = found.residuals.after
        ax.plot(d.time_s[: len(left)], left, color=RED, lw=0.8, label="left by the diagnosis")
    ax.set(xlabel="time, s", ylabel="µm")
    ax.legend(frameon=False)
    _save(figure, "real_servo")


def _save(figure: Any, name: str) -> None:
    figure.savefig(FIGURES / f"{name}.png", dpi=80)
    plt.close(figure)


# --- what is computed beside a diagnosis


def iso() -> str:
    """Return the printed report of ESS X beside the standard's figures."""
    got = data("ess_x").iso230_2()
    return (
        f"By ISO 230-2: B {got.reversal_um:.2f}, mean reversal {abs(got.mean_reversal_um):.2f}, M "
        f"{got.mean_systematic_um:.2f}, A {got.accuracy_um:.2f} µm (printed: 33.58, 25.37, 93.65, "
        "135.27). The report's R and E are those of one direction; the standard's are of both: R "
        f"{got.repeatability_um:.2f}, E {got.systematic_um:.2f} µm."
    )


def harmonics() -> str:
    """Return the harmonics of the resolver without and with a scale of the counter."""
    d = data("resolver")
    turn = np.radians(d.target)
    waves = [f(n * turn) for n in (1, 2, 3, 4) for f in (np.cos, np.sin)]
    said = []
    for beside in ([np.ones(len(d))], [np.ones(len(d)), turn]):
        columns = np.stack([*waves, *beside], axis=1)
        c = np.linalg.lstsq(columns, d.deviation / 3600, rcond=None)[0]
        said.append(", ".join(f"{np.hypot(*c[2 * n : 2 * n + 2]):.2f}" for n in range(4)))
    return (
        f"Plain least squares for the resolver: harmonics of {said[0]} degrees; with a scale of "
        f"the counter beside them {said[1]}. One turn hardly tells the two apart."
    )


def tank() -> str:
    """Return the backlash at each angle."""
    got = data("tank").iso230_2()
    each = np.abs(got.mean_forward - got.mean_backward) / 3600
    listed = ", ".join(f"{x:.3f}" for x in each)
    return f"Mean reversal at 0, 10, ... 40 degrees: {listed} degrees."


def lathes() -> str:
    """Return what changed between the two measurements."""
    changed = tn.compare(data("lathe_bed_found"), data("lathe_bed_bent_back"))
    return "`tn.compare(found, bent_back)`:\n\n" + "\n".join(f"> {x}" for x in changed.sentences())


def flatness() -> str:
    """Return flatness and zero of the plate."""
    found = data("surface_plate").flatness()
    zero = found.instrument_zero_um_m or (np.nan, np.nan)
    return (
        f"Flatness {found.flatness_um:.2f} µm (minimum zone {found.minimum_zone_um:.2f} µm); zero "
        f"of the level by reversal {zero[0]:.1f} and {zero[1]:.1f} µm/m."
    )


def clocks() -> str:
    """Return the offset of the robot's clocks."""
    d = data("ur5")
    return (
        f"The two recordings are brought to one clock by the data (`tn.align_clocks`): {len(d)} "
        "rows have both."
    )


@dataclass(frozen=True)
class Section:
    """A part of the page.

    names: Sets in it; more: further text from runs; figure: its file.
    """

    title: str
    names: tuple[str, ...]
    more: tuple[Callable[[], str], ...] = ()
    figure: str = ""
    text: str = ""


SECTIONS = (
    Section(
        "Ball-screw axis (EMPS)",
        ("emps",),
        figure="real_servo",
        text="From the nominal values 160.18 /s and 11.11 ms.",
    ),
    Section(
        "Linear axes and a rotary one, against lasers and encoders",
        ("ess_x", "ess_z", "muts_y", "slit", "tank"),
        (iso, tank),
        "real_positioning",
        "The file's direction is the word of its author: his report prints the block called "
        "forward as backward, so that reversals have the other sign.",
    ),
    Section(
        "Lathe bed, before and after",
        ("lathe_bed_found", "lathe_bed_bent_back"),
        (lathes,),
        "real_lathe",
    ),
    Section("Surface plate", ("surface_plate",), (flatness,)),
    Section(
        "Resolver with a fault, reflectors at rest",
        ("resolver", "reflectors"),
        (harmonics,),
        figure="real_rotation",
        text="Of the resolver, where its axis turned evenly.",
    ),
    Section(
        "Drilled plates, four arm axes",
        ("plate_2003", "plate_2010", "arm_j1", "arm_j2", "arm_j5", "arm_j6"),
        text="More on these: [measured-data.md](measured-data.md).",
    ),
    Section(
        "Refusals",
        ("self_reference", "ur5", "mill"),
        (clocks,),
        text="An axis against its own counter, a robot of which two joints turned, positions "
        "rounded to 1 mm.",
    ),
)


def page() -> str:
    """Return the page."""
    parts = [HEAD]
    for section in SECTIONS:
        parts.append(f"## {section.title}\n\n")
        if section.text:
            parts.append(f"{section.text}\n\n")
        if section.figure:
            parts.append(f"![{section.title}](../figures/{section.figure}.png)\n\n")
        for name in section.names:
            about = tn.datasets.about(name)
            parts.append(f"### `{name}`: {about.description}\n\n")
            parts.append(f"**Known**: {about.known}. {about.source}.\n\n{said(name)}\n\n")
        parts += [f"{more()}\n\n" for more in section.more]
    return "".join(parts).rstrip() + "\n"


if __name__ == "__main__":
    if MEASURED.is_dir():
        FIGURES.mkdir(exist_ok=True)
        for picture in (positioning, rotation, lathe, servo):
            picture()
        PAGE.write_text(page(), encoding="utf-8")

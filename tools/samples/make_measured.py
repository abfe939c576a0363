"""Make samples of measured data again: ``python tools/samples/make_measured.py``.

Small measurements of the project's own making, with what is in them written here:

``plate/first.csv``, ``plate/second.csv``
    90 holes of one plate, measured twice. The drilling machine: scale of X +40 ppm, bow of X in Y
    of 4 µm, each hole off by 1.5 µm; the measuring machine: 0.8 µm; second measurement re-mounted.
``axis/sweep.csv``
    A full turn of an axis with three targets: axial motion twice a turn of 2.5 µm, positioning
    three times a turn of 4 arcsec; 0.8 µm noise.
``axis/arc.csv``
    95 degrees of the same kind with one target and an axial motion of 80 µm twice a turn: more
    than one explanation fits.
``ballbar/circle.csv``
    A ball-bar of 100 mm on an XY circle at 1000 mm/min, both senses, twice: Y loses 3 µm when it
    turns back, X and Y are 6 arcsec off square; 0.3 µm noise, the fixed ball off by 20 µm.
``positioning/axis.csv``
    X of a machine by ISO 230-2: 11 targets over 500 mm, both directions, 5 cycles. Scale 18 ppm, a
    reversal of 6 µm, a wave of the screw (pitch 10 mm seen at stops of 52.1 mm), 1.2 µm of drift a
    cycle, 0.7 µm noise.
``levels/bed.csv``
    A bed of 2.4 m, level moved in steps of its own 100 mm and back turned by 180 degrees: bow of
    18 µm, twist of 40 µm/m per m, zero of the level 15 and -8 µm/m, 1 µm/m noise.
``levels/plate.csv``
    A plate of 400 x 250 mm on a grid of 50 mm, level turned for the way back: a bowl of 3 µm in x
    and 2 µm in y, the last 100 mm in x worn down by 8 µm/m; zero of the level 40 and 25 µm/m,
    0.8 µm/m noise.
"""

from pathlib import Path

import numpy as np

import trunnion as tn

__all__ = ["make_axis", "make_ballbar", "make_levels", "make_plate", "make_positioning"]

SEED = 2003
ARCSEC = np.pi / 648000


def make_plate(folder: Path) -> None:
    """Write both measurements of the plate."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED)
    q = np.round(rng.uniform(-150, 150, (90, 2)), 3)
    u = q[:, 0] / 150
    error = np.column_stack([40e-3 * q[:, 0], 4.0 * (1.5 * u * u - 0.5)])
    error += 1.5 * rng.normal(size=q.shape)
    for name, turn, shift in (("first", 0.004, (3.0, -2.0)), ("second", -0.002, (0.5, 1.0))):
        c, s = np.cos(turn), np.sin(turn)
        noise = 0.8 * rng.normal(size=q.shape)
        m = (q + 1e-3 * (error + noise)) @ np.array([[c, s], [-s, c]]) + shift
        tn.Points(
            nominal_x_mm=q[:, 0],
            nominal_y_mm=q[:, 1],
            x_mm=np.round(m[:, 0], 5),
            y_mm=np.round(m[:, 1], 5),
        ).to_csv(folder / f"{name}.csv")


def make_positioning(folder: Path) -> None:
    """Write the stops of one axis."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED + 5)
    up = 5.0 + np.round(np.linspace(0.0, 490.0, 11) + rng.uniform(-4, 4, 11), 1)
    target = np.tile(np.concatenate([up, up[::-1]]), 5)
    direction = np.tile(np.repeat([1, -1], 11), 5)
    cycle = np.repeat(np.arange(1, 6), 22)
    error = 18e-3 * target + 3.0 * direction - 1.2 * (cycle - 1)
    error += 2.0 * np.sin(2 * np.pi * target / 10.0) + 0.7 * rng.normal(size=len(target))
    tn.Positioning(
        target_mm=target,
        measured_mm=np.round(target + 1e-3 * error, 5),
        direction=direction,
        cycle=cycle,
        time_s=np.arange(len(target)) * 15.0,
    ).to_csv(folder / "axis.csv")


def make_levels(folder: Path) -> None:
    """Write the bed and the plate."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED + 6)
    there = 50.0 + 100.0 * np.arange(24)
    p = np.concatenate([there, there[::-1]])
    sense = np.repeat([1.0, -1.0], len(there))
    rise = -2e3 * 18.0 * (p - 1200.0) / 1200.0**2
    slopes = np.column_stack([80.0 + rise, -30.0 + 40e-3 * (p - 1200.0)])
    read = sense[:, None] * slopes + [15.0, -8.0] + rng.normal(size=slopes.shape)
    tn.Levels(
        position_mm=p,
        along_um_m=np.round(read[:, 0], 1),
        across_um_m=np.round(read[:, 1], 1),
        turn_deg=np.where(sense > 0, 0.0, 180.0),
        time_s=25.0 * np.arange(len(p)),
    ).to_csv(folder / "bed.csv")
    x, y = (50.0 * a.ravel() for a in np.meshgrid(np.arange(9.0), np.arange(6.0)))
    u, v = x / 200.0 - 1, y / 125.0 - 1
    worn = np.where(u > 0.4, -8.0, 0.0)
    slopes = np.column_stack([120.0 + 6e3 * u / 200.0 + worn, -60.0 + 4e3 * v / 125.0])
    slopes = np.concatenate([slopes, slopes[::-1]])
    sense = np.repeat([1.0, -1.0], len(x))
    read = sense[:, None] * slopes + [40.0, 25.0] + 0.8 * rng.normal(size=slopes.shape)
    tn.Levels(
        x_mm=np.concatenate([x, x[::-1]]),
        y_mm=np.concatenate([y, y[::-1]]),
        along_um_m=np.round(read[:, 0], 1),
        across_um_m=np.round(read[:, 1], 1),
        turn_deg=np.where(sense > 0, 0.0, 180.0),
        time_s=25.0 * np.arange(len(sense)),
    ).to_csv(folder / "plate.csv")


def make_axis(folder: Path) -> None:
    """Write the full turn and the arc."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED + 1)
    angle = np.arange(0.0, 360.0, 10.0)
    t = np.radians(angle)
    _write(
        folder / "sweep.csv",
        rng,
        angle,
        [(90.0, 0.4, 0.0), (140.0, 2.2, 50.0), (70.0, 4.1, -30.0)],
        axial_um=2.5 * np.cos(2 * t + 0.6),
        turn_arcsec=4.0 * np.sin(3 * t),
    )
    angle = np.arange(-60.0, 36.0, 5.0)
    t = np.radians(angle)
    axial = 80.0 * np.cos(2 * t + 0.5)
    _write(folder / "arc.csv", rng, angle, [(300.0, 0.0, 0.0)], axial, np.zeros_like(t))


def _write(
    path: Path,
    rng: np.random.Generator,
    angle: np.ndarray,
    targets: list[tuple[float, float, float]],
    axial_um: np.ndarray,
    turn_arcsec: np.ndarray,
) -> None:
    """Targets (radius, phase, height), mm and rad, on an axis that leans by 0.1 about X."""
    c, s = np.cos(0.1), np.sin(0.1)
    lean = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    t = np.radians(angle) + turn_arcsec * ARCSEC
    parts = [
        np.column_stack([r * np.cos(t + p), r * np.sin(t + p), h + 1e-3 * axial_um])
        for r, p, h in targets
    ]
    m = np.concatenate(parts) @ lean.T + [400.0, 300.0, 150.0]
    m = np.round(m + 0.8e-3 * rng.normal(size=m.shape), 5)
    tn.Sweep(
        angle_deg=np.tile(angle, len(targets)),
        target=np.repeat(np.arange(1, len(targets) + 1), len(angle)),
        x_mm=m[:, 0],
        y_mm=m[:, 1],
        z_mm=m[:, 2],
    ).to_csv(path)


def make_ballbar(folder: Path) -> None:
    """Write the circle."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED + 2)
    step = np.radians(2.0)
    senses = np.repeat([1, -1, 1, -1], 180)
    t = senses * step * np.tile(np.arange(180), 4) + step / 2
    commanded = 100.0 * np.column_stack([np.cos(t), np.sin(t)])
    along_y = senses * np.cos(t)
    actual = commanded + np.column_stack(
        [6.0 * ARCSEC * commanded[:, 1], -0.5 * 3e-3 * np.sign(along_y)]
    )
    length = np.linalg.norm(actual - [0.017, -0.011], axis=1) + 0.3e-3 * rng.normal(size=len(t))
    tn.Ballbar(
        setup=np.ones(len(t), dtype=int),
        x_mm=np.round(commanded[:, 0], 6),
        y_mm=np.round(commanded[:, 1], 6),
        length_mm=np.round(length, 5),
        sense=senses,
        feed_mm_min=np.full(len(t), 1000.0),
        time_s=np.round(np.arange(len(t)) * 100.0 * step / (1000.0 / 60.0), 3),
    ).to_csv(folder / "circle.csv")


if __name__ == "__main__":
    SAMPLES = Path(__file__).parents[2] / "python" / "trunnion" / "samples"
    make_plate(SAMPLES / "plate")
    make_axis(SAMPLES / "axis")
    make_ballbar(SAMPLES / "ballbar")
    make_positioning(SAMPLES / "positioning")
    make_levels(SAMPLES / "levels")

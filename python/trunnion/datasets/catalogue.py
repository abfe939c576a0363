"""The sets: where each is from, what its owner knew, how its files become data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trunnion.base.report import Result, Table
from trunnion.data.axis_log import AxisLog
from trunnion.data.levels import Levels
from trunnion.data.points import Points
from trunnion.data.positioning import Positioning
from trunnion.data.sweep import Sweep
from trunnion.files.columns import scaled
from trunnion.files.delimited import Delimited
from trunnion.files.text import Source
from trunnion.models.read import read

GITHUB = "https://raw.githubusercontent.com"
NOT_STATED = "not stated: not to be copied"
SERVO_COUNTS = 4096
TANK_DEG = (-4.45181345e-05, 30.73995)
"""Scale and zero of the tank's encoder, by its owner."""
EVEN = 0.998
"""Share of the largest speed from which an axis turns evenly."""
GROSS_MM = 1.0
"""Beyond this from its median a reflector at rest was lost by the tracker."""


@dataclass(frozen=True, eq=False, repr=False)
class Dataset(Result):
    """A measurement of somebody else's.

    Attributes
    ----------
    name
        As `load` takes it.
    files
        In the folder of measured data.
    description, known
        What was measured; what its owner knew, or what else is certain.
    repository, commit
        On GitHub.
    licence
        Of the data.
    public
        File → path in the repository and SHA-256, where it is published as it is read here.
    reader
        Which of `READERS` reads the files.
    """

    name: str
    files: tuple[str, ...]
    description: str
    known: str
    repository: str
    commit: str
    licence: str = NOT_STATED
    public: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    reader: str = "read"

    @property
    def source(self) -> str:
        """Where it is from."""
        return f"github.com/{self.repository} at {self.commit[:8]}"

    def sentences(self) -> Sequence[str]:
        """Say what it is."""
        return (
            f"{self.name}: {self.description}.",
            f"Known: {self.known}.",
            f"Source: {self.source}; licence: {self.licence}.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Return nothing: the sentences say all."""
        return ()


def _columns(path: Path) -> dict[str, Any]:
    """Return the columns of a CSV file as numbers where they are such."""
    found = Delimited(Source.of(path)).columns()
    return {n: scaled(n, v, 1.0) if n not in _TEXT else v for n, v in found.items()}


_TEXT = ("approach", "Date Time")


def _resolver(path: Path) -> Any:
    """Resolver against counter, where the axis turned evenly: lag and resting are left out."""
    found: Positioning = read(
        path,
        columns={
            "target_deg": "fActPosition (Internal Counter)",
            "measured_deg": "fActPosition (Resolver)",
            "direction": 1,
            "cycle": 1,
        },
    ).with_columns(time_s=None)
    speed = np.gradient(found.target)
    return found[speed > EVEN * speed.max()]


def _mill(path: Path) -> Any:
    pairs = {
        f"{a}_{short}_mm": f"{a.upper()}1_{long}Position"
        for a in "xyz"
        for short, long in (("cmd", "Command"), ("act", "Actual"))
    }
    return read(path, columns=pairs, period_s=0.1)


def _servos(path: Path) -> AxisLog:
    """Four servos as four runs of one axis; rows without an answer are left out."""
    columns = Delimited(Source.of(path)).columns()
    when = np.array([np.datetime64(str(t).rstrip("Z"), "ms") for t in columns["timestamp"]])
    seconds = (when - when[0]).astype(np.float64) * 1e-3
    parts = []
    for servo in "1234":
        pair = [columns[f"{name} ({servo})"] for name in ("target pos", "pos")]
        there = np.all([[bool(text) for text in values] for values in pair], axis=0)
        moved = [360.0 / SERVO_COUNTS * scaled("counts", values[there], 1.0) for values in pair]
        parts.append(
            AxisLog(
                time_s=seconds[there],
                a_cmd_deg=moved[0],
                a_act_deg=moved[1],
                run=np.full(there.sum(), int(servo)),
            )
        )
    return AxisLog.concatenate(parts)


def _slit(path: Path) -> Any:
    same = {f"{name}_mm": f"{name}_mm" for name in ("motor", "resolver", "laser")}
    return read(path, columns={"measured_mm": "laser_mm", **same})


def _tank(path: Path) -> Positioning:
    columns = _columns(path)
    raw = columns["ssi_raw"]
    raw = np.where(raw > 2.0**30, raw - 2.0**31, raw)  # the encoder's 31 bits went below zero
    measured = TANK_DEG[0] * raw + TANK_DEG[1]
    above = columns["approach"] == "above"
    target = columns["position"]
    _, run = np.unique(np.stack([target, above], axis=1), axis=0, return_inverse=True)
    cycle = np.array([np.sum(run.reshape(-1)[:i] == k) + 1 for i, k in enumerate(run.reshape(-1))])
    return Positioning(
        target_deg=target,
        measured_deg=measured,
        direction=np.where(above, -1, 1),
        cycle=cycle,
    )


def _lathe(path: Path) -> Levels:
    """Steps of 25 mm from the tailstock end."""
    rows = len(_columns(path)["trigger"])
    found: Levels = read(
        path,
        columns={
            "along_um_m": "raw_x_mm_per_m",
            "across_um_m": "raw_y_mm_per_m",
            "position_mm": 25.0 * np.arange(rows),
        },
    )
    return found


def _granite(*paths: Path) -> Levels:
    """Row by row of 9, 50 mm apart; then with the level turned, in the reverse order."""
    x, y = np.tile(50.0 * np.arange(9), 6), np.repeat(50.0 * np.arange(6), 9)
    places = {"x_mm": np.concatenate([x, x[::-1]]), "y_mm": np.concatenate([y, y[::-1]])}
    parts, begin = [], 0
    for path in paths:
        end = begin + len(_columns(path)["Date Time"])
        where = {name: values[begin:end] for name, values in places.items()}
        turn = np.where(np.arange(begin, end) < len(x), 0, 180)
        parts.append(read(path, columns={**_WYLER, **where, "turn_deg": turn}))
        begin = end
    return Levels.concatenate(parts)


_WYLER = {"along_um_m": "B7514X [rad]", "across_um_m": "B7514Y [rad]"}


def _reflectors(path: Path) -> Points:
    """Reflectors at rest; nominal places are the medians, lost readings are left out."""
    columns = _columns(path)
    parts = []
    for b in "123":
        measured = np.stack([columns[f"b{b}{a}_mm"] for a in "xyz"], axis=1)
        nominal = np.median(measured, axis=0)
        kept = np.abs(measured - nominal).max(axis=1) < GROSS_MM
        order = columns["order"][kept]
        parts.append(np.column_stack([order, measured[kept], np.tile(nominal, (len(order), 1))]))
    table = np.concatenate(parts)
    table = table[np.argsort(table[:, 0], kind="stable")]
    _, x, y, z, nx, ny, nz = table.T
    return Points(nominal_x_mm=nx, nominal_y_mm=ny, nominal_z_mm=nz, x_mm=x, y_mm=y, z_mm=z)


def _ur5(tracker: Path, joint: Path) -> Sweep:
    """Reflector against the joint's angle, its clock brought to the tracker's."""
    from trunnion.data.clocks import align_clocks

    places = np.stack([scaled(a, v, 1e3) for a, v in _tracker(tracker).items()], axis=1)
    angle = np.array([float(line) for line in Source.of(joint).lines if line.strip()])
    t_a, t_b = 0.008 * np.arange(len(places)), 0.008 * np.arange(len(angle))
    found = align_clocks(t_a, places, t_b, np.stack([np.cos(angle), np.sin(angle)], axis=1))
    at = t_a - found.offset_s
    there = (at >= t_b[0]) & (at <= t_b[-1])
    turned = np.degrees(np.interp(at[there], t_b, angle))
    x, y, z = places[there].T
    return Sweep(
        angle_deg=turned,
        target=np.ones(len(turned), dtype=int),
        x_mm=x,
        y_mm=y,
        z_mm=z,
        time_s=t_a[there],
    )


def _tracker(path: Path) -> dict[str, Any]:
    from trunnion.files.foreign import points

    found = points.read(Source.of(path), None, None).columns
    return {a: found[a] for a in "xyz"}


_MUTS = ("anderssandstrom/ecmc_target_muts_logger", "ee350e4c813139fde4608dd0edd331f8d3546028")
_LEVEL = ("gamozolabs/level_solver", "da8fc52f01962e35baa31f01794b75964e45b288")
_ARM = ("hanbyeolyoonucla/robot-calibration", "33d50d777f1e182ddefb2774b054b090c6009ae7")
_PLATE = ("csayres/fitPlugPlateMeas", "eae6bf809f7e100f9eefe35254d8f92b81fca3b1")
_GRANITE = {
    "0": ("01-10-10", "f8287d3f6c7f28ffe5616748c1df1fb63719e171dda403bc1bd2c16228a029d6"),
    "180_a": ("01-40-04", "2bc272846f48769a220becbfb5d5c45487730a6f252a0d1ea8ae00978c2cd2ec"),
    "180_b": ("01-56-16", "73eb5e2ab05717bd72429dd3c8ea40a37fcc24e92aa0c29185a92a42f6f43f08"),
}
_UR5_FOLDER = "source/ForwardKinematics/Markus"

_ALL = (
    Dataset(
        "emps",
        ("servo/emps_lap1.csv",),
        "ball-screw axis with a DC motor, 1 kHz: reference, encoder, drive voltage",
        "gain 156.46 /s, Coulomb friction 14.88 µm, offset −2.2 µm of following error (Janot, "
        "Gautier, Brunot 2019)",
        "forgi86/sysid-neural-continuous",
        "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a",
    ),
    Dataset(
        "resolver",
        ("servo/resolver_fault_twincat_scope.csv",),
        "counter and resolver of one turning axis, 10 ms, an export of TwinCAT Scope",
        "a voltage divider in the resolver's coils on purpose: harmonics of the turn, the second "
        "of 1.54 degrees",
        "anderssandstrom/amci_resolver_issue",
        "63e4d0420fbd20070694caae69d57c6a4b9388ec",
        reader="resolver",
    ),
    Dataset(
        "mill",
        ("servo/cnc_mill_05.csv",),
        "commanded and actual positions of a small CNC mill, 10 Hz",
        "nothing: positions above 100 mm are rounded to 1 mm",
        "ejhusom/cnc_milling_tool_wear",
        "6ff00d2a745ab1eb9644c294209f231894173687",
        "CC0",
        {
            "servo/cnc_mill_05.csv": (
                "data/experiment_05.csv",
                "6e4e66fd92ddc21e5660b0f4b06a1e83ed03c20906391f248e3dabe8e7d0c7b8",
            )
        },
        reader="mill",
    ),
    Dataset(
        "servos",
        ("servo/uart_servo_backlash.csv",),
        "four small servos on a stand, position under alternating pull, 10 Hz",
        "they are pulled against a target at rest: backlash, and no motion to show a loop",
        "roboninecom/Measuring-Backlash-in-Popular-UART-Servos",
        "5273b56230f38cae1201103dc30d64b2ceebf3ef",
        "CC BY 4.0",
        {
            "servo/uart_servo_backlash.csv": (
                "logs/motor_telemetry_nocomp2.csv",
                "11c62dcdcc1550ad4a495fe533b566d5e5f34323e3f074199442cd817ed8eafd",
            )
        },
        reader="servos",
    ),
    *(
        Dataset(
            name,
            (f"positioning/{file}.csv",),
            f"{what} of a target drive, both directions, cycles; laser triangulation sensor",
            known,
            *_MUTS,
        )
        for name, file, what, known in (
            ("ess_x", "ess_b02_x", "X axis", "report: M 93.65, A 135.27, mean reversal 25.37 µm"),
            ("ess_z", "ess_b02_z", "Z axis", "mean reversal 1.6 µm, drift −0.2 µm a cycle"),
            ("muts_y", "ess_muts_y_ild50", "Y axis", "reversal and drift of 10.6 µm a cycle"),
        )
    ),
    Dataset(
        "slit",
        ("positioning/ess_bifrost_slit_11360_axis2.csv",),
        "slit axis: target, open-loop motor, resolver and laser",
        "four instruments on the same stops",
        "anderssandstrom/ecmccomgui",
        "8488a9991bda72f4f2f7a1b9433db04b6d91d4fc",
        reader="slit",
    ),
    Dataset(
        "self_reference",
        ("positioning/psi_fat_sat.csv",),
        "positioning of an axis",
        'its "reference" is its own counter',
        "paulscherrerinstitute/ecmccfg",
        "19fd09c5859f97e15cd010927fa0681f2ee81000",
    ),
    Dataset(
        "tank",
        ("positioning/vac_tank_rotary.csv",),
        "rotary axis of a vacuum tank, five angles from above and below, four times each",
        "backlash 0.031, 0.027, 0.021, 0.030, 0.027 degrees at 0, 10, ... 40",
        "anderssandstrom/ecmc_bifrost_vac_tank_sat",
        "a02aa4dd7c6971f73eeeb269e1679931b0b70b15",
        reader="tank",
    ),
    *(
        Dataset(
            name,
            (f"levels/{name}.csv",),
            f"bed of a lathe {when}, two-axis electronic level in steps of 25 mm",
            f"twist {twist} µm/m per m",
            *_LEVEL,
            reader="lathe",
        )
        for name, when, twist in (
            ("lathe_bed_found", "as found", "143"),
            ("lathe_bed_bent_back", "after its owner had bent it back", "−37"),
        )
    ),
    Dataset(
        "surface_plate",
        tuple(f"levels/surface_plate_{part}.csv" for part in _GRANITE),
        "granite plate of 18 x 24 inches, two-axis level on a grid of 50 mm, then turned by 180 "
        "degrees",
        "reversal parts the level's own zero from the plate",
        *_LEVEL,
        public={
            f"levels/surface_plate_{part}.csv": (
                f"data/surface_plate_20241218/wylerUNIVERSAL%20data%202024-12-18%20{time}.csv",
                digest,
            )
            for part, (time, digest) in _GRANITE.items()
        },
        reader="granite",
    ),
    Dataset(
        "reflectors",
        ("other/irb120_base_reflectors.csv",),
        "three reflectors on the base of a robot, laser tracker, 1000 times in a few hours",
        "they drift together, 51, 41 and 50 µm in x; 0, 2 and 16 readings of them were lost",
        "icelinker/Robot-Calibration-LaserTracker",
        "188abd2d773b26dd32bafe50943c3ab0044a72d8",
        reader="reflectors",
    ),
    Dataset(
        "ur5",
        ("other/ur5_tracker_xyz_m_125Hz.txt", "other/ur5_joint0_rad_125Hz.txt"),
        "reflector on a robot turned by 359 degrees about its base, laser tracker and joint",
        "two joints moved; the clocks are not common",
        "FinnLinxxx/akig",
        "bc0fd21b8ec1ec05f34bb58a3ee4919a3133c63f",
        public={
            "other/ur5_tracker_xyz_m_125Hz.txt": (
                f"{_UR5_FOLDER}/coordinates_tracker_output_05Pts125hzLAN.txt",
                "13030e14246be9efe48cb2e4ce385cb9361703dc15046f1f3dface5157b25feb",
            )
        },
        reader="ur5",
    ),
    *(
        Dataset(
            f"plate_{year}",
            (f"plate1597a_{year}.csv",),
            f"650 holes of one plate drilled by a CNC mill, measured in {year}",
            "the same plate in both years",
            *_PLATE,
        )
        for year in (2003, 2010)
    ),
    *(
        Dataset(
            f"arm_j{joint}",
            (f"meca500_j{joint}.csv",),
            f"joint {joint} of a small arm turned in steps, one reflector, tracking instrument",
            "scatter of a reading about 1 µm",
            *_ARM,
        )
        for joint in (1, 2, 5, 6)
    ),
)
DATASETS: Mapping[str, Dataset] = {each.name: each for each in _ALL}
"""Every set by name."""

READERS: Mapping[str, Callable[..., Any]] = {
    "read": read,
    "mill": _mill,
    "servos": _servos,
    "resolver": _resolver,
    "slit": _slit,
    "tank": _tank,
    "lathe": _lathe,
    "granite": _granite,
    "reflectors": _reflectors,
    "ur5": _ur5,
}
"""How the files of a set become one measurement."""

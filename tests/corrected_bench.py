"""Hidden machines measured, corrected and judged in a real LinuxCNC: what the component leaves."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

import trunnion as tn
from controller import compiled, run
from kins_bench import Kinematics
from power.report import count_and_out
from probing_bench import SPEED, FloatArray, Hidden, hidden, places, run_program, turned
from trunnion.controls import ControlFiles, linuxcnc_files

POSES = tuple(product(range(-90, 91, 30), range(0, 360, 60)))
CORNERS = np.array(list(product((-150.0, 150.0), (-120.0, 120.0), (0.0, 150.0))))


@dataclass(frozen=True)
class Judged:
    """Largest volumetric error, µm: before, left in LinuxCNC, and what was forecast of it."""

    seed: int
    touches: int
    before_um: float
    left_um: float
    interval_um: tuple[float, float]

    @property
    def holds(self) -> bool:
        """Whether what is left lies in its interval."""
        return self.interval_um[0] <= self.left_um <= self.interval_um[1]


def pose(errors: dict[str, float], point: FloatArray, a_deg: float, c_deg: float) -> FloatArray:
    """T_A Rx(a) T_C Rz(c) of docs/conventions.md, (4, 4)."""
    place_a, place_c = places(errors, point)
    return place_a @ turned(0, np.radians(a_deg)) @ place_c @ turned(2, np.radians(c_deg))


def largest_um(case: Hidden, joints: list[FloatArray]) -> float:
    """Largest distance on the real table between tool points and the corners, joints pose by pose.

    `joints`: X, Y, Z in the machine frame, A, C; one row a pose and corner.
    """
    point = np.array(case.setup.axes["A"].point_mm)
    largest = 0.0
    for (_, corner), row in zip(product(POSES, CORNERS), joints, strict=True):
        real = pose(case.errors, point, row[3], row[4])
        reached = np.linalg.solve(real, np.append(row[:3], 1.0))[:3]
        largest = max(largest, float(np.linalg.norm(reached - corner)))
    return 1e3 * largest


def uncorrected(case: Hidden) -> list[FloatArray]:
    """Joints of the machine without errors."""
    point = np.array(case.setup.axes["A"].point_mm)
    free = dict.fromkeys(case.errors, 0.0)
    rows = []
    for (a, c), corner in product(POSES, CORNERS):
        at = (pose(free, point, a, c) @ np.append(corner, 1.0))[:3]
        rows.append(np.array([*at, a, c]))
    return rows


def corrected(case: Hidden, files: ControlFiles, folder: Path) -> list[FloatArray]:
    """Joints where LinuxCNC goes with the component loaded and the tool centre point on."""
    centre = np.array(case.setup.control.centre_mm)
    source = files.files["trunnionkins.comp"]
    bench = replace(
        case.bench,
        boxes=[],
        table_radius_mm=1.0,
        table_z_mm=-1500.0,
        kinematics="trunnionkins",
        components={"trunnionkins": compiled("trunnionkins", source)},
        hal=files.files["trunnion.hal"],
    )
    steps = [{"mdi": line} for line in ("T1 M6 G43 H1", "G21 G90 G94", "M428")]
    for (a, c), corner in product(POSES, CORNERS):
        x, y, z = corner + centre
        steps.append({"mdi": f"G0 X{x:.6f} Y{y:.6f} Z{z:.6f} A{a} C{c}"})
    found = run(bench, steps, folder, seconds=300)
    rows = []
    for step in found[3:]:
        assert not step["messages"], step["messages"]
        joints = np.array(step["joints"])
        rows.append(np.r_[joints[:3] - centre - [0, 0, bench.tool_mm], joints[3:]])
    return rows


def every_pose(setup: tn.Setup) -> tn.Touches:
    """``trunnion plan --tilt 90,-90,45,-45 --every-pose``."""
    tilts = (90.0, -90.0, 45.0, -45.0)
    return tn.plan(
        setup,
        a_deg=tilts,
        positions_deg=[(a, c) for a in tilts for c in (90.0, 180.0, 270.0)],
        feeds_mm_min=[600 * SPEED],
    )


def judged(seed: int, folder: Path) -> Judged:
    """Plan, program, log, estimate, component, poses in LinuxCNC: nothing written by hand."""
    case = hidden(seed, clearance=4.0, kind="cross", slow_feed_mm_min=30 * SPEED)
    case = replace(case, plan=every_pose(case.setup))
    report = run_program(case, folder / "before")
    assert report["strikes"] == report["stem-strikes"] == 0, report
    estimate = tn.identify(tn.read_probe_log(folder / "before/touches.log", case.plan), case.setup)
    files = linuxcnc_files(case.setup, estimate)
    assert files.interval_um is not None
    left = largest_um(case, corrected(case, files, folder / "after"))
    return Judged(
        seed, len(case.plan), largest_um(case, uncorrected(case)), left, files.interval_um
    )


def cycle_us() -> float:
    """Longest of ten mean times of a servo cycle's kinematics, µs."""
    files = linuxcnc_files(hidden(20_001, clearance=4.0, kind="cross").setup, {"EX0C": 15.0})
    with tempfile.TemporaryDirectory() as folder:
        kins = Kinematics(files.files["trunnionkins.comp"], Path(folder))
        return max(kins.cycle_us(np.array([10.0, 20.0, -30.0, 40.0, 50.0])) for _ in range(10))


CLOCKS = """
#include <time.h>
#include <x86intrin.h>
double clocks_per_us(void) {
    struct timespec start, end;
    unsigned long long first;
    double us;
    clock_gettime(CLOCK_MONOTONIC, &start);
    first = __rdtsc();
    do {
        clock_gettime(CLOCK_MONOTONIC, &end);
        us = 1e6 * (double)(end.tv_sec - start.tv_sec);
        us += 1e-3 * (double)(end.tv_nsec - start.tv_nsec);
    } while (us < 2e5);
    return (double)(__rdtsc() - first) / us;
}
"""


def clocks_per_us(folder: Path) -> float:
    """Clocks of the processor (x86) that LinuxCNC counts the time of its functions in."""
    (folder / "clocks.c").write_text(CLOCKS)
    command = "gcc -O2 -shared -fPIC -o clocks.so clocks.c"
    subprocess.run(command.split(), check=True, cwd=folder)
    library = ctypes.CDLL(str(folder / "clocks.so"))
    library.clocks_per_us.restype = ctypes.c_double
    return float(library.clocks_per_us())


def motion_us(folder: Path) -> dict[str, tuple[float, float]]:
    """Median and longest time of LinuxCNC's motion controller in a servo cycle of 1 ms, µs.

    By kinematics, while X Y Z A C move together: trivkins, and the component with TCP on.
    """
    case = hidden(20_001, clearance=4.0, kind="cross")
    files = linuxcnc_files(case.setup, case.errors).files
    plain = replace(case.bench, boxes=[], table_radius_mm=1.0, table_z_mm=-1500.0, speed=1.0)
    own = replace(
        plain,
        kinematics="trunnionkins",
        components={"trunnionkins": compiled("trunnionkins", files["trunnionkins.comp"])},
        hal=files["trunnion.hal"],
    )
    per_us = clocks_per_us(folder)
    found = {}
    for name, bench, code in (("trivkins", plain, "M429"), ("trunnionkins", own, "M428")):
        lines = ["T1 M6 G43 H1", "G21 G90 G94", code]
        lines += ["G1 F3000 X60 Y-40 Z20 A30 C90", "G1 F3000 X0 Y0 Z50 A-20 C0"] * 2
        report = run(bench, [{"mdi": line} for line in lines], folder / name)
        clocks = np.array([step["clocks"] for step in report[3:]])
        median, longest = float(np.median(clocks[:, 0])), float(clocks[:, 1].max())
        found[name] = (median / per_us, longest / per_us)
    return found


def main(count: int, out: Path | None) -> None:
    """Judge many machines and write a table."""
    rows: list[Judged] = []
    seed = 20_000
    while len(rows) < count:
        seed += 1
        with tempfile.TemporaryDirectory() as name:
            Path(name).chmod(0o755)
            try:
                rows.append(judged(seed, Path(name)))
            except tn.DataError as error:  # the plan reaches nothing
                print(seed, error, flush=True)
                continue
        print(rows[-1], rows[-1].holds, flush=True)
    text = table(rows)
    print(text)
    if out is not None:
        out.write_text(text, encoding="utf-8")


def table(rows: list[Judged]) -> str:
    """Return the page of the results."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        motion = motion_us(Path(name))
    text = HEAD.format(
        count=len(rows),
        plain=motion["trivkins"][0],
        own=motion["trunnionkins"][0],
        cycle=cycle_us(),
        holds=sum(row.holds for row in rows),
        touches=f"{min(row.touches for row in rows)} to {max(row.touches for row in rows)}",
        least=min(row.before_um / row.left_um for row in rows),
        median=np.median([row.before_um / row.left_um for row in rows]),
    )
    for row in rows:
        low, high = row.interval_um
        text += (
            f"| {row.seed} | {row.before_um:.1f} | {row.left_um:.2f} | "
            f"{row.before_um / row.left_um:.0f} | {low:.2f} to {high:.2f} | "
            f"{'yes' if row.holds else 'no'} |\n"
        )
    return text


HEAD = """# Corrected machines in LinuxCNC: {count} machines

Made by `make linuxcnc-corrected`. Each machine has random location errors (±60 µm, ±60 arcsec),
an A axis up to 20 mm off the table's centre and a random cross, probed in two passes (30 mm/min,
servo period 1 ms) at A 0, ±45 and ±90 and every 90° of C (`trunnion plan --tilt 90,-90,45,-45
--every-pose`; {touches} touches). LinuxCNC runs the program of `trunnion program`;
its log gives the estimate, the estimate the kinematics component. LinuxCNC with the component
then goes to 336 poses (A −90 to 90 by 30°, C by 60°, corners of ±150 × ±120 × 0 to 150 mm):
*left* is the largest distance, on the
table of the real machine, between the tool point and the programmed point; *forecast* the 95 %
interval that `trunnion compensate` printed before. The forecast holds for {holds} of {count}; the
error falls by at least {least:.0f} times, {median:.0f} times in the median. Forward and inverse
kinematics of the component together take {cycle:.1f} µs (the longest of ten means over 200,000
cycles, on the computer of the run) of a servo period of 1000 µs. In the running LinuxCNC its motion
controller takes {plain:.1f} µs a cycle with trivkins and {own:.1f} µs with the component, in the
median of cycles in which all five axes move (`motion-controller.time`).

| machine | before, µm | left, µm | times | forecast, µm | holds |
|---|---|---|---|---|---|
"""

if __name__ == "__main__":
    main(*count_and_out(__doc__))

"""Medians and ratios of the main job against peers in the same run, one thread unless said.

Run by ``make bench``. Peers: Pinocchio called pose by pose, a CasADi map, the same calibrations
tick by tick, scipy's least squares on the same residuals and derivatives, the CasADi baseline, and
the sweep written in plain numpy with scipy.
"""

import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[1]))

import trunnion as tn
from trunnion.probing.model import TouchModel

SETUP = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(tick_um=0.1))
PLAN = tn.plan(SETUP)
ERRORS = {"EX0C": 15.0, "EA0A": 3.6, "EB0A": 18.0, "EB0C": 25.2, "EY0C": 21.0, "EZ0A": 20.0}


def seconds(work: Callable[[], Any], rounds: int = 5, *, wall: bool = False) -> float:
    """Median time of a call, after one that does not count.

    Processor time, which a loaded machine falsifies less; wall time where several cores work.
    """
    clock = time.perf_counter if wall else time.process_time
    work()
    times = []
    for _ in range(rounds):
        begun = clock()
        work()
        times.append(clock() - begun)
    return statistics.median(times)


def line(what: str, value: str, ratio: float | None = None, expected: float | None = None) -> None:
    """One line of the table."""
    compared = "" if ratio is None else f"{ratio:10.1f} x"
    goal = "" if expected is None else f"   (expected {expected:g} x)"
    print(f"{what:58} {value:>16} {compared}{goal}", flush=True)


def kinematics() -> None:
    """Batched forward kinematics against Pinocchio pose by pose and a CasADi map."""
    import casadi as ca
    import pinocchio as pin

    rng = np.random.default_rng(0)
    n = 100_000
    axes = np.column_stack([rng.uniform(-100, 100, (n, 3)), rng.uniform(-90, 90, (n, 2))])
    ours = seconds(lambda: tn.forward_kinematics(SETUP, axes, ERRORS)) / n
    line("forward kinematics, array call, a pose", f"{ours * 1e9:.0f} ns")

    model = tn.pinocchio_model(SETUP, ERRORS)
    data = model.createData()
    poses = np.column_stack([axes[:, :3], np.deg2rad(axes[:, 3:])])[:2000]

    def by_pose() -> None:
        # The tool point in the work's frame, as the array call gives it.
        for q in poses:
            pin.forwardKinematics(model, data, q)
            data.oMi[5].actInv(data.oMi[3].translation)

    peer = seconds(by_pose) / len(poses)
    line("  Pinocchio from Python, a pose", f"{peer * 1e9:.0f} ns", peer / ours, 100)

    q = ca.SX.sym("q", 5)

    def rx(t: Any) -> Any:
        return ca.vertcat(
            ca.horzcat(1, 0, 0),
            ca.horzcat(0, ca.cos(t), -ca.sin(t)),
            ca.horzcat(0, ca.sin(t), ca.cos(t)),
        )

    def rz(t: Any) -> Any:
        return ca.vertcat(
            ca.horzcat(ca.cos(t), -ca.sin(t), 0),
            ca.horzcat(ca.sin(t), ca.cos(t), 0),
            ca.horzcat(0, 0, 1),
        )

    small = rx(2e-5) @ rz(3e-5)
    turn = small @ rx(q[3]) @ small @ rz(q[4])
    offset = small @ rx(q[3]) @ ca.DM([1e-2, 2e-2, 0]) + ca.DM([0, 1e-2, 2e-2])
    tool = turn.T @ (q[:3] - offset)
    function = ca.Function("f", [q], [ca.vertcat(tool, turn.T @ ca.DM([0, 0, 1]))])
    mapped = function.map(n)
    columns = np.ascontiguousarray(axes.T)
    peer = seconds(lambda: mapped(columns)) / n
    line("  CasADi map, a pose", f"{peer * 1e9:.0f} ns", peer / ours, 20)


def twins() -> None:
    """The same calibration in plain numpy: tick by tick, and solved with scipy's least squares."""
    from twin.contact import step_to_contact
    from twin.forward import Setup, Truth, approach_lines
    from twin.generator import (
        jacobian,
        measure,
        paper_plan,
        random_errors,
        random_placement,
        readings_um,
    )

    setup = Setup()
    plan = paper_plan(setup)
    rng = np.random.default_rng(0)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
    samples = 20_000
    ours = seconds(
        lambda: tn.sweep(
            "calibration",
            samples=samples,
            seed=1,
            fixed={"identify": False},
            threads=1,
            progress=False,
        ),
        3,
    )
    ours /= samples

    def simulate_and_solve() -> None:
        way = measure(plan, setup, truth, noise_um=0.3, tick_um=0.1, seed=1).way_um
        np.linalg.lstsq(design, way - nominal, rcond=None)

    design, nominal = jacobian(plan, setup), readings_um(plan, setup, Truth({}, {}, {}))
    peer = seconds(simulate_and_solve, 21)
    line("  plain numpy, linear least squares, a calibration", f"{peer * 1e6:.0f} µs", peer / ours)

    def ticks() -> None:
        lines = approach_lines(plan.conditions, plan.start_mm, setup, truth)
        step_to_contact(lines, 1e-4, 15.0)

    peer = seconds(ticks, 1)
    line("  tick by tick in numpy, a calibration", f"{peer * 1e3:.0f} ms", peer / ours, 1000)

    names = [*truth.errors, *truth.placement]
    measured = measure(plan, setup, truth, noise_um=0.3, tick_um=0.1, seed=1).way_um

    def residuals(values: Any) -> Any:
        named = dict(zip(names, values, strict=True))
        guess = Truth(
            errors={name: named[name] for name in truth.errors},
            placement={name: named[name] for name in truth.placement},
            effects={},
        )
        return readings_um(plan, setup, guess) - measured

    peer = seconds(lambda: least_squares(residuals, np.zeros(len(names))), 1)
    whole = seconds(
        lambda: tn.sweep("calibration", samples=2000, seed=1, threads=1, progress=False), 3
    )
    whole /= 2000
    line("a whole sample with identification", f"{whole * 1e6:.0f} µs")
    line("  plain numpy with scipy, a sample", f"{peer * 1e3:.0f} ms", peer / whole)


def sweeps() -> None:
    """Whole sweeps in an array call."""
    samples = 20_000
    fixed = {"identify": False}

    def closed(threads: int) -> Callable[[], Any]:
        return lambda: tn.sweep(
            "calibration", samples=samples, seed=1, fixed=fixed, threads=threads, progress=False
        )

    one = seconds(closed(1), 3)
    line("calibrations a second, one core", f"{samples / one:.0f}", samples / one / 50_000, 1)
    # Rounds in turn: what else the machine does falls on both alike.
    times = [[seconds(closed(threads), 1, wall=True) for threads in (1, 2)] for _ in range(5)]
    two = statistics.median(pair[1] for pair in times)
    gain = statistics.median(pair[0] / pair[1] for pair in times)
    line("  on two cores, against one", f"{samples / two:.0f}", gain, 1.8)
    runs: tuple[tuple[str, str, int, dict[str, Any], str], ...] = (
        ("a million", "calibration", 1_000_000, fixed, "15 s, 1 GiB"),
        ("100,000 with identification", "calibration", 100_000, {}, "20 s"),
        ("100,000 compensations", "compensation", 100_000, {}, ""),
    )
    for name, study, count, kept, expected in runs:
        took, cores, peak = in_full(study, count, kept)
        goal = f"   (expected {expected})" if expected else ""
        print(
            f"  {name + ', two cores':56} {took:.1f} s ({cores:.1f} s of processors), "
            f"peak {peak:.2f} GiB{goal}",
            flush=True,
        )

    def tiny() -> None:
        tn.sweep("calibration", samples=1, seed=1)

    took = seconds(tiny, 51, wall=True)
    line("a study of one node and one sample", f"{took * 1e3:.2f} ms", 5e-3 / took, 1)


IN_FULL = """
import resource, sys, time
import trunnion as tn
study, samples, fixed = eval(sys.argv[1])
how = dict(seed=1, fixed=fixed, threads=2, progress=False)
tn.sweep(study, samples=10, **how)
begun, worked = time.perf_counter(), time.process_time()
found = tn.sweep(study, samples=samples, **how)
took, worked = time.perf_counter() - begun, time.process_time() - worked
assert found.attrs["samples_done"] == samples and found.attrs["samples_failed"] == 0
print(took, worked, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def in_full(study: str, samples: int, fixed: dict[str, Any]) -> tuple[float, float, float]:
    """Wall time and processor time in s, peak memory in GiB of a sweep in a process of its own."""
    arguments = [sys.executable, "-c", IN_FULL, repr((study, samples, fixed))]
    printed = subprocess.run(arguments, check=True, capture_output=True, text=True).stdout.split()
    return float(printed[0]), float(printed[1]), float(printed[2]) / 2**20


def identification() -> None:
    """One identification in an array call, against scipy and the CasADi baseline."""
    data = tn.simulate(PLAN, SETUP, ERRORS, {"dx_um": 40.0}, noise_um=0.3, seed=1)
    model = TouchModel(SETUP)
    moves = model.moves(data)
    many = 1000
    points = np.repeat(data.position_mm.reshape(1, -1), many, axis=0)
    ours = seconds(
        lambda: model.core.fit_many(
            moves,
            points,
            model.values(),
            huber=None,
            sigma_um=0.0,
            priors=[],
            max_steps=50,
            threads=1,
        )
    )
    ours /= many
    line("identification of 14 parameters, array call", f"{ours * 1e6:.0f} µs", 150e-6 / ours, 1)

    def residuals(values: Any) -> Any:
        return model.core.linearise(moves, values)[0]

    def jacobian(values: Any) -> Any:
        return -model.core.linearise(moves, values)[1]

    peer = seconds(
        lambda: least_squares(residuals, model.values(), jacobian, method="trf", x_scale="jac"), 11
    )
    line("  scipy least_squares (trf), same derivatives", f"{peer * 1e6:.0f} µs", peer / ours, 5)
    peer = seconds(lambda: tn.casadi_baseline.identify(data, SETUP), 3)
    line("  CasADi baseline", f"{peer * 1e3:.1f} ms", peer / ours, 100)


def fields() -> None:
    """Volumetric error: a million points at one pose, and every node of a large map."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-100, 100, (1_000_000, 3))
    at_pose = tn.volumetric_error(SETUP, ERRORS, a_deg=30, c_deg=40)
    ours = seconds(lambda: at_pose.at(points))
    line("field of a million points at one pose", f"{ours * 1e3:.0f} ms", 50e-3 / ours, 1)

    def in_numpy() -> Any:
        return points @ np.eye(3) + np.ones(3)

    peer = seconds(in_numpy)
    line("  one affine map of them in numpy", f"{peer * 1e3:.0f} ms", peer / ours)
    tilts, turns = np.linspace(-90, 90, 37), np.linspace(0, 360, 73)
    begun = time.perf_counter()
    for field in tn.error_fields(SETUP, ERRORS, points=(61, 49, 31), a_deg=tilts, c_deg=turns):
        assert field.max_um > 0.0
    took = time.perf_counter() - begun
    line("61 x 49 x 31 points at 37 x 73 poses, one by one", f"{took:.1f} s")


def diagnosis() -> None:
    """One diagnosis of 504 touches: wall time as a user has it, processor time on one core."""
    plan = tn.plan(
        SETUP, c_deg=range(0, 360, 30), a_deg=(30, -30, 60, -60, 90, -90), both_senses=True
    )
    hidden: list[tuple[str, dict[str, dict[str, float]]]] = [
        ("nothing hidden", {}),
        ("one effect", {"drift_z": {"rate_um_h": 6.0}}),
        (
            "two effects",
            {"drift_z": {"rate_um_h": 6.0}, "c_positioning_2": {"a2_arcsec": 6.0, "b2_arcsec": -4}},
        ),
    ]
    for name, effects in hidden:
        data = tn.simulate(plan, SETUP, ERRORS, effects=effects, noise_um=0.3, seed=1)
        work = partial(tn.diagnose, data, SETUP)
        wall = seconds(work, 9, wall=True)
        line(f"diagnosis of {len(data)} touches, {name}", f"{wall * 1e3:.0f} ms", 50e-3 / wall, 1)
        spent = seconds(work, 9)
        line("  time of processors", f"{spent * 1e3:.0f} ms", 20e-3 / spent, 1)


def turning() -> None:
    """A finishing program of 100,000 blocks: parsed, corrected, written."""
    z = 500 - np.arange(1, 100_001) * 4e-3
    x = 40 + 2 * np.sin(z / 30)
    blocks = "\n".join(f"X{a:.3f} Z{b:.3f}" for a, b in zip(x, z, strict=True))
    text = f"G7 G90\nG0 X40 Z500\nG1 F0.1\n{blocks}\n"
    at = np.arange(500, 100, -0.5)
    error = 10 * np.sin(at / 20)

    def correct() -> str:
        program = tn.nc.Program.parse(text, "linuxcnc-lathe")
        return tn.turning.correct(program, (at, error), window=1).program.text()

    ours = seconds(correct, 3)
    line("correction of a program of 100,000 blocks", f"{ours:.2f} s", 1.0 / ours, 1)


def imports() -> None:
    """Processor time of importing the package in a fresh process, against numpy and scipy."""

    def spent(code: str) -> float:
        def once() -> float:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([sys.executable, "-c", code], check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

        return statistics.median(once() for _ in range(9))

    bare = spent("pass")
    peer = spent("import numpy, scipy.linalg") - bare
    ours = spent("import trunnion") - bare
    line("import trunnion, time of processors", f"{ours * 1e3:.0f} ms")
    line("  import numpy, scipy.linalg", f"{peer * 1e3:.0f} ms", ours / peer, 1.5)
    used = spent("import trunnion as tn; [getattr(tn, name) for name in tn.__all__]") - bare
    line("  the same with every public name used", f"{used * 1e3:.0f} ms", used / peer)


def main() -> None:
    """Everything."""
    imports()
    kinematics()
    fields()
    sweeps()
    twins()
    identification()
    diagnosis()
    turning()


if __name__ == "__main__":
    main()

# ruff: noqa: E501
"""Hostile arguments: a good call of every public function, and what is put in place of an argument.

A call may give a result without nan, or an error of the package; nothing else, and it returns.
"""

import datetime
import faulthandler
import math
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import trunnion as tn
from result_examples import (
    CENTRE,
    POSE,
    cross,
    cross_setup,
    diagnosis_of,
    finishing,
    profile,
    r_test,
    short,
)
from trunnion import compensation, contouring, hybrid, nc, turning

__all__ = ["PUBLIC", "attack", "calls", "holds_nan"]

MAX_SECONDS = 60
"""A call that takes longer is a hang: the process ends with a traceback."""

NUMBERS: list[Any] = [
    *(math.nan, math.inf, -math.inf, 0, 0.0, -0.0, -1, 1, 2, 0.5, 1e-9, 5e-324, 1e-300, 1e-160),
    *(1e3, 1e6, 1e9, 1e15, 1e100, 1e154, 1e300, -1e300, 1.7e308, 2147483648, 2**63, 2**64, 10**400),
]
HOSTILE: list[Any] = [
    *NUMBERS,
    *(None, True, False, "x", "", "\0", "a" * 5000, "EX0C", b"x", 1j, [], (), {}, set(), range(3)),
    *([math.nan], [1e300], [1], [0, 0], [1, 2, 3], [[1, 2], [3]], [[1.0, 2.0, 3.0]], [[]], [None]),
    *(["x"], [1j], {"x": 1.0}, {"EX0C": math.nan}, {"EX0C": 1e300}, {"EX0C": "x"}, {1: 2}, {"x": {}}),
    *({"drift_z": {"rate_um_h": math.inf}}, {"drift_z": {"x": 1.0}}, {"drift_z": 5}, {None: None}),
    *(np.zeros(0), np.zeros((0, 3)), np.full((2, 3), math.nan), np.full((4, 5), 1e300)),
    *(np.zeros((2, 2, 2)), np.array(["a", "b"]), np.array([1j]), np.array(3.0), np.array([None])),
    *(np.float32("nan"), np.int64(3), Decimal(1), Fraction(1, 3), object(), object, len, ...),
    *(datetime.date(2020, 1, 1), NotImplemented, ValueError("x"), Path("x"), memoryview(b"ab")),
]  # fmt: skip


@cache
def servo() -> contouring.Servo:
    return contouring.Servo.paper()


@cache
def mechanism() -> hybrid.Mechanism:
    return hybrid.Mechanism()


@cache
def ballbar_plan() -> tn.Ballbar:
    return hybrid.ballbar_plan(mechanism(), CENTRE, step_deg=45.0)


@cache
def small_plan() -> tn.Touches:
    return tn.plan(cross_setup())


def readings() -> tuple[Any, Any]:
    z = np.arange(5.0, 45.0, 1.0)
    return z, 12.0 * np.sin(z / 9.0)


BOX: dict[str, Any] = {"x_mm": (-50, 50), "y_mm": (-50, 50), "z_mm": (0, 50)}
LOCATION = {"EX0C": 15.0, "EA0A": 20.0}


def _probing() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    touches, setup = cross()
    base = {"data": touches, "setup": setup}
    plan = {"plan": small_plan(), "setup": setup}
    known_probe = tn.Setup(artefact=setup.artefact, probe=tn.Probe(repeatability_um=0.3))
    positions = np.stack([small_plan().position_mm] * 2)
    return {
        "forward_kinematics": (tn.forward_kinematics, {"setup": setup, "axes": [[1.0, 2, 3, 4, 5]], "errors": LOCATION}),
        "kinematic_jacobian": (tn.kinematic_jacobian, {"setup": setup, "axes": [[1.0, 2, 3, 4, 5]], "errors": LOCATION}),
        "inverse_kinematics": (tn.inverse_kinematics, {"setup": setup, "point_mm": [1, 2, 3], "direction": [0, 0.6, 0.8], "branch": "nearest", "reference_deg": [0, 0], "errors": LOCATION}),
        "plan": (tn.plan, {"setup": setup, "c_deg": (0, 90), "a_deg": (90,), "feeds_mm_min": (600,), "both_senses": False, "repeats": 1, "positions_deg": [(0, 0)], "layout": "side", "all_faces": False}),
        "simulate": (tn.simulate, {**plan, "errors": LOCATION, "placement": {"dx_um": 1.0}, "effects": {"drift_z": {"rate_um_h": 5.0}}, "noise_um": 0.1, "tick_um": 0.1, "seed": 1, "sample": 0}),
        "closed_form": (tn.closed_form, {**base, "method": "printed"}),
        "identify": (tn.identify, {**base, "effects": ("drift_z",), "loss": "huber", "priors": None, "max_steps": 20}),
        "identify priors": (tn.identify, {**base, "setup": known_probe, "priors": {"EX0C": (10.0, 1.0)}}),
        "identify_many": (tn.identify_many, {**plan, "positions_mm": positions, "effects": ("drift_z",), "max_steps": 20, "threads": 1}),
        "observability": (tn.observability, {**plan, "effects": ("drift_z",), "noise_um": 0.3}),
        "plan_notes": (tn.plan_notes, plan),
        "probing_program": (tn.probing_program, {**plan, "log": "touches.log", "name": "plan", "start_at": 2, "dry_run": False, "feed_mm_min": None, "corrected": False, "tcp": False}),
        "plan_for": (tn.plan_for, {"setup": setup, "errors": ["EX0C", "EA0A"], "criterion": "A", "max_minutes": 3.0, "max_touches": 12, "feed_mm_min": 600.0}),
        "compare": (tn.compare, {"before": tn.identify(touches, setup), "after": tn.identify(touches, setup), "names": ("first", "then"), "uncertainty": {"EX0C": 0.1}, "level": 0.05}),
        "smallest_length_mm": (tn.smallest_length_mm, {"linear_um": 0.1, "rotary_arcsec": 0.36}),
        "compare_methods": (tn.compare_methods, {**base, "truth": LOCATION}),
        "plan_rotary_test": (tn.plan_rotary_test, {"setup": setup, "ball_mm": (90, 0, 60), "positions_deg": {"A": [0, 30], "C": [0, 90]}, "bar_mm": (100, 0, 0), "frame": "work"}),
        "simulate_rotary_test": (tn.simulate_rotary_test, {"plan": r_test()[0], "setup": setup, "ball_mm": (90, 0, 60), "errors": LOCATION, "bar": False, "tool_offset_um": (0, 0, 0), "noise_um": 0.1, "seed": 1}),
        "identify_rotary_test": (tn.identify_rotary_test, {"data": r_test()[0], "setup": setup, "ball_mm": (90, 20, 60), "sigma_um": 0.5, "tool_is_known": False}),
        "sample_path": (tn.sample_path, {"name": "cross/setup.toml"}),
        "canonical_error_name": (tn.canonical_error_name, {"text": "E_xoc"}),
        "catalogue": (tn.catalogue, {"of": "touches", "setup": setup}),
        "diagnose": (tn.diagnose, {"data": tn.read_diameters(tn.sample_path("turning/diameters.csv")), "setup": tn.read_setup(tn.sample_path("turning/setup.toml")), "effects": ()}),
        "next_touches": (tn.next_touches, {"d": diagnosis_of("touches"), "n": 2}),
        "expected_discrimination": (tn.expected_discrimination, {"d": diagnosis_of("touches"), "n": 2}),
        "next_measurement": (tn.next_measurement, {"diagnosis": diagnosis_of("touches"), "setup": setup, "mounting_minutes": {"ballbar": 5.0}}),
        "next_passes": (tn.next_passes, {"diagnosis": diagnosis_of("diameters")}),
        "fit_circles": (tn.fit_circles, {"data": tn.read_sweep(tn.sample_path("axis/sweep.csv"))}),
        "repeatable_part": (tn.repeatable_part, {"d": diagnosis_of("points"), "other": tn.read_points(tn.sample_path("plate/second.csv"))}),
        "Artefact": (tn.Artefact, {"kind": "sphere", "diameter_mm": 20.0, "centre_mm": (0, 0, 60)}),
        "Machine": (tn.Machine, {"preset": "trt-ca", "errors": LOCATION, "tolerance": {}, "table_normal": (0.0, 0.0, 1.0)}),
        "Probe": (tn.Probe, {"ball_radius_mm": 1.0, "repeatability_um": 0.3, "tick_um": 0.1}),
        "Setup": (tn.Setup, {"artefact": setup.artefact, "machine": setup.machine, "axes": {"C": tn.AxisSetup(-1)}, "probe": setup.probe}),
        "Touches": (tn.Touches, dict(touches.columns)),
    }  # fmt: skip


def _compensation() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    setup = cross_setup()
    at = {"points_mm": [[1.0, 2.0, 3.0]], "rotary_deg": {"A": 30.0, "C": 40.0}}
    return {
        "volumetric_error": (tn.volumetric_error, {"setup": setup, "errors": LOCATION, "effects": {"a_twist": {"k_arcsec": 2.0}}, **BOX, "a_deg": 30, "c_deg": (0, 90), "placement": {"dx_um": 1.0}, "rounded": False, "points": (3, 3, 2)}),
        "error_map": (tn.error_map, {"setup": setup, "errors": LOCATION, **BOX, "linear_step_mm": 300.0, "rotary_step_deg": 90.0, "resolution_um": 0.1}),
        "cnc_parameters": (tn.cnc_parameters, {"setup": setup, "errors": LOCATION, **BOX, "a_deg": (0, 30), "c_deg": (0, 90)}),
        "inverse_compensation": (tn.inverse_compensation, {"setup": setup, "errors": LOCATION, **at, "axes": "all", "largest_turn_deg": 1.0, "rounded": True, "threads": 1}),
        "printed_zeros": (tn.printed_zeros, {"errors": LOCATION, "setup_yaw_arcsec": 1.0}),
        "remeasure": (tn.remeasure, {"plan": small_plan(), "setup": setup, "compensation": tn.InverseCompensation.of(setup, LOCATION), "errors": LOCATION, "noise_um": 0.1, "seed": 1, "sample": 0}),
        "residual_interval": (tn.residual_interval, {"setup": setup, "estimate": tn.identify(*cross()), **BOX, "a_deg": 30, "c_deg": 0, "degrees_of_freedom": 20.0, "level": 0.9, "draws": 100, "seed": 1}),
        "VolumetricError.at": (tn.volumetric_error(setup, LOCATION, points=(3, 3, 2)).at, {"points_mm": [[1, 2, 3]], "threads": 1}),
        "InverseCompensation.of": (tn.InverseCompensation.of, {"setup": setup, "errors": LOCATION, "effects": None, "largest_turn_deg": 1.0}),
        "compensation.MachineErrors.of": (compensation.MachineErrors.of, {"setup": setup, "errors": LOCATION, "effects": {"a_twist": {"k_arcsec": 2.0}}, "placement": {"dx_um": 1.0}}),
        "volumetric_budget": (tn.volumetric_budget, {"setup": setup, "estimate": tn.identify(*cross()), **BOX, "a_deg": 30, "c_deg": 0, "tolerance_um": 30.0, "method": "monte-carlo", "draws": 200, "seed": 1}),
        "budget": (tn.identify(*cross()).budget, {"names": ("EX0C",), "tolerances": {"EX0C": 5.0}, "method": "monte-carlo", "draws": 200, "seed": 1}),
        "interval": (tn.identify(*cross()).interval, {"name": "EX0C", "coverage": 0.9}),
    }  # fmt: skip


def _contouring() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    path, axis = short(), {"gain_per_s": 80.0, "time_constant_ms": 5.0, "coulomb_um": 1.0, "breakaway_um": 2.0, "stribeck_mm_min": 3.0, "backlash_um": 1.0, "cyclic_um": 1.0, "pitch_mm": 5.0, "phase_deg": 10.0, "delay_ms": 1.0, "resonance_hz": 50.0, "damping": 0.1, "limit_mm_min": 1e4}  # fmt: skip

    def run_axis(**given: Any) -> Any:
        axes = {**servo().axes, "X": contouring.LinearAxis(**given)}
        made = contouring.Servo(axes)
        return contouring.simulate(path, 1000.0, servo=made), contouring.margins(
            made, path=path, u=[0.0]
        )

    def run_feed(**given: Any) -> Any:
        return contouring.simulate(path, contouring.Feed(**given))

    def run_coupling(**given: Any) -> Any:
        coupling = contouring.Coupling(**given)
        run = contouring.simulate(path, 1000.0, controller=coupling)
        return run, contouring.margins(controller=coupling, path=path, u=[0.0])

    def run_servo(**given: Any) -> Any:
        made = contouring.Servo(**given)
        return contouring.simulate(path, 1000.0, servo=made)

    points = [[0.0, 0, 0], [1, 1, 1], [3, 2, 2], [5, 2, 3]]
    tools = [[0.0, 0, 1], [0, 0.1, 1], [0, 0.2, 1], [0, 0.1, 1]]
    return {
        "axis": (run_axis, axis),
        "feed": (run_feed, {"feed_mm_min": 1000.0, "acceleration_time_s": 0.1, "decelerate": True, "normal_acceleration_mm_s2": 500.0, "dwell_s": 0.1}),
        "coupling": (run_coupling, {"position": "circle", "orientation": "tangent", "gains": np.ones((5, 3)), "order": "jacobian_last"}),
        "servo": (run_servo, {"axes": dict(servo().axes), "period_ms": 1.0, "feedback": "load"}),
        "contouring.simulate": (contouring.simulate, {"path": path, "feed": 1000.0, "controller": "proposed", "servo": servo(), "errors": LOCATION, "assumed": LOCATION}),
        "contouring.sweep": (contouring.sweep, {"paths": [path], "feeds_mm_min": [1000.0], "controllers": ["independent"], "errors": LOCATION}),
        "contouring.compare": (contouring.compare, {"path": path, "feeds_mm_min": (1000.0,), "controllers": ("independent",)}),
        "contouring.margins": (contouring.margins, {"servo": servo(), "controller": "proposed", "path": path, "u": [0.0], "assumed": LOCATION}),
        "Path.circle": (contouring.Path.circle, {"radius_mm": 5.0, "turn_deg": 20.0, "tilt_deg": 10.0, "centre_mm": (0, 0, 0)}),
        "Path.polynomial": (contouring.Path.polynomial, {"coefficients": [[0.0] * 5 + [1.0], [1.0] * 6], "end": 1.0}),
        "Path.spline": (contouring.Path.spline, {"points_mm": points, "tools": tools}),
        "Path.lines": (contouring.Path.lines, {"points_mm": points, "tools": tools}),
        "Path.shifted": (path.shifted, {"offset_mm": (1.0, 2.0, 3.0)}),
        "Path.points_mm": (path.points_mm, {"u": [0.1]}),
        "Path.tools": (path.tools, {"u": [0.1]}),
        "Path.curvature_per_mm": (path.curvature_per_mm, {"u": [0.1]}),
        "Path.at_length": (path.at_length, {"s_mm": [0.1]}),
        "axis_log": (contouring.simulate(path, 1000.0).axis_log, {"noise_um": 0.1, "noise_arcsec": 0.1, "log_delay_ms": 1.0, "seed": 1, "run": "a"}),
    }  # fmt: skip


def _hybrid() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    m, plan = mechanism(), ballbar_plan()
    some = ("e4_um", "e5_um")
    return {
        "Mechanism": (hybrid.Mechanism, {"dimensions": {}, "errors": {"e5_um": 3.0}, "home_mm": (0, -350, -1400), "closure_mm": (1000, 1000, 1000, 1000)}),
        "Mechanism.forward": (m.forward, {"joints": POSE, "threads": 1}),
        "Mechanism.sensitivity": (m.sensitivity, {"joints": POSE, "parameters": some, "threads": 1}),
        "Mechanism.inverse": (m.inverse, {"tip_mm": CENTRE, "direction": (0, 0, -1), "wrist": 1, "reference_deg": 0.0, "threads": 1}),
        "Mechanism.constraint": (m.constraint, {"joints": POSE}),
        "Mechanism.strain": (m.strain, {"joints": POSE, "parameters": some, "threads": 1}),
        "Mechanism.ballbar": (m.ballbar, {"joints": POSE, "centres_mm": CENTRE, "parameters": some, "threads": 1}),
        "Mechanism.closure_dependence": (m.closure_dependence, {"joints": POSE, "errors": {"base3_c": 10.0}}),
        "Mechanism.with_errors": (m.with_errors, {"errors": {"e5_um": 3.0}}),
        "hybrid.ballbar_plan": (hybrid.ballbar_plan, {"mechanism": m, "centre_mm": CENTRE, "setup": 0, "radius_mm": 150.0, "direction": (0, 0, -1), "wrist": 1, "circles": (("XY", 0.0, 90.0),), "step_deg": 30.0, "both_senses": True, "repeat_first": True, "feed_mm_min": 1000.0, "pause_s": 1.0, "start_s": 0.0}),
        "hybrid.choose_poses": (hybrid.choose_poses, {"candidates": plan, "mechanism": m, "count": 4, "parameters": some, "sigma_um": 0.5, "tolerance": 100.0, "threads": 1}),
        "hybrid.identifiability": (hybrid.identifiability, {"plan": plan, "mechanism": m, "parameters": some, "sigma_um": 0.5, "threads": 1}),
        "hybrid.identify_ballbar": (hybrid.identify_ballbar, {"data": plan, "mechanism": m, "parameters": some, "sigma_um": 0.5, "tolerance": 100.0, "threads": 1}),
        "hybrid.cube_study": (hybrid.cube_study, {"mechanism": m, "errors": ["e4"], "side_mm": 100.0, "centre_mm": CENTRE, "direction": (0, 0, -1), "amount": 10.0, "wrist": 1}),
        "hybrid.transformed_cube": (hybrid.transformed_cube, {"mechanism": m, "error": "e4", "amount": 10.0}),
    }  # fmt: skip


def _turning() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    program, part = finishing().program, profile()
    path = turning.probe_path(part, chuck_radius_mm=10.0)
    gauge = turning.Gauge()
    follow = {"follows": "contour", "nose_mm": 0.0, "feed": 100.0, "machine_codes": [("G", 4503.0)]}
    return {
        "nc.follow": (nc.follow, {"program": program, "blocks": (0, 3), "start": (0, 0, 0, 0, 0, 0), "feed": 100.0, "machine_codes": [("G", 4503.0)]}),
        "turning.correct": (turning.correct, {"program": program, "readings": readings(), "rule": "bounded", "unit_um": 1.0, "bound_um": 1.0, "window": 5, "look_ahead": True, **follow, "keep_numbers": False}),
        "turning.change_um": (turning.change_um, {"before": program, "after": program, "z_mm": [5.0, 6.0], **follow}),
        "turning.crossings": (turning.crossings, {"listing": nc.Program.parse("G7 G90\nG0 X20 Z100\nG1 Z50 F100\nG1 X20.01 Z40\nG1 Z0\n", "linuxcnc-lathe"), "unit_um": 10.0, "window_mm": 5.0, "nominal_mm": 20.0}),
        "turning.probe_path": (turning.probe_path, {"profile": part, "probe": turning.TurningProbe(), "allowance_mm": 0.5, "skip": (), "retract_x_mm": 60.0, "approach_mm": 1.0, "chuck_radius_mm": 10.0, "shortest_mm": 1.0}),
        "TurningProbe": (lambda **k: turning.probe_path(part, turning.TurningProbe(**k), chuck_radius_mm=10.0), {"ball_diameter_mm": 3.0, "contact_angle_deg": 89.0, "body_diameter_mm": 4.9}),
        "Gauge": (lambda **k: turning.Gauge(**k).feed_limit_mm_min(1.0, slope_um_mm=1.0), {"range_um": 150.0, "resolution_um": 0.5, "rate_hz": 50.0, "response_s": 0.02}),
        "Gauge.feed_limit_mm_min": (gauge.feed_limit_mm_min, {"pitch_mm": 1.0, "slope_um_mm": 1.0, "lag_um": 1.0}),
        "Gauge.read": (gauge.read, {"z_mm": readings()[0], "error_um": readings()[1], "feed_mm_min": 100.0, "noise_um": 0.1, "seed": 1}),
        "ProbePath.contact_z_mm": (path.contact_z_mm, {"interval": 0, "z_mm": [70.0]}),
        "ProbePath.stations_mm": (path.stations_mm, {"pitch_mm": 5.0}),
        "ProbePath.program": (path.program, {"dialect": "linuxcnc-lathe", "feed": 100.0, "first_number": 10, "head": [[("G", 7.0)]], "tail": (), "retract_last": True}),
        "Profile.from_points": (turning.Profile.from_points, {"points": [(100, 20), (50, 20), (50, 30), (0, 30)]}),
        "Profile.from_program": (turning.Profile.from_program, {"program": program, **follow}),
        "Profile.path": (part.path, {"follows": "tip", "nose_mm": 0.4, "convex": "roll"}),
        "Profile.radius_mm": (part.radius_mm, {"z_mm": 20.0}),
        "Profile.outline_mm": (part.outline_mm, {"step_mm": 0.5}),
        "Profile.finishing": (part.finishing, {"dialect": "linuxcnc-lathe", "follows": "contour", "nose_mm": 0.0, "convex": "roll", "first_element": 0, "start_z_mm": 101.0, "retract_x_mm": 40.0, "approach_mm": 1.0, "feed": 100.0, "first_number": 10}),
        "Corner": (lambda **k: turning.Profile.from_points([(100, 20), turning.Corner(**k), (0, 30)]), {"z_mm": 50.0, "x_mm": 20.0, "kind": "fillet", "radius_mm": 2.0}),
        "Program.parse": (nc.Program.parse, {"text": "G1 X1 F2\n", "dialect": "linuxcnc"}),
    }  # fmt: skip


@cache
def calls() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Good calls by name: the function and its arguments."""
    return {**_probing(), **_compensation(), **_contouring(), **_hybrid(), **_turning()}


PUBLIC = (tn.TrunnionError,)


def holds_nan(value: Any, depth: int = 6) -> bool:
    """Whether a result, its parts, or its `to_dict` hold a nan."""
    if isinstance(value, float | np.floating):
        return bool(np.isnan(value))
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fc" and bool(np.isnan(value).any())
    if depth == 0 or isinstance(value, str | bytes):
        return False
    if isinstance(value, Mapping):
        return any(holds_nan(each, depth - 1) for each in value.values())
    if isinstance(value, list | tuple | set | frozenset):
        return any(holds_nan(each, depth - 1) for each in value)
    if is_dataclass(value) and not isinstance(value, type):
        return any(holds_nan(getattr(value, f.name), depth - 1) for f in fields(value))
    return False


def mutated(good: Any, rng: random.Random) -> Any:
    """A good argument with one part of it made hostile, where it has parts."""
    if isinstance(good, np.ndarray) and good.size and good.dtype.kind == "f":
        made = good.copy()
        made.flat[rng.randrange(good.size)] = rng.choice(NUMBERS[:-1])
        return made
    if isinstance(good, list | tuple) and good:
        parts = list(good)
        parts[rng.randrange(len(parts))] = rng.choice(HOSTILE)
        return type(good)(parts)
    if isinstance(good, dict) and good:
        return {**good, rng.choice(list(good)): rng.choice(HOSTILE)}
    return rng.choice(NUMBERS) if isinstance(good, int | float) else rng.choice(HOSTILE)


def attack(
    table: Mapping[str, tuple[Callable[..., Any], dict[str, Any]]],
    rounds: int,
    seed: int,
    allowed: tuple[type[BaseException], ...] = PUBLIC,
) -> Iterator[str]:
    """Call everything in a table with one or two hostile arguments; yield what went wrong."""
    rng = random.Random(seed)
    for _ in range(rounds):
        for name, (function, good) in table.items():
            given = dict(good)
            for key in rng.sample(list(good), min(len(good), rng.choice((1, 1, 1, 2)))):
                given[key] = rng.choice(HOSTILE) if rng.random() < 0.6 else mutated(good[key], rng)
            changed = {k: v for k, v in given.items() if v is not good[k]}
            faulthandler.dump_traceback_later(MAX_SECONDS, exit=True)
            try:
                if holds_nan(function(**given)):
                    yield f"{name}({changed!r:.150}): nan"
            except allowed as error:
                if type(error) is ValueError and not str(error).startswith(
                    ("expected a ", "expected tuple")
                ):
                    yield f"{name}({changed!r:.150}): {type(error).__name__}: {error!s:.200}"
            except BaseException as error:
                yield f"{name}({changed!r:.150}): {type(error).__name__}: {error!s:.200}"
            finally:
                faulthandler.cancel_dump_traceback_later()

# ruff: noqa: E501
"""A good call of every function of the extension module, for hostile arguments.

Arguments of the wrong type are refused by the binding itself, as Python does: a TypeError, or an
OverflowError for a whole number that a machine word does not hold, a ValueError ("expected a
sequence of length 3") for another number of values, and numpy's warning, an error here, for complex
numbers deep in a list.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import trunnion as tn
import trunnion._core as core
from hostile import small_plan
from result_examples import CENTRE, POSE, cross, finishing, short
from trunnion import contouring

__all__ = ["REFUSALS", "core_calls"]

REFUSALS = (tn.TrunnionError, TypeError, OverflowError, ValueError, np.exceptions.ComplexWarning)

Calls = dict[str, tuple[Callable[..., Any], dict[str, Any]]]
PLACE: dict[str, Any] = {
    "place_mm": [0.0] * 3,
    "turn_deg": 0.0,
    "stem_diameter_mm": 0.0,
    "base_mm": [0.0, 0.0, 0.0],
    "clamps_mm": [[40.0, 0.0, 5.0, 5.0, 5.0]],
    "chuck_mm": [0.0, 0.0],
    "tolerance_mm": 1.0,
    "tolerance_deg": 1.0,
}
CHAIN = "[w C' A' b X Y Z (C) t]"
MACHINE = core.Machine(CHAIN, 150.0, [])
CROSS: dict[str, Any] = {
    "machine": MACHINE,
    "artefact": core.Artefact("cross", [100.0, 25.0, 25.0], **PLACE),
}
AXIS = np.array(
    [80.0, 5.0, 1.0, 2.0, 3.0, 1.0, 1.0, 5.0, 10.0, 1.0, 50.0, 0.1, 1e4, 1.0, 1.0, 1.0, 0.1]
)
GAINS = contouring.Coupling().gains
ERRORS = [("EX0C", 10.0), ("EA0A", 5.0)]


def moves() -> core.Moves:
    t, _ = cross()
    rotary = np.column_stack([t["a_deg"], t["c_deg"]])
    return core.Moves(rotary, t.position_mm, t.direction)


def touch_model() -> core.TouchModel:
    return core.TouchModel(
        **CROSS, ball_radius_mm=1.0, tick_um=0.1, servo_period_ms=0.0, effect_ids=[]
    )


def _done(study: Callable[..., Any]) -> Callable[..., Any]:
    """A study of samples: the rows of those that did not fail (the others are nan)."""

    def run(**given: Any) -> Any:
        rows, failures = study(**given)
        return np.delete(rows, [row for row, _ in failures], axis=0)

    return run


def _touches() -> Calls:
    t, _ = cross()
    model, made = touch_model(), moves()
    labels = [int(label) for label in t["point"]]
    zeros, n = np.zeros(len(model.parameters)), len(t)
    fit = {"huber": 1.5, "sigma_um": 0.3, "priors": [(0, 1.0, 2.0)], "max_steps": 20}
    plan = small_plan()
    rotary = np.column_stack([plan["a_deg"], plan["c_deg"]])
    planned = core.Moves(rotary, np.asarray(plan.start_mm), plan.direction)
    points = [int(label) for label in plan["point"]]
    measured = core.Measurements(model, planned, points, reach_mm=10.0, noise_um=0.1, seed=1)
    truths = np.zeros((2, len(zeros)))
    return {
        "Moves": (core.Moves, {"rotary_deg": np.zeros((2, 2)), "point_mm": np.ones((2, 3)), "direction": np.array([[0.0, 0, -1]] * 2), "feed_mm_min": np.ones(2), "time_s": np.ones(2), "sense": np.ones((2, 2))}),
        "TouchModel": (core.TouchModel, {**CROSS, "ball_radius_mm": 1.0, "tick_um": 0.1, "servo_period_ms": 1.0, "effect_ids": ["drift_z"]}),
        "residuals": (model.residuals, {"moves": made, "values": zeros}),
        "linearise": (model.linearise, {"moves": made, "values": zeros}),
        "faces": (model.faces, {"moves": made}),
        "simulate": (model.simulate, {"moves": made, "values": zeros, "from_start": False, "reach_mm": 10.0, "noise_um": 0.1, "seed": 1, "sample": 0}),
        "fit": (model.fit, {"moves": made, "start": zeros, **fit}),
        "fit_many": (model.fit_many, {"moves": made, "points": np.tile(t.position_mm.reshape(1, 3 * n), (2, 1)), "start": zeros, **fit, "threads": 1}),
        "separate": (model.separate, {"moves": made, "labels": labels, "start": zeros}),
        "printed": (model.printed, {"moves": made, "labels": labels}),
        "Measurements": (core.Measurements, {"model": model, "moves": made, "labels": labels, "reach_mm": 10.0, "noise_um": 0.1, "seed": 1}),
        "calibrations": (_done(measured.calibrations), {"truths": truths, "first_sample": 0, "identify": True, "threads": 1}),
        "compensations": (_done(measured.compensations), {"truths": truths, "first_sample": 0, "method": "identified", "grid": [[0.0, 1.0]] * 3, "rotary_deg": [0.0, 0.0], "threads": 1}),
        "catalogue": (core.catalogue, {"machine": MACHINE, "kind": "cross", "dimensions": [100.0, 25.0, 25.0]}),
        "Artefact": (core.Artefact, {"kind": "cross", "dimensions": [100.0, 25.0, 25.0], **PLACE}),
        "linear_fit": (core.linear_fit, {"columns": np.eye(4)[:, :3], "values": np.ones(4), "hold": [False] * 3, "tolerance": 1e-9, "basis": True}),
    }  # fmt: skip


def _machine() -> Calls:
    machine = core.Machine(CHAIN, 150.0, ERRORS)
    tool = np.array([[1.0, 2, 3, 0, 0.6, 0.8]])
    model: dict[str, Any] = {
        "machine": MACHINE,
        "errors": ERRORS,
        "placement": [0.0] * 6,
        "effects": [("a_twist", [1.0])],
        "direction": [0.0, 0, 0],
        "sense": [0.0, 0.0],
    }
    one = core.MachineModel(**model)
    rotary = np.array([[30.0, 40.0]])
    points = np.array([[1.0, 2.0, 3.0]])
    field = np.zeros((2, 12))
    grid = [[0.0, 1.0]] * 3
    return {
        "Machine": (core.Machine, {"chain": CHAIN, "tool_length_mm": 150.0, "errors": ERRORS, "directions": [("A", [1.0, 0.1, 0.0])], "points_mm": [("A", [1.0, 2.0, -30.0])], "table_normal": [0.0, 0.0, 1.0]}),
        "forward": (machine.forward, {"axes": np.ones((2, 5))}),
        "jacobian": (machine.jacobian, {"axes": np.ones((2, 5))}),
        "inverse": (machine.inverse, {"tools": tool, "reference_deg": np.zeros(2)}),
        "inverse_exact": (machine.inverse_exact, {"tools": tool, "starts": np.zeros((1, 5))}),
        "linear_axes_for": (machine.linear_axes_for, {"points": points, "rotary_deg": rotary}),
        "table_pose": (machine.table_pose, {"rotary_deg": rotary}),
        "MachineModel": (core.MachineModel, model),
        "fields": (one.fields, {"control": one, "zeros_arcsec": [0.0, 0.0], "rotary_deg": rotary}),
        "truth_rates": (one.truth_rates, {"control": one, "zeros_arcsec": [0.0, 0.0], "rotary_deg": rotary}),
        "control_rates": (one.control_rates, {"control": one, "zeros_arcsec": [0.0, 0.0], "rotary_deg": rotary}),
        "linear_commands": (one.linear_commands, {"points_mm": points, "rotary_deg": rotary, "threads": 1}),
        "commands": (one.commands, {"points_mm": points, "rotary_deg": rotary, "largest_turn_deg": 1.0, "threads": 1}),
        "reached": (one.reached, {"axes_mm_deg": np.ones((2, 5)), "threads": 1}),
        "field_statistics": (core.field_statistics, {"fields": field, "grid": grid}),
        "field_at": (core.field_at, {"field": field[0], "points_mm": points, "threads": 1}),
        "field_on_grid": (core.field_on_grid, {"field": field[0], "grid": grid, "threads": 1}),
    }  # fmt: skip


def _contouring() -> Calls:
    path = short()
    axes = np.tile(AXIS, (5, 1))
    loop = {"period_s": 1e-3, "axes": axes, "feedback": "load"}
    machines = {"assumed": MACHINE, "real": MACHINE}
    feed = (1000.0, 0.1, True, 500.0, 0.1)
    coupling = ("circle", "tangent", np.ones((5, 3)), "jacobian_last")
    raw = {name: getattr(path, name) for name in ("breaks", "omega", "cosine", "sine")}
    return {
        "ContourPath": (core.ContourPath, {**raw, "coefficients": path.coefficients.reshape(-1, 6)}),
        "frames": (path.core.frames, {"u": np.zeros(2)}),
        "at_length": (path.core.at_length, {"s_mm": np.zeros(2)}),
        "contour_simulate": (core.contour_simulate, {"path": path.core, "feed": feed, **loop, "coupling": coupling, **machines}),
        "contour_sweep": (core.contour_sweep, {"paths": [path.core], "path_index": [0], "feeds": [feed], **loop, "couplings": [coupling], "coupling_index": [0], **machines}),
        "contour_axis_margins": (core.contour_axis_margins, {"axes": axes, "gains_of_coupling": np.ones((5, 3)), "period_s": 1e-3}),
        "contour_path_margins": (core.contour_path_margins, {"path": path.core, "u": np.zeros(1), "axes": contouring.Servo.paper().rows(), "gains": GAINS, "period_s": 1e-3, "assumed": MACHINE}),
        "contour_axis_response": (core.contour_axis_response, {"letter": "X", "axis": AXIS, "period_s": 1e-3, "feedback": "motor", "command": np.linspace(0, 1, 20)}),
        "contour_axis_responses": (core.contour_axis_responses, {"letter": "A", "axes": axes, "period_s": 1e-3, "feedback": "motor", "command": np.linspace(0, 1, 20), "stride": 2}),
    }  # fmt: skip


def _turning() -> Calls:
    program = finishing().program
    follow = {
        "follows": "contour",
        "nose_mm": 0.0,
        "position": [0.0] * 6,
        "feed": 100.0,
        "machine_codes": [("G", 4503.0)],
    }
    profile = core.TurnedProfile.from_vertices(
        [
            (100.0, 20.0, "sharp", 0.0),
            (50.0, 20.0, "fillet", 1.0),
            (50.0, 30.0, "sharp", 0.0),
            (0.0, 30.0, "sharp", 0.0),
        ]
    )
    probe: dict[str, Any] = {
        "ball_radius_mm": 1.5,
        "contact_angle_deg": 89.0,
        "body_diameter_mm": 4.9,
        "allowance_mm": 0.5,
        "skip": [],
        "retract_x_mm": 60.0,
        "approach_mm": 1.0,
        "chuck_radius_mm": 0.0,
        "chuck_face_mm": 0.0,
        "shortest_mm": 1.0,
    }
    path = profile.probe_path(**probe)
    write = {
        "dialect": "linuxcnc-lathe",
        "feed": 100.0,
        "first_number": 10,
        "head": [[("G", 7.0)]],
        "tail": [[("M", 30.0)]],
    }
    z = np.arange(5.0, 45.0, 1.0)
    correct = {
        "program": program,
        "z_mm": z,
        "error_um": 12 * np.sin(z / 9),
        "unit_um": 1.0,
        "window": 5,
        "rule": "bounded",
        "bound_um": 1.0,
        "look_ahead": True,
        **follow,
        "keep_numbers": False,
    }
    return {
        "parse": (core.Program.parse, {"text": "G1 X1 F2\n", "dialect": "linuxcnc"}),
        "from_blocks": (core.Program.from_blocks, {"dialect": "linuxcnc", "blocks": [[("G", 1.0), ("X", 2.0)], "text"]}),
        "words": (program.words, {"block": 1}),
        "path": (program.path, {"blocks": (0, 2), "start": [0.0] * 6, "feed": 100.0, "machine_codes": []}),
        "from_vertices": (core.TurnedProfile.from_vertices, {"vertices": [(100.0, 20.0, "sharp", 0.0), (0.0, 30.0, "sharp", 0.0)]}),
        "from_program": (core.TurnedProfile.from_program, {"program": program, **follow}),
        "from_elements": (core.TurnedProfile.from_elements, {"elements": profile.elements(), "reliefs": [(1.0, 2.0, 3.0)]}),
        "profile path": (profile.path, {"follows": "tip", "nose_mm": 0.4, "convex": "roll"}),
        "radius_at": (profile.radius_at, {"z_mm": 20.0}),
        "finishing": (profile.finishing, {"follows": "contour", "nose_mm": 0.0, "convex": "roll", "first_element": 0, "start_z_mm": 101.0, "retract_x_mm": 40.0, "approach_mm": 1.0, "steepest_fall": 1.0, "access_z_mm": [], **write}),
        "probe_path": (profile.probe_path, probe),
        "contact_z": (path.contact_z, {"interval": 0, "z_mm": np.array([70.0]), "ball_radius_mm": 1.5}),
        "program": (path.program, {**write, "comments": ["text"], "retract_last": True}),
        "turning_correct": (core.turning_correct, correct),
        "turning_change": (core.turning_change, {"before": program, "after": program, "z_mm": z, **follow}),
        "turning_cause": (core.turning_cause, {"cause": "bending", "cuts": np.ones((3, 6)), "overhang_mm": 100.0, "parameters": [1.0]}),
    }  # fmt: skip


def _hybrid() -> Calls:
    one = core.Hybrid(core.hybrid_example(), list(CENTRE), [("e5_um", 3.0)], [1000.0] * 4)
    joints = np.array([POSE])
    names = ["e4_um", "e5_um"]
    return {
        "hybrid_parameter": (core.hybrid_parameter, {"name": "e5"}),
        "Hybrid": (core.Hybrid, {"dimensions": core.hybrid_example(), "home_mm": list(CENTRE), "errors": [("e5_um", 3.0)], "closure_mm": [1000.0] * 4}),
        "hybrid forward": (one.forward, {"joints": joints, "threads": 1}),
        "sensitivity": (one.sensitivity, {"joints": joints, "names": names, "threads": 1}),
        "strain": (one.strain, {"joints": joints, "names": names, "threads": 1}),
        "ballbar": (one.ballbar, {"joints": joints, "centres": np.array([CENTRE]), "names": names, "threads": 1}),
        "hybrid inverse": (one.inverse, {"tips": np.array([CENTRE]), "directions": np.array([[0.0, 0, -1]]), "reference_deg": 0.0, "negative": False, "exact": True, "threads": 1}),
        "constraint": (one.constraint, {"joints": list(POSE)}),
    }  # fmt: skip


@cache
def core_calls() -> Calls:
    """Good calls by name: the function and its arguments."""
    return {**_touches(), **_machine(), **_contouring(), **_turning(), **_hybrid()}

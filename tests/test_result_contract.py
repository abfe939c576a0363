"""Every public result and every data table is held to the contract of results.

A new class of results is found through the public names and through the subclasses of `Result`: it
fails here until it has an example below.
"""

import importlib
import inspect
import pkgutil
from functools import cache
from types import ModuleType

import numpy as np
import pytest

import trunnion as tn
from result_contract import check_result
from result_examples import EXAMPLES, diagnosis_of, with_outliers
from trunnion.base.report import Result
from trunnion.files.table import Table
from trunnion.models.kinds import kinds

NOT_RESULTS = {
    # what is described, not what comes out
    *("Setup", "Machine", "AxisSetup", "Artefact", "Probe", "Resolution", "TableSetup"),
    *(
        "PlanSetup",
        "ControlSetup",
        "ReportSetup",
        "ProbingProgram",
        "EffectInfo",
        "UserEffect",
        "FormulaEffect",
        "AxisLogModel",
        "BallbarModel",
    ),
    *("compensation.Compensation", "InverseCompensation", "ModelCompensation"),
    *("compensation.MachineErrors", "compensation.MotionPose", "compensation.AxisCommands"),
    *("contouring.Coupling", "contouring.Feed", "contouring.LinearAxis", "contouring.Path"),
    *("contouring.RotaryAxis", "contouring.Servo", "hybrid.Mechanism", "nc.Moves", "nc.Program"),
    *("turning.Corner", "turning.Gauge"),
    *("turning.Profile", "turning.TurningProbe"),
    *("studies.Block", "studies.FunctionStudy", "studies.Output", "studies.Parameter"),
    *("studies.RayExecutor", "studies.Seeds", "studies.Study"),
}


@cache
def public_classes() -> dict[str, type]:
    """Public classes that are no exceptions, by name; each under its first name only."""
    found: dict[str, type] = {}
    rooms: list[tuple[str, ModuleType]] = [("", tn)]
    rooms += [
        (f"{name}.", importlib.import_module(f"trunnion.{name}"))
        for name in ("compensation", "contouring", "hybrid", "nc", "studies", "turning")
    ]
    for prefix, room in rooms:
        for name in sorted(getattr(room, "__all__", dir(room))):
            thing = getattr(room, name)
            if not inspect.isclass(thing) or issubclass(thing, Exception):
                continue
            if not thing.__module__.startswith("trunnion") or thing in found.values():
                continue
            found[prefix + name] = thing
    return found


def every_result_class() -> set[type]:
    """Subclasses of `Result` anywhere in the package, imported one and all."""
    for module in pkgutil.walk_packages(tn.__path__, "trunnion."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    found, left = set(), [Result]
    while left:
        for kind in left.pop().__subclasses__():
            left.append(kind)
            if kind.__module__.startswith("trunnion"):
                found.add(kind)
    return found


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_result_can_do_what_every_result_can(name: str) -> None:
    check_result(EXAMPLES[name]())


def test_every_result_has_an_example() -> None:
    shown = {type(example()) for example in EXAMPLES.values()}
    lacking = {kind.__name__ for kind in every_result_class()} - {kind.__name__ for kind in shown}
    assert not lacking, f"without an example in EXAMPLES: {', '.join(sorted(lacking))}"


def test_every_public_class_is_a_result_or_stated_not_to_be_one() -> None:
    classes = public_classes()
    results = {name for name, kind in classes.items() if issubclass(kind, Result | Table)}
    unknown = set(classes) - results - NOT_RESULTS
    assert not unknown, f"neither a Result nor in NOT_RESULTS: {', '.join(sorted(unknown))}"
    gone = NOT_RESULTS - set(classes)
    assert not gone, f"no longer public: {', '.join(sorted(gone))}"


def test_the_examples_are_not_all_alike() -> None:
    assert {diagnosis_of(kind.name).verdict for kind in kinds()} >= {"explained", "ambiguous"}
    assert with_outliers().outliers == (57, 140)
    residuals = with_outliers().residuals
    assert residuals is not None
    assert not residuals.kept[[57, 140]].any()
    assert np.all(np.isfinite(residuals.after))

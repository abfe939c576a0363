"""An example of every result and of every data table."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

import trunnion as tn
from trunnion import compensation, contouring, hybrid, turning
from trunnion.controls import correct_program, linuxcnc_files
from trunnion.diagnosis.result import Diagnosis
from trunnion.machine.linear_axes import FieldMotion, Travel
from trunnion.models.kinds import Kind, kinds
from trunnion.setup.control import ControlSetup

SAMPLES = {
    "touches": ("cross/touches.csv", "cross/setup.toml"),
    "points": ("plate/first.csv", None),
    "sweep": ("axis/sweep.csv", None),
    "diameters": ("turning/diameters.csv", "turning/setup.toml"),
    "ballbar": ("ballbar/circle.csv", None),
    "positioning": ("positioning/axis.csv", None),
    "levels": ("levels/bed.csv", None),
    "rotarytest": ("rotary/rtest.csv", "rotary/setup.toml"),
    "axislog": ("contour/axislog.csv", "contour/setup.toml"),
}


def data_of(kind: Kind) -> Any:
    return kind.read(tn.sample_path(SAMPLES[kind.name][0]))


@cache
def diagnosis_of(name: str) -> Diagnosis:
    kind = next(kind for kind in kinds() if kind.name == name)
    data, setup = data_of(kind), SAMPLES[name][1]
    if name == "axislog":
        data = data[:: max(1, len(data) // 400)]
    return tn.diagnose(data, tn.read_setup(tn.sample_path(setup)) if setup else None)


@cache
def cross() -> tuple[tn.Touches, tn.Setup]:
    """Touches of a cross, and their set-up."""
    folder = tn.sample_path("cross")
    return tn.read_touches(folder / "touches.csv"), tn.read_setup(folder / "setup.toml")


def model_of(name: str) -> Any:
    return diagnosis_of(name).model


def field_motion() -> FieldMotion:
    places = np.array([[-1.0, -1.0], [0.0, 1.0], [1.0, 0.0], [0.5, 0.5]])
    travel = Travel((50.0, 50.0), (100.0, 100.0))
    return FieldMotion(places, np.array([[1.0], [2.0], [0.5], [-1.0]]), 0.1, 2.0, travel)


def clock_offset() -> Any:
    time = np.arange(0.0, 20.0, 0.05)
    signal = np.sin(time) + 0.3 * np.sin(2.7 * time)
    return tn.align_clocks(time, signal, time + 0.2, signal)


def turning_table() -> tn.Iso2302Rotary:
    turned = np.tile(np.arange(0.0, 360.0, 60.0), 4)
    data = tn.Positioning(
        target_deg=turned,
        measured_deg=turned + 1e-4 * np.sin(7.0 * np.arange(24)),
        direction=np.tile(np.repeat([1, -1], 6), 2),
        cycle=np.repeat([1, 2], 12),
    )
    results: tn.Iso2302Rotary = data.iso230_2()
    return results


@cache
def with_outliers() -> Diagnosis:
    """Ambiguous, with rows that were left out."""
    return tn.diagnose(
        tn.read_touches(tn.sample_path("hidden/touches.csv")),
        tn.read_setup(tn.sample_path("hidden/setup.toml")),
    )


@cache
def with_structure() -> Diagnosis:
    """A wave along Y that no known cause makes."""
    setup = cross()[1]
    plan = tn.plan(setup, a_deg=(-60, -30, 0, 30, 60, 90), all_faces=True)
    touches = tn.simulate(plan, setup, noise_um=0.3, seed=1)
    wave = 5e-3 * np.cos(2 * np.pi * np.asarray(touches.y_mm) / 31.0)
    return tn.diagnose(touches.with_columns(x_mm=touches.x_mm + wave), setup)


@cache
def together() -> Diagnosis:
    """Two measurements of one machine."""
    return tn.diagnose([turned_axis(4.0), turned_axis(4.0, seed=2)])


@cache
def batch() -> tn.DiagnosisBatch:
    """Two measurements, one of which is not there."""
    return tn.diagnose_many([turned_axis(4.0), "no-such-file.csv"], workers=1)


def turned_axis(backlash_um: float, seed: int = 1) -> tn.Positioning:
    """Stops of the X axis with a backlash."""
    rng = np.random.default_rng(seed)
    target = np.tile(np.concatenate([np.arange(6.0), np.arange(6.0)[::-1]]) * 50.0, 3)
    sense = np.tile(np.repeat([1, -1], 6), 3)
    error = -0.5 * backlash_um * sense + rng.normal(0, 0.3, 36)
    return tn.Positioning(
        target_mm=target,
        measured_mm=target + 1e-3 * error,
        direction=sense,
        cycle=np.repeat([1, 2, 3], 12),
        axis=["X"] * 36,
    )


POSE = [1100.0, 1130.0, 1110.0, 20.0, 5.0]
CENTRE = (0.0, -350.0, -1400.0)


def ballbar() -> hybrid.BallbarIdentification:
    machine = hybrid.Mechanism()
    plan = hybrid.ballbar_plan(machine, CENTRE, step_deg=15.0)
    return hybrid.identify_ballbar(plan, machine, sigma_um=0.5)


def r_test() -> tuple[tn.RotaryTest, tn.Setup, tuple[float, float, float]]:
    """Readings of an R-test on a machine with an error, its set-up and the place of the ball."""
    setup, ball = tn.Setup(artefact=tn.Artefact("none")), (90.0, 20.0, 60.0)
    turns = {"A": np.repeat([0.0, 60.0, -60.0], 4), "C": np.tile([0.0, 90.0, 180.0, 270.0], 3)}
    plan = tn.plan_rotary_test(setup, ball, turns)
    return (
        tn.simulate_rotary_test(plan, setup, ball, {"EX0C": 9.0}, noise_um=0.5, seed=1),
        setup,
        ball,
    )


def identifiability() -> hybrid.Identifiability:
    machine = hybrid.Mechanism()
    return hybrid.identifiability(hybrid.ballbar_plan(machine, CENTRE, step_deg=15.0), machine)


def short() -> contouring.Path:
    return contouring.Path.circle(5.0, turn_deg=20.0, tilt_deg=10.0)


def comparison() -> contouring.ContourComparison:
    return contouring.compare(path=short(), feeds_mm_min=(1000.0, 2000.0))


def profile() -> turning.Profile:
    return turning.Profile.from_points([(100, 20), (50, 20), (50, 30), (0, 30)])


def finishing() -> turning.Finishing:
    return profile().finishing("linuxcnc-lathe", head=[[("G", 7)]], feed=100)


def correction() -> turning.Correction:
    z = np.arange(5.0, 45.0, 1.0)
    return turning.correct(finishing().program, (z, 12.0 * np.sin(z / 9.0)), unit_um=1.0)


def groove() -> turning.Finishing:
    points = [(100, 20), (60, 20), (60, 15), (40, 15), (40, 20), (0, 20)]
    part = turning.Profile.from_points(points)
    return part.finishing("linuxcnc-lathe", access_z_mm=[50.0], feed=100)


def two_axes() -> tn.MachineComparison:
    first = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    worn = first.measured + 2e-3 * first.direction
    return tn.compare(diagnosis_of("positioning"), first.with_columns(measured_mm=worn))


def two_instruments() -> tn.InstrumentComparison:
    data = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    encoder = data.measured - 3e-3 * data.direction + 1e-4 * np.sin(7.0 * np.arange(len(data)))
    return tn.whose_error(data.with_columns(encoder_mm=encoder))


def three_beds() -> tn.MachineComparison:
    bed = tn.read_levels(tn.sample_path("levels/bed.csv")).straightness()
    return tn.compare(bed, bed, bed, dates=["2026-01-01", "2026-02-01", "2026-03-01"])


LOCATION_ERRORS = {"EX0C": 15.0, "EA0A": 20.0}


def cross_setup() -> tn.Setup:
    return cross()[1]


def methods() -> tn.Comparison:
    """Estimates of two methods on the touches of a cross, and one that was refused."""
    results = {"closed form": tn.closed_form(*cross()), "least squares": tn.identify(*cross())}
    times = {"closed form": 0.1, "least squares": 1.0}
    return tn.Comparison(results, times, {"another": "not installed"}, LOCATION_ERRORS)


def volumetric(**options: Any) -> tn.VolumetricError:
    return tn.volumetric_error(cross_setup(), LOCATION_ERRORS, points=(4, 3, 2), **options)


def control_files() -> Any:
    centre = ControlSetup(centre_mm=(1.0, 2.0, 3.0))
    setup = tn.Setup(artefact=tn.Artefact("none"), control=centre)
    return linuxcnc_files(setup, LOCATION_ERRORS)


def ball_verification() -> Any:
    setup = tn.Setup(tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(30.0, 20.0, 60.0)))
    plan = tn.plan(setup, c_deg=(0, 120, 240), a_deg=(40, -40))
    before = tn.simulate(plan, setup, errors=LOCATION_ERRORS, noise_um=0.3, seed=1)
    fit = tn.identify(*cross())
    after = tn.simulate(plan, setup, noise_um=0.3, seed=2)
    return tn.verify_ball(after, setup, before=before, estimate=fit, draws=200)


def control() -> tn.CncParameters:
    return tn.cnc_parameters(cross_setup(), LOCATION_ERRORS)


def compensation_forecast() -> Any:
    from trunnion.compensation import compensation_forecast

    return compensation_forecast(cross_setup(), tn.identify(*cross()))


def error_map() -> tn.ErrorMap:
    return tn.error_map(cross_setup(), LOCATION_ERRORS, linear_step_mm=300.0, rotary_step_deg=90.0)


def pose_field() -> compensation.PoseField:
    return next(tn.error_fields(cross_setup(), LOCATION_ERRORS, points=(4, 3, 2)))


def crossing() -> turning.Crossing:
    return turning.Crossing((12.0, 9.0), 5.0)


EXAMPLES: dict[str, Callable[[], Any]] = {
    **{f"data {kind.name}": partial(data_of, kind) for kind in kinds()},
    **{f"diagnosis {kind.name}": partial(diagnosis_of, kind.name) for kind in kinds()},
    "diagnosis with outliers": with_outliers,
    "diagnosis of several": together,
    "DiagnosisBatch": batch,
    "FailedDiagnosis": lambda: batch()[1],
    "model of several": lambda: together().model,
    **{f"model {kind.name}": partial(model_of, kind.name) for kind in kinds()},
    "Recognised": lambda: tn.read(tn.sample_path("plate/first.csv"), units="inch").recognised,
    "FieldMotion": field_motion,
    "IdentificationResult": lambda: tn.identify(*cross()),
    "ClosedFormResult": lambda: tn.closed_form(*cross(), method="printed"),
    "PerPosition": lambda: tn.closed_form(*cross(), method="printed").per_position,
    "Observability": lambda: tn.observability(*cross()),
    "Estimate": lambda: tn.Estimate(errors={"EX0C": 15.0}, std_errors={"EX0C": 0.2}),
    "Forward": lambda: hybrid.Mechanism().forward([POSE, POSE]),
    "Sensitivity": lambda: hybrid.Mechanism().sensitivity(POSE),
    "Constraint": lambda: hybrid.Mechanism().constraint(POSE),
    "ClosureDependence": lambda: hybrid.Mechanism().closure_dependence(POSE, {"base3_c": 10.0}),
    "Identifiability": identifiability,
    "RotaryTest": lambda: r_test()[0],
    "RotaryTestIdentification": lambda: tn.identify_rotary_test(*r_test()),
    "BallbarIdentification": ballbar,
    "CubeStudy": lambda: hybrid.cube_study(hybrid.Mechanism(), ["e4", "e5"]),
    "CubeChange": lambda: hybrid.transformed_cube(hybrid.Mechanism(), "e4"),
    "ContourRun": lambda: contouring.simulate(short(), 1000.0),
    "ContourSweep": lambda: contouring.sweep([short()], [500.0, 1000.0]),
    "Margins": lambda: contouring.margins(path=short()),
    "ContourComparison": comparison,
    "Correction": correction,
    "Finishing": groove,
    "ProbePath": lambda: turning.probe_path(profile(), chuck_radius_mm=0.0),
    "Interval": lambda: turning.probe_path(profile(), chuck_radius_mm=0.0).intervals[0],
    "Crossing": crossing,
    "Cause": lambda: with_outliers().causes[0],
    "Alternative": lambda: with_outliers().evidence[1],
    "Contribution": lambda: with_outliers().contributions[0],
    "Ladder": lambda: with_outliers().ladder,
    "Gain": lambda: with_outliers().gain,
    "Circle": lambda: tn.fit_circles(tn.read_sweep(tn.sample_path("axis/sweep.csv")))[1],
    "NextMeasurement": lambda: tn.next_measurement(with_outliers())[0],
    "NextPass": lambda: tn.next_passes(diagnosis_of("diameters"))[0],
    "ExpectedDiscrimination": lambda: tn.expected_discrimination(diagnosis_of("touches"), 4),
    "RepeatablePart": lambda: tn.repeatable_part(
        diagnosis_of("points"), tn.read_points(tn.sample_path("plate/second.csv"))
    ),
    "Iso2302": lambda: data_of(next(k for k in kinds() if k.name == "positioning")).iso230_2(),
    "InstrumentComparison": two_instruments,
    "Iso2302Rotary": turning_table,
    "ClockOffset": clock_offset,
    "Dataset": lambda: tn.datasets.about("mill"),
    "Iso2304": lambda: tn.iso230_4(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))[0],
    "CompensationTable": lambda: turning_table().compensation_table(zero_at=60.0),
    "Conformity": lambda: turning_table().conformity(accuracy_arcsec=20.0, reversal_arcsec=0.5),
    "Straightness": lambda: tn.read_levels(tn.sample_path("levels/bed.csv")).straightness(),
    "Twist": lambda: tn.read_levels(tn.sample_path("levels/bed.csv")).twist(),
    "Flatness": lambda: tn.read_levels(tn.sample_path("levels/plate.csv")).flatness(),
    "MachineComparison": two_axes,
    "MachineComparison over time": three_beds,
    "Residuals": lambda: with_outliers().residuals,
    "Comparison": methods,
    "VolumetricError": volumetric,
    "VolumetricError sampled": partial(volumetric, a_deg=(0, 30), rounded=True),
    "PoseField": pose_field,
    "ErrorMap": error_map,
    "CncParameters": control,
    "CompensationForecast": compensation_forecast,
    "Removable": lambda: control().removable[0],
    "ControlFiles": control_files,
    "CorrectedProgram": lambda: correct_program(
        cross_setup(), LOCATION_ERRORS, "G0 X0 Y0 Z9\nG1 X50 F100\nM2\n"
    ),
    "Setting": lambda: control_files().settings[0],
    "PrintedZeros": lambda: tn.printed_zeros(LOCATION_ERRORS),
    "diagnosis with structure": with_structure,
    "Structure": lambda: with_structure().structure,
    "Budget": lambda: tn.identify(*cross()).budget(tolerances={"EX0C": 20.0}),
    "Budget by draws": lambda: with_outliers().budget(method="monte-carlo", draws=200),
    "BallVerification": ball_verification,
    "ResidualInterval": lambda: tn.residual_interval(cross_setup(), tn.identify(*cross())),
}

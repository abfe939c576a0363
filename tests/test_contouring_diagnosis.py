"""Diagnosis of axis logs made by an independent twin: blind cases, aliases, bad input.

The full power table is made by ``tests/power/axis_logs.py``.
"""

import pickle
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.signal import lfilter

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion._core import contour_axis_response
from trunnion.base.errors import DataError, FileFormatError, InputError, UnknownNameError
from trunnion.diagnosis.autoregression import (
    Autoregression,
    levinson,
    partial_autocorrelations,
)
from trunnion.diagnosis.noise import fit_noise
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.axis_log import AxisLogModel, effects, servo_effects
from trunnion.models.examples import axis_log
from trunnion.models.kinds import diagnose
from trunnion.samples.truth import HIDDEN_BACKLASH_UM
from trunnion.setup import Artefact, AxisSetup, Machine, Probe, Setup
from twin import forward

SERVO = ct.Servo.paper()
SETUP = Setup(artefact=Artefact("none"), servo=SERVO.to_table())
BLIND_CASES = 9
SEED = 20
TIPS = ("tip_x_mm", "tip_y_mm", "tip_z_mm")
OFFSETS = {"trt-ca": ("Y0A", "Z0A"), "trt-bc": ("X0B", "Z0B"), "table-c-head-b": ("X0B", "Z0B")}


@cache
def commands() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return twin.commanded(1000 / 60), twin.commanded(3000 / 60)


@cache
def blind() -> tuple[list[str | None], list[tn.AxisLog]]:
    rng = np.random.default_rng(SEED)
    cases, truth = twin.draw(BLIND_CASES, rng)
    actual = [twin.actual(c, cases) for c in commands()]
    logs = [twin.log(commands(), [a[i] for a in actual], rng) for i in range(BLIND_CASES)]
    return truth, logs


def hits(d: Diagnosis, truth: str | None) -> bool:
    if truth is None:
        return d.verdict == "consistent"
    return any(truth == c.id or truth in c.aliases for c in d.causes)


@pytest.mark.parametrize("case", range(BLIND_CASES))
def test_blind_case_is_named(case: int) -> None:
    truth, logs = blind()
    assert hits(diagnose(logs[case], SETUP), truth[case])


def test_sizes_are_found_and_a_held_out_feed_gains() -> None:
    cases = twin.Cases(1)
    cases.gain[0, 1] *= 1.02
    rng = np.random.default_rng(3)
    log = twin.log(commands(), [twin.actual(c, cases)[0] for c in commands()], rng)
    d = diagnose(log, SETUP)
    assert [c.id for c in d.causes] == ["gain_y"]
    found, error = d.causes[0].parameters, d.causes[0].std_errors
    assert found["gain_percent"] == pytest.approx(2.0, abs=5 * error["gain_percent"])
    assert d.gain.heldout_rms_after_um < 0.5 * d.gain.heldout_rms_before_um
    servo = d.model.servo
    assert servo.axes["Y"].gain_per_s == pytest.approx(80.544 * 1.02, rel=1e-4)


@pytest.mark.parametrize(("axis", "hz", "damping"), [("A", 26.0, 0.05), ("Z", 58.0, 0.09)])
def test_a_resonance_is_no_sum_of_servo_effects(axis: str, hz: float, damping: float) -> None:
    """A strong one is far from the set-up's servo; of a high one share and frequency look alike."""
    cases = twin.Cases(1)
    column = "XYZAC".index(axis)
    cases.frequency[0, column], cases.damping[0, column] = hz, damping
    rng = np.random.default_rng(3)
    log = twin.log(commands(), [twin.actual(c, cases)[0] for c in commands()], rng)
    d = diagnose(log, SETUP)
    assert d.verdict == "explained"
    assert d.named == {f"resonance_{axis.lower()}"}
    assert d.causes[0].p_value < 1e-6


def test_rotary_centre_shows_in_the_tool_tip_only() -> None:
    errors = {"EX0C": 12.0, "EZ0A": -8.0}
    run = ct.simulate(ct.Path.paper(offset_mm=(0, 0, 20)), 3000.0, controller="independent")
    log = run.axis_log(noise_um=0.2, noise_arcsec=1.0, seed=4)
    assert diagnose(log, SETUP).verdict == "consistent"
    real = ct.simulate(
        ct.Path.paper(offset_mm=(0, 0, 20)), 3000.0, controller="independent", errors=errors
    )
    noise = 2e-4 * np.random.default_rng(5).standard_normal(real.tip_mm.shape)
    tip = dict(zip(("tip_x_mm", "tip_y_mm", "tip_z_mm"), (real.tip_mm + noise).T, strict=True))
    d = diagnose(log.with_columns(**tip), SETUP)
    assert [c.id for c in d.causes] == ["rotary_centre"]
    for name, value in errors.items():
        assert d.causes[0].parameters[f"{name}_um"] == pytest.approx(value, abs=0.1)


def tip_of_twin(
    preset: str, length_mm: float, errors: Mapping[str, float], axes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Tool tip in the table's frame, (n, 3), for X, Y, Z (mm) and tilt, C (deg): the twin's."""
    tilt, c = np.deg2rad(axes[:, 3:].T)
    still = forward.Motion()
    setup = forward.Setup(preset=preset, probe_length_mm=length_mm)
    table = np.matmul(*forward.joint_poses(tilt, c, setup, errors, still, still))
    tip = axes[:, :3] + forward.head_displacement(tilt, setup, errors)
    if preset == "table-c-head-b":  # nominal: the tip swings about the pivot
        tip = tip + length_mm * np.stack([-np.sin(tilt), 0 * tilt, 1 - np.cos(tilt)], axis=1)
    return np.asarray(np.einsum("nji,nj->ni", table[:, :3, :3], tip - table[:, :3, 3]))


@pytest.mark.parametrize(
    ("preset", "against", "hidden"),
    [
        ("trt-ca", "A", {"EX0C": 12.0, "EZ0A": -8.0}),
        ("trt-ca", "C", {"EX0C": 12.0, "EZ0A": -8.0}),
        ("trt-ca", "XAC", {"EX0C": 12.0, "EY0A": 5.0}),
        ("trt-bc", "", {"EX0C": 12.0, "EZ0B": -8.0}),
        ("trt-bc", "B", {"EX0B": 12.0, "EY0C": 5.0}),
        ("table-c-head-b", "", {"EX0C": 12.0, "EZ0B": -8.0}),
        ("table-c-head-b", "B", {"EX0B": 12.0, "EY0C": 5.0}),
    ],
)
def test_a_tool_tip_is_that_of_the_machine_of_the_set_up(
    preset: str, against: str, hidden: dict[str, float]
) -> None:
    tilt = "A" if preset == "trt-ca" else "B"
    run = ct.simulate(ct.Path.paper(offset_mm=(0, 0, 20)), 3000.0, controller="independent")
    made = run.axis_log(noise_um=0.2, noise_arcsec=1.0, seed=4)
    actual = np.stack([made.actual(letter) for letter in "xyzac"], axis=1)
    tip = tip_of_twin(preset, 260.0, hidden, actual)
    tip = tip + 2e-4 * np.random.default_rng(5).standard_normal(tip.shape)
    columns = {"time_s": made.time_s, **dict(zip(TIPS, tip.T, strict=True))}
    for letter, unit in zip("XYZAC", ("mm",) * 3 + ("deg",) * 2, strict=True):
        name = tilt if letter == "A" else letter
        sign = -1.0 if name in against else 1.0
        columns[f"{name.lower()}_cmd_{unit}"] = sign * made.commanded(letter.lower())
        columns[f"{name.lower()}_act_{unit}"] = sign * made.actual(letter.lower())
    servo = {tilt if key == "A" else key: value for key, value in SERVO.to_table().items()}
    setup = Setup(
        artefact=Artefact("none"),
        machine=Machine(preset),
        axes={letter: AxisSetup(-1) for letter in against},
        probe=Probe(length_mm=260.0),
        servo=servo,
    )
    d = diagnose(tn.AxisLog(**columns), setup)
    assert [c.id for c in d.causes] == ["rotary_centre"]
    found = dict(d.causes[0].parameters)
    assert found.keys() == {f"E{k}_um" for k in ("X0C", "Y0C", *OFFSETS[preset])}
    truth = {name: hidden.get(name.removesuffix("_um"), 0.0) for name in found}
    if preset == "table-c-head-b":  # a head and a table that are apart: their distance only
        assert np.isinf([d.causes[0].std_errors[f"E{k}_um"] for k in ("X0B", "X0C")]).all()
        apart = [v.pop("EX0C_um") - v.pop("EX0B_um") for v in (found, truth)]
        assert apart[0] == pytest.approx(apart[1], abs=0.1)
    assert found == pytest.approx(truth, abs=0.1)


def test_a_tool_tip_of_other_axes_than_the_machines_is_refused() -> None:
    log = ct.simulate(ct.Path.paper(), 3000.0, controller="independent").axis_log()
    log = log.with_columns(**dict.fromkeys(TIPS, log.actual("x")))
    setup = replace(SETUP, machine=Machine("trt-bc"))
    with pytest.raises(DataError, match=r"got axes X, Y, Z, A, C, .* X, Y, Z, B, C .*trt-bc"):
        AxisLogModel(log, setup)


def test_autocorrelated_noise_is_no_effect() -> None:
    rng = np.random.default_rng(6)
    alarms = 0
    plain = [twin.actual(c, twin.Cases(1))[0] for c in commands()]
    for _ in range(3):
        log = twin.log(commands(), plain, rng, memory=0.97)
        alarms += diagnose(log, SETUP).verdict != "consistent"
    # Of white noise 5 % may alarm; the memory of this noise has to be estimated.
    assert alarms <= 1


def test_a_users_own_effect_competes() -> None:
    class Thermal:
        id = "x_grows"
        parameters = ("rate_um_s",)

        def change(self, log: tn.AxisLog, values: Mapping[str, float]) -> NDArray[np.float64]:
            out = np.zeros((len(log), len(log.axes)))
            out[:, 0] = values["rate_um_s"] * log.time_s
            return out

    log = ct.simulate(ct.Path.paper(), 1000.0, controller="independent").axis_log(
        noise_um=0.2, noise_arcsec=1.0
    )
    drifted = log.with_columns(x_act_mm=log.actual("x") + 1e-3 * log.time_s)
    d = diagnose(drifted, SETUP, effects=(Thermal(),))
    assert [c.id for c in d.causes] == ["x_grows"]
    assert d.causes[0].parameters["rate_um_s"] == pytest.approx(1.0, abs=0.05)


def test_a_model_and_its_diagnosis_can_be_sent_to_another_process() -> None:
    setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    log = tn.read_axis_log(tn.sample_path("contour/axislog.csv"))
    model = AxisLogModel(log, setup)
    twin_model = pickle.loads(pickle.dumps(model))
    for effect, copied in zip(model.effects, twin_model.effects, strict=True):
        values = {p.name: p.grid[0] if p.grid else 0.5 for p in effect.parameters}
        np.testing.assert_array_equal(copied.change(values), effect.change(values))
    d = diagnose(log, setup)
    assert pickle.loads(pickle.dumps(d)).to_dict() == d.to_dict()


def test_what_was_found_is_in_the_servo_model_where_its_parameters_can_say_it() -> None:
    setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    log = tn.read_axis_log(tn.sample_path("contour/axislog.csv"))
    model = AxisLogModel(log, setup, block=1)
    before = ct.Servo.from_table(setup.servo)
    for name, values in {
        "gain_x": {"gain_percent": 2.0},
        "time_constant_y": {"time_constant_ms": 0.5},
        "loop_delay_z": {"delay_ms": 0.25},
        "backlash_a": {"backlash_arcsec": 4.0},
        "friction_x": {"coulomb_um": 2.0},
        "offset_y": {"offset_um": -3.0},
        "friction_direction_z": {"drag_percent": 1.0},
        "velocity_forward_x": {"forward_percent": 2.0},
        "acceleration_forward_y": {"forward_ms": 0.3},
        "cyclic_c": {"cosine_arcsec": 3.0, "sine_arcsec": -4.0, "pitch_deg": 7.0},
    }.items():
        servo = model.extended(model.start, {name: values}).servo
        changed = [letter for letter in before.axes if servo.axes[letter] != before.axes[letter]]
        assert changed == [name[-1].upper()]
        channel = model.axes.index(changed[0])
        moved = model_readings(log, setup, before, channel)
        moved = moved - model_readings(log, setup, servo, channel)
        change = np.asarray(model.effect(name).change(values)).reshape(-1, len(log))
        # Columns are chords at other values: they differ where a run starts.
        assert np.linalg.norm(change[channel] - moved) < 0.1 * np.linalg.norm(moved)


def test_an_effect_is_one_entry_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    screw = servo_effects.ServoEffect(
        "screw",
        "the screw of the {axis} axis has an error of its known pitch",
        "screw_{small}",
        ("cyclic_{small}",),
    )
    monkeypatch.setattr(effects, "AXIS_EFFECTS", (*effects.AXIS_EFFECTS, screw))
    pitch = {letter: "pitch_mm" if letter in "XYZ" else "pitch_deg" for letter in "XYZAC"}
    axes = {k: replace(SERVO.axes[k], **{name: 7.0}) for k, name in pitch.items()}  # type: ignore[arg-type]
    known = replace(SERVO, axes=axes)
    worn = replace(known, axes={**axes, "C": replace(axes["C"], cyclic_arcsec=9.0)})  # type: ignore[arg-type]
    run = ct.simulate(ct.Path.paper(), 3000.0, controller="independent", servo=worn)
    log = run.axis_log(noise_um=0.2, noise_arcsec=1.0, seed=9)
    d = diagnose(log, replace(SETUP, servo=known.to_table()))
    (cause,) = d.causes
    assert cause.id == "screw_c"
    assert cause.label == "the screw of the C axis has an error of its known pitch"
    found, error = cause.parameters["screw_arcsec"], cause.std_errors["screw_arcsec"]
    assert found == pytest.approx(9.0, abs=4 * error)
    assert d.model.servo.axes["C"].cyclic_arcsec == found


def model_readings(
    log: tn.AxisLog, setup: Setup, servo: ct.Servo, channel: int
) -> NDArray[np.float64]:
    """Readings of one axis under another servo model."""
    values = AxisLogModel(log, replace(setup, servo=servo.to_table()), block=1).readings.values
    return np.asarray(values.reshape(-1, len(log))[channel])


def test_bad_input() -> None:
    log = ct.simulate(ct.Path.paper(), 3000.0, controller="independent").axis_log()
    with pytest.raises(InputError, match=r"setup: missing, expected a set-up .*servo"):
        diagnose(log)
    with pytest.raises(InputError, match=r"\[servo\.X\]"):
        AxisLogModel(log, replace(SETUP, servo={}))
    with pytest.raises(DataError, match="even sampling"):
        AxisLogModel(log.with_columns(time_s=log.time_s**1.1), SETUP)
    with pytest.raises(DataError, match="at least 20"):
        AxisLogModel(log[:10], SETUP)
    with pytest.raises(UnknownNameError, match="gain_q"):
        AxisLogModel(log, SETUP, ("gain_q",))
    with pytest.raises(DataError, match="multiple of"):
        AxisLogModel(log, replace(SETUP, servo={**SETUP.servo, "period_ms": 0.7}))


def test_memory_of_the_noise_is_not_lost_with_what_effects_absorb() -> None:
    n, memory = 800, 0.8
    slow = np.cos(np.pi * (np.arange(n) + 0.5) * np.arange(1, 17)[:, None] / n).T
    q = np.linalg.qr(slow)[0]
    segments = [np.arange(n)]
    rng = np.random.default_rng(8)
    seen, plain, size = [], [], []
    for _ in range(20):
        start = rng.standard_normal(1) * memory / np.sqrt(1 - memory**2)
        y = lfilter([1.0], [1.0, -memory], rng.standard_normal(n), zi=start)[0]
        noise = fit_noise(y, q, segments)
        rest = y - q @ (q.T @ y)
        plain.append(float(rest[1:] @ rest[:-1] / (rest[:-1] @ rest[:-1])))
        seen.append(float(np.sum(noise.predictors[-1])))
        size.append(noise.sizes[-1])
    assert np.mean(plain) < 0.96 * memory
    # Taken 1 σ longer than it most likely is: (1 - 0.8²)^½ / 800^½ = 0.02.
    assert memory < np.mean(seen) < memory + 3 * 0.0212
    assert np.mean(size) == pytest.approx(1.0, abs=0.02)


def test_whitening_of_a_known_noise_is_exact() -> None:
    partial = np.array([0.7, -0.3, 0.2])
    predictors = levinson(partial)
    ar = predictors[-1]
    assert partial_autocorrelations(ar) == pytest.approx(partial, abs=1e-12)
    left = np.cumprod(1 / np.sqrt(1 - partial[::-1] ** 2))[::-1]
    noise = Autoregression(predictors, (*(2.0 * left).tolist(), 2.0))
    # Autocovariances of the process by its impulse response; W V Wᵀ is the unit matrix.
    response = lfilter([2.0], np.r_[1.0, -ar], np.r_[1.0, np.zeros(4000)])
    lagged = [float(response[: len(response) - k] @ response[k:]) for k in range(12)]
    white = noise.whiten(np.eye(12))
    assert white @ toeplitz(lagged) @ white.T == pytest.approx(np.eye(12), abs=1e-9)


def test_a_log_of_coupled_axes_has_the_commands_that_the_loops_got() -> None:
    runs = [ct.simulate(ct.Path.paper(), feed, controller="proposed") for feed in (1000.0, 3000.0)]
    followed = [
        contour_axis_response(
            letter, SERVO.row(letter), 1e-3, "motor", runs[1].commanded[:, i].copy()
        )
        for i, letter in enumerate("XYZAC")
    ]
    assert np.abs(np.stack(followed, axis=1) - runs[1].actual).max() < 1e-9
    assert np.abs(runs[1].commanded - runs[1].reference)[:, 0].max() > 0.001
    logs = [r.axis_log(noise_um=0.2, noise_arcsec=1.0, seed=i, run=i) for i, r in enumerate(runs)]
    assert diagnose(tn.AxisLog.concatenate(logs), SETUP).verdict == "consistent"


def test_a_log_sampled_slower_than_the_control_is_diagnosed() -> None:
    setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    log = tn.read_axis_log(tn.sample_path("contour/axislog.csv"))
    assert float(np.diff(log.time_s)[0]) == pytest.approx(0.004)
    d = diagnose(log, setup)
    assert [c.id for c in d.causes] == ["backlash_y"]
    cause = d.causes[0]
    assert cause.parameters["backlash_um"] == pytest.approx(
        HIDDEN_BACKLASH_UM, abs=4 * cause.std_errors["backlash_um"]
    )


def test_columns_that_cannot_be_an_axis_log_are_refused() -> None:
    log = ct.simulate(ct.Path.paper(), 3000.0, controller="independent").axis_log()
    swapped = log.with_columns(x_cmd_mm=log.actual("x"), x_act_mm=log.commanded("x"))
    with pytest.raises(DataError, match=r"x_act_mm: got positions 12\.\d ms ahead of x_cmd_mm"):
        AxisLogModel(swapped, SETUP)
    with pytest.raises(DataError, match=r"a_act_deg: got 0\.0175 times the motion"):
        AxisLogModel(log.with_columns(a_act_deg=np.deg2rad(log.actual("a"))), SETUP)
    slow = replace(SETUP, servo={k: v for k, v in SETUP.servo.items() if k != "period_ms"})
    with pytest.raises(DataError, match=r"samples every 1000 ms, expected at most 24\.6 ms"):
        AxisLogModel(log.with_columns(time_s=1e3 * log.time_s), slow)
    with pytest.raises(DataError, match=r"at most 100 times servo\.period_ms"):
        AxisLogModel(log, replace(SETUP, servo={**SETUP.servo, "period_ms": 1e-9}))
    wild = {**SETUP.servo, "Z": {"gain_per_s": 8118.4, "time_constant_ms": 5.5}}
    with pytest.raises(InputError, match=r"servo\.Z: .*stable"):
        AxisLogModel(log, replace(SETUP, servo=wild))
    run = ct.simulate(ct.Path.paper(), 3000.0, controller="independent")
    for name, value in (("noise_um", -1.0), ("noise_arcsec", np.nan), ("seed", -1)):
        with pytest.raises(InputError, match=name):
            run.axis_log(**{name: value})  # type: ignore[arg-type]


def test_a_servo_table_that_is_wrong_is_told_with_its_place(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    for text, message in (
        ('[artefact]\nkind = "cross"\n', r"s\.toml:1:1: servo: the table is missing"),
        ("[servo.X]\ngain = 80\n", r"s\.toml:2:1: servo\.X\.gain: unknown key"),
        ("[servo.X]\ngain_per_s = 80\n", r"s\.toml:1:1: servo\.X\.time_constant_ms: missing"),
        ("[servo.X]\ngain_per_s = inf\ntime_constant_ms=1\n", r"s\.toml:2:14: .*finite"),
        ("[servo]\nfeedback = 3\n", r"s\.toml:2:12: servo\.feedback: got 3"),
        ("[servo]\nperiod_ms = 0\n", r"s\.toml:2:13: servo\.period_ms: got 0"),
        ("[servo.W]\n", r"servo\.W: unknown key, expected one of period_ms, feedback, X"),
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(FileFormatError, match=message):
            ct.read_servo(file)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ("drift", "depends on time ("),
        ("jump", "depends on time (a jump at 1.0"),
    ],
)
def test_structure_without_a_name_is_not_taken_for_noise_with_a_memory(
    shape: str, message: str
) -> None:
    runs = [
        ct.simulate(ct.Path.paper(), feed, controller="independent").axis_log(
            noise_um=0.2, noise_arcsec=1.0, seed=30 + i, run=i
        )
        for i, feed in enumerate((1000.0, 3000.0))
    ]
    log = tn.AxisLog.concatenate(runs)
    t = np.concatenate([r.time_s for r in runs])
    added = {"drift": t / 2 - 1, "jump": np.where(t > 1, 1.0, 0.0)}
    d = diagnose(log.with_columns(x_act_mm=log.actual("x") + 2e-3 * added[shape]), SETUP)
    assert d.verdict == "unexplained"
    assert d.unexplained is not None
    assert message in d.unexplained


def test_a_tool_tip_that_is_no_tool_tip_is_refused() -> None:
    log = ct.simulate(ct.Path.paper(), 3000.0, controller="independent").axis_log()
    x = log.actual("x")
    with pytest.raises(InputError, match="tip_x_mm: got the column without tip_y_mm, tip_z_mm"):
        log.with_columns(tip_x_mm=x)
    gap = np.where(np.arange(len(x)) == 7, np.nan, x)
    with pytest.raises(InputError, match=r"tip_y_mm \(row 7\): got nan"):
        log.with_columns(tip_x_mm=x, tip_y_mm=gap, tip_z_mm=x)


def test_wrong_kinds_of_values_are_reported_by_name() -> None:
    path = ct.Path.paper()
    wrong: list[tuple[str, Callable[[], object]]] = [
        ("path: got 'p.nc'", lambda: ct.simulate("p.nc", 1000.0)),  # type: ignore[arg-type]
        ("feed: got 'slow'", lambda: ct.simulate(path, "slow")),  # type: ignore[arg-type]
        ("feed_mm_min: got -5.0", lambda: ct.simulate(path, -5.0)),
        ("dwell_s: got 1 without decelerate", lambda: ct.Feed(1000.0, dwell_s=1.0)),
        ("servo: got {}", lambda: ct.simulate(path, 1e3, servo={})),  # type: ignore[arg-type]
        ("LinearAxis.gain_per_s: got 'fast'", lambda: ct.LinearAxis("fast", 5.0)),  # type: ignore[arg-type]
        ("errors.EX0C: got 'a'", lambda: ct.simulate(path, 1e3, errors={"EX0C": "a"})),  # type: ignore[dict-item]
        ("paths: got Path", lambda: ct.sweep(path, [1000.0])),  # type: ignore[arg-type]
        ("radius_mm: got -1.0", lambda: ct.Path.circle(-1.0)),
    ]
    for message, call in wrong:
        with pytest.raises(InputError, match=re.escape(message)):
            call()


def test_a_delay_is_sought_up_to_the_longest_that_a_servo_is_simulated_with() -> None:
    """Beyond it a diagnosis ended in an error of the core that named no file."""
    log, setup = axis_log()
    model = AxisLogModel(log, setup)
    delay = next(effect for effect in model.effects if effect.id == "loop_delay_x").parameters[0]
    assert delay.bounds is not None
    zero = np.zeros(len(model.nuisance))
    for amount, fits in ((delay.bounds[1], True), (1.03 * delay.bounds[1], False)):
        values = {"loop_delay_x": {delay.name: amount}}
        if fits:
            assert np.isfinite(model.exact_residuals(zero, values)).all()
            continue
        with pytest.raises(InputError, match="below 63 control periods"):
            model.exact_residuals(zero, values)

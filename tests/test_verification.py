"""A ball on the table before and after corrections: machine and touches of the test's own."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from promise import kept, needed_runs
from reference_trt_ca import TABLE_2, Floats, table_pose
from trunnion.cli import app
from trunnion.compensation import BallVerification

BALL = tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(60.0, 40.0, 65.0))
SETUP = tn.Setup(BALL, probe=tn.Probe(ball_radius_mm=2.0))
PLACE = np.array([60.1, 39.8, 65.2])
RADIUS = 14.5
"""Of ball and probe together, less the pre-travel."""
PLAN = tn.plan(
    SETUP,
    c_deg=(0, 120, 240),
    a_deg=(30, -40),
    positions_deg=[(a, c) for a in (30, -40) for c in (120, 240)],
)


def shown_by_control(
    real: dict[str, float], known: dict[str, float], sigma_mm: float = 0.0, seed: int = 0
) -> tn.Touches:
    """What the control says, in its own idea of the machine frame, where the ball is touched.

    real, known: Location errors of the machine and those that the kinematics in force have.
    """
    random = np.random.default_rng(seed)
    rows = []
    for a, c, ray in zip(PLAN["a_deg"], PLAN["c_deg"], PLAN.direction, strict=True):
        ball = (table_pose(real, a, c) @ np.append(PLACE, 1.0))[:3]
        # The control moves along the ray of a machine without errors through the planned centre.
        start = (table_pose({}, a, c) @ [*(BALL.centre_mm or ()), 1.0])[:3]
        across = (start - ball) - ((start - ball) @ ray) * ray
        along = np.sqrt(RADIUS**2 - across @ across)
        joints = ball + across - along * ray
        table = np.linalg.solve(table_pose(known, a, c), np.append(joints, 1.0))
        rows.append((table_pose({}, a, c) @ table)[:3] + sigma_mm * random.normal() * ray)
    x, y, z = np.array(rows).T
    return PLAN.with_columns(x_mm=x, y_mm=y, z_mm=z)


def moved(real: dict[str, float], known: dict[str, float]) -> Floats:
    """Where the ball's centre is found, less the mean, µm."""
    poses = sorted(
        {(a, c) for a, c in zip(PLAN["a_deg"].round(6), PLAN["c_deg"].round(6), strict=True)}
    )
    seen = [
        np.linalg.solve(table_pose(known, a, c), table_pose(real, a, c) @ np.append(PLACE, 1.0))
        for a, c in poses
    ]
    return np.asarray(1e3 * (np.array(seen) - np.mean(seen, axis=0))[:, :3])


def test_the_places_are_those_of_the_machine() -> None:
    half = {name: 0.5 * value for name, value in TABLE_2.items()}
    before, after = shown_by_control(TABLE_2, {}), shown_by_control(TABLE_2, half)
    found = tn.verify_ball(after, SETUP, before=before)
    np.testing.assert_allclose(found.after_um, moved(TABLE_2, half), rtol=0, atol=0.01)
    assert found.before_um is not None
    np.testing.assert_allclose(found.before_um, moved(TABLE_2, {}), rtol=0, atol=0.01)
    exact = tn.verify_ball(shown_by_control(TABLE_2, TABLE_2), SETUP)
    assert exact.max_after_um < 0.01
    assert exact.max_before_um is exact.as_forecast is None


def a_case(seed: int, *, slip: bool = False) -> BallVerification:
    """An estimate with errors as its covariance says, loaded (or with a sign turned)."""
    random = np.random.default_rng(seed)
    names = tuple(TABLE_2)
    root = random.normal(size=(len(names), len(names))) * 0.2 + 0.3 * np.eye(len(names))
    wrong = dict(zip(names, root @ random.normal(size=len(names)), strict=True))
    known = {name: TABLE_2[name] + wrong[name] for name in names}
    estimate = tn.Estimate(
        errors=known, std_errors=dict.fromkeys(names, 0.5), names=names, covariance=root @ root.T
    )
    loaded = known | ({"EX0C": -known["EX0C"]} if slip else {})
    after = shown_by_control(TABLE_2, loaded, sigma_mm=3e-4, seed=seed)
    return tn.verify_ball(after, SETUP, estimate=estimate, draws=1000)


def test_the_forecast_holds_as_often_as_it_says_and_a_slip_is_seen() -> None:
    assert kept(sum(bool(a_case(seed).as_forecast) for seed in range(120)), 120, 0.95)
    slip = a_case(1, slip=True)
    assert slip.as_forecast is False
    assert "are the corrections loaded and on" in slip.summary()


def test_the_command_prints_it_and_refuses_what_is_no_pair(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SETUP.to_toml())
    shown_by_control(TABLE_2, {}).save(tmp_path / "before.csv")
    shown_by_control(TABLE_2, TABLE_2).save(tmp_path / "after.csv")
    files = [str(tmp_path / name) for name in ("before.csv", "after.csv", "s.toml")]
    done = CliRunner().invoke(app, ["verify", *files, "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["max_after_um"] < 0.01
    half = shown_by_control(TABLE_2, {})[:10]
    with pytest.raises(tn.DataError, match=r"before: got .* postures, expected the 9 of after"):
        tn.verify_ball(shown_by_control(TABLE_2, {}), SETUP, before=half)
    with pytest.raises(tn.InputError, match="got a cross, expected a sphere"):
        tn.verify_ball(half, tn.Setup(tn.Artefact("cross")))
    with pytest.raises(tn.DataError, match="at 1 postures, expected two"):
        tn.verify_ball(half[:5], SETUP)


def test_touches_that_were_pasted_twice_count_once() -> None:
    before = shown_by_control(TABLE_2, {}, sigma_mm=3e-4, seed=1)
    after = shown_by_control(TABLE_2, TABLE_2, sigma_mm=3e-4, seed=2)
    twice = [touches[np.tile(np.arange(len(touches)), 2)] for touches in (before, after)]
    once, again = tn.verify_ball(after, SETUP), tn.verify_ball(twice[1], SETUP, before=twice[0])
    assert again.touches_um == pytest.approx(once.touches_um, rel=1e-9)
    assert again.sigma_um == pytest.approx(once.sigma_um, rel=1e-9)
    assert again.max_after_um == pytest.approx(once.max_after_um, rel=1e-9)
    of = [note.partition(": 43 of 86 rows repeat others")[0] for note in again.notes]
    assert of == ["before", "after"]


def test_one_file_given_twice_is_refused_and_files_swapped_are_asked_about(tmp_path: Path) -> None:
    shown_by_control(TABLE_2, {}, sigma_mm=3e-4, seed=1).save(tmp_path / "b.csv")
    shown_by_control(TABLE_2, TABLE_2, sigma_mm=3e-4, seed=2).save(tmp_path / "a.csv")
    before, after = (tn.read_touches(tmp_path / name) for name in ("b.csv", "a.csv"))
    with pytest.raises(tn.DataError, match=r"^before \(.*a.csv\): got the same readings in every "):
        tn.verify_ball(after, SETUP, before=after[np.arange(len(after))[::-1]])
    (said,) = tn.verify_ball(before, SETUP, before=after).mistakes
    assert said.startswith("More is left than there was before the corrections: were the two files")
    assert ", 0.01" in tn.verify_ball(before, SETUP, before=after).summary()
    assert not tn.verify_ball(after, SETUP, before=before).mistakes
    other = before[np.arange(5, len(before))]
    said = r"^before \(.*b.csv\): got 8 postures, .* the 9 of after \(.*a.csv\), "
    with pytest.raises(tn.DataError, match=f"{said}.*: A 0 C 0 is in after alone$"):
        tn.verify_ball(after, SETUP, before=other)


def test_more_left_than_before_is_rarely_said_of_equal_measurements() -> None:
    """Where corrections change nothing, noise alone leaves more after in half of all cases."""
    calm, runs = [], needed_runs(0.95)
    for seed in range(runs):
        one, other = (
            shown_by_control(TABLE_2, TABLE_2, sigma_mm=3e-4, seed=2 * seed + i) for i in (0, 1)
        )
        calm.append(not tn.verify_ball(one, SETUP, before=other, draws=300).mistakes)
    assert kept(sum(calm), runs, 0.95)


def framed(touches: tn.Touches, **columns: float) -> tn.Touches:
    """Touches that say the frame of the control: without corrections unless said."""
    frame = {"wcs_x_mm": 210.5, "wcs_y_mm": 148.2, "wcs_z_mm": -301.0, "wcs_a_deg": 0.0}
    frame |= {"control_corrected": 0} | columns
    return touches.with_columns(**{k: np.full(len(touches), v) for k, v in frame.items()})


def test_what_the_control_did_is_refused_or_said() -> None:
    """Of after, of both, and of the estimate; nothing is said of a pair that is as it should be."""
    before, on = shown_by_control(TABLE_2, {}), {"control_corrected": 1.0}
    after = shown_by_control(TABLE_2, TABLE_2)
    assert tn.verify_ball(framed(after, **on), SETUP, before=framed(before)).notes == ()
    (off,) = tn.verify_ball(framed(after), SETUP, before=framed(before)).notes
    assert off.startswith("control_corrected is 0 after: ")
    (moved,) = tn.verify_ball(
        framed(after, wcs_x_mm=211.0, **on), SETUP, before=framed(before)
    ).notes
    assert moved.startswith("wcs_x_mm was 210.5 before and is 211 after")
    with pytest.raises(tn.DataError, match=r"^wcs_a_deg: got 0.5 after, expected 0 as before"):
        tn.verify_ball(framed(after, wcs_a_deg=0.5, **on), SETUP, before=framed(before))
    (moved,) = tn.verify_ball(
        framed(after, wcs_x_mm=211.0, wcs_z_mm=-300.0, **on), SETUP, before=framed(before)
    ).notes
    assert "is 211 after; wcs_z_mm was -301 and is -300: " in moved
    (longer,) = tn.verify_ball(
        framed(after, tool_length_mm=90.0, **on), SETUP, before=framed(before, tool_length_mm=80.0)
    ).notes
    assert longer.startswith("tool_length_mm was 80 before and is 90 after: ")
    both = {"wcs_a_deg": 0.5, "wcs_c_deg": 1.5}
    with pytest.raises(tn.DataError, match=r"; wcs_c_deg: got 1.5, expected 0: the work offset"):
        tn.verify_ball(framed(after, **both), SETUP, before=framed(before, wcs_c_deg=0.0))
    names = tuple(TABLE_2)
    left = tn.Estimate(
        errors=TABLE_2, names=names, covariance=np.eye(len(names)),
        control_frame=framed(after, **on).control_frame,
    )  # fmt: skip
    with pytest.raises(
        tn.DataError, match=r"^estimate: expected the one that .* corrections were on"
    ):
        tn.verify_ball(framed(after, **on), SETUP, estimate=left, draws=100)
    plain = replace(left, control_frame=framed(before).control_frame)
    assert tn.verify_ball(framed(after, **on), SETUP, estimate=plain, draws=100).forecast_um


def likely(after: tn.Touches, setup: tn.Setup = SETUP, **more: Any) -> str:
    """What a verification names as likely wrong: in its first lines, or in its refusal."""
    try:
        found = tn.verify_ball(after, setup, draws=100, **more)
    except tn.DataError as error:
        return str(error)
    assert found.sentences()[: len(found.mistakes)] == found.mistakes
    return " ".join(found.mistakes)


def test_mistakes_are_named_as_a_diagnosis_names_them() -> None:
    """In either measurement, and in the set-up; sound ones are not asked about."""
    before, after = shown_by_control(TABLE_2, {}, 3e-4, 7), shown_by_control(TABLE_2, TABLE_2, 3e-4)
    assert likely(after, before=before) == ""
    plan = "is this the plan, not what was measured?"
    assert likely(PLAN).endswith(plan)
    assert likely(after, before=PLAN).startswith("before: Every touch")
    assert likely(PLAN, before=before).startswith("after: Every touch")
    assert likely(PLAN, before=PLAN).startswith("before: got the same readings in every row as a")
    few = tn.plan(SETUP, c_deg=(0, 120), a_deg=(0,))  # fewer touches than parameters
    assert len(few) == 10
    assert likely(few).endswith(plan)
    mirrored = replace(SETUP, axes={"A": tn.AxisSetup(sense=-1)})
    assert "Likely cause: the touches fit to" in likely(after, mirrored)
    assert "sense = 1 of axis A" in likely(after, mirrored, before=before)
    assert "artefact.centre_mm = [60.1, 39.8, 65.2]" in likely(
        after, replace(SETUP, artefact=replace(BALL, centre_mm=(-60.0, 90.0, 10.0)))
    )
    other = replace(SETUP, machine=tn.Machine("trt-bc"))
    assert 'preset = "trt-ca"' in likely(after, other)
    inches = replace(BALL, diameter_mm=25.0 / 25.4)
    assert "artefact.diameter_mm is in inches" in likely(after, replace(SETUP, artefact=inches))


@pytest.mark.parametrize("shift_arcsec", [36.0, -360.0, 800.0, 3000.0])
def test_a_shift_of_a_that_no_frame_says_is_named(shift_arcsec: float) -> None:
    """By what is left: A stands elsewhere at the same positions."""
    names = tuple(TABLE_2)
    known = tn.Estimate(errors=TABLE_2, names=names, covariance=0.01 * np.eye(len(names)))
    real = TABLE_2 | {"EA0A": TABLE_2["EA0A"] + shift_arcsec}
    after = shown_by_control(real, TABLE_2, 3e-4, 21)
    for estimate in (None, known):
        found = re.search(r"EA0A (?:=|is) ([−+]\S+) arcsec", likely(after, estimate=estimate))
        assert found
        assert float(found[1].replace("−", "-")) == pytest.approx(shift_arcsec, abs=1.0, rel=0.01)
    other = TABLE_2 | {"EX0C": TABLE_2["EX0C"] + 20.0, "EA0A": TABLE_2["EA0A"] + 36.0}
    assert likely(shown_by_control(other, TABLE_2, 3e-4, 22), estimate=known) == ""
    for seed in range(31, 36):
        sound = shown_by_control(TABLE_2, TABLE_2, 3e-4, seed)
        assert likely(sound, estimate=known) == ""


def test_a_program_with_tcp_needs_its_lines() -> None:
    with pytest.raises(tn.InputError, match=r"control.tcp_off: not given"):
        tn.probing_program(PLAN, SETUP, tcp=True)
    control = tn.ControlSetup(tcp_off="M429")
    ready = tn.Setup(BALL, probe=SETUP.probe, control=control)
    with pytest.raises(tn.InputError, match="tcp: got it with corrected"):
        tn.probing_program(PLAN, ready, tcp=True, corrected=True)
    text = tn.probing_program(PLAN, ready, tcp=True).text()
    assert text.index("M428") < text.index("G38.3 X") < text.rindex("M429")

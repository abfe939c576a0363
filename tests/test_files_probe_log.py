"""LinuxCNC's probe log: the plan with the recorded positions, or an error that names the line."""
# ruff: noqa: E501  (a table of cases reads best with one line a case)

from pathlib import Path

import numpy as np
import pytest

import trunnion as tn

FIRST = "37.500012 0.000000 26.003100 0.000000 0.000000 90.000000 0.000000 0.000000 0.000000\n"
SECOND = "50.998700 1.000000 12.500000 -90.000000 0.000000 180.000100 0.000000 0.000000 0.000000\n"

BAD_LOGS = {
    "empty": ("", ":1:1: got 0 touches, expected 2, one for each touch of the plan; LinuxCNC writes no line"),
    "one short": (FIRST, ":1:1: got 1 touches, expected 2"),
    "one more": (f"{FIRST}{SECOND}\n{SECOND}", ":4:1: got 3 touches, expected 2"),
    "another order": (SECOND + FIRST, ":1:30: A (touch 0): got -90.000000, expected 0.000000 (to 0.001), as planned"),
    "rotary": (FIRST + SECOND.replace("180.0001", "180.0011"), ":2:50: C (touch 1): got 180.001100, expected 180.000000 (to 0.001), as planned"),
    "axis not planned": (FIRST.replace("0.000000 90", "5.000000 90") + SECOND, ":1:39: B (touch 0): got 5.000000, expected 0.000000 (to 0.001), as the plan has no B axis"),
    "far": (FIRST + SECOND.replace("50.9987", "56.0013"), ":2:1: X (touch 1): got a touch 5.001 mm from the planned one, expected at most 5 mm from (51.000, 1.000, 12.500)"),
    "six columns": ("1 2 3 4 5 6\n" + SECOND, ":1:11: got 6 fields, expected nine numbers: X Y Z A B C U V W"),
    "not a number": (FIRST.replace("26.003100", "26,003100") + SECOND, ":1:20: Z: got '26,003100', expected a finite number"),
    "nan": (FIRST.replace("26.003100", "-nan") + SECOND, ":1:20: Z: got '-nan', expected a finite number"),
}  # fmt: skip


@pytest.fixture
def plan() -> tn.Touches:
    return tn.Touches(
        a_deg=[0, -90], c_deg=[90, 180], x_mm=[37.5, 51.0], y_mm=[0, 1], z_mm=[26, 12.5],
        dir_x=[0, -1], dir_y=[0, 0], dir_z=[-1, 0],
        point=[1, 3], feed_mm_min=[600, 600], c_dir=[1, 1], face=["top", "end"],
    )  # fmt: skip


def test_a_log_gives_the_plan_with_the_recorded_positions(plan: tn.Touches, tmp_path: Path) -> None:
    path = tmp_path / "probe.log"
    path.write_text(FIRST + SECOND)
    touches = tn.read_probe_log(path, plan)
    np.testing.assert_array_equal(
        touches.position_mm, [[37.500012, 0.0, 26.0031], [50.9987, 1.0, 12.5]]
    )
    x, y, z = plan.position_mm.T
    assert touches.with_columns(x_mm=x, y_mm=y, z_mm=z) == plan


@pytest.mark.parametrize("case", BAD_LOGS)
def test_a_bad_log_is_refused_with_its_place(case: str, plan: tn.Touches, tmp_path: Path) -> None:
    text, message = BAD_LOGS[case]
    path = tmp_path / "probe.log"
    path.write_text(text)
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_probe_log(path, plan)
    assert str(error.value).startswith(f"{path}:")
    assert message in str(error.value)

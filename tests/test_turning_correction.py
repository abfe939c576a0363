"""What a correction leaves is what it promised, replayed without the core."""

import itertools

import numpy as np
import numpy.typing as npt
import pytest

from trunnion import DataError, InputError, ProgramError
from trunnion.nc import Program, follow
from trunnion.plot import plot_correction
from trunnion.turning import Corner, Correction, Profile, change_um, correct
from trunnion.turning.correction import Rule
from turning_shapes import random_points

FloatArray = npt.NDArray[np.float64]


def cut(program: Program, z: FloatArray) -> FloatArray:
    """Diameter that the straight feed moves of a program cut at each z; nan where none does."""
    moves = follow(program)
    out = np.full(len(z), np.nan)
    for code, a, b in zip(moves.code, moves.start, moves.end, strict=True):
        run = b[2] - a[2]
        if code != 1 or abs(run) < 1e-6:
            continue
        share = (z - a[2]) / run
        on = (share >= 0) & (share <= 1) & np.isnan(out)
        out[on] = 2 * (a[0] + share[on] * (b[0] - a[0]))
    return out


def law(rng: np.random.Generator, z: FloatArray) -> tuple[FloatArray, float]:
    """Return an error that repeats, µm, and the most its slope changes, µm/mm²."""
    out, bend = np.zeros_like(z), 0.0
    for _ in range(int(rng.integers(1, 4))):
        size, wave = rng.uniform(1, 25), rng.uniform(15, 120)
        out += size * np.sin(2 * np.pi * z / wave + rng.uniform(0, 6))
        bend += size * (2 * np.pi / wave) ** 2
    return out, bend


@pytest.mark.parametrize("unit_um", [1.0, 2.0, 10.0])
@pytest.mark.parametrize("seed", range(12))
def test_a_repeatable_error_is_left_within_the_bound(seed: int, unit_um: float) -> None:
    rng = np.random.default_rng(seed)
    corners = [Corner(c.z_mm, c.x_mm) for c in random_points(rng, grooves=False)]
    profile = Profile.from_points(corners)
    program = profile.finishing("linuxcnc-lathe", head=[[("G", 7)]], feed=100).program
    low, high = corners[-1].z_mm, corners[0].z_mm
    pitch = 0.2
    z = np.arange(high, low, -pitch)
    state = rng.bit_generator.state
    error, bend = law(rng, z)
    bound = float(rng.choice([0.0, 0.5, 2.0]))
    got = correct(program, (z, error), unit_um=unit_um, bound_um=bound, window=1)
    promised = unit_um / 2 + bound + 0.5
    assert got.bound_um == pytest.approx(promised)
    fine = np.arange(high - 1e-3, low + 1e-3, -0.013)
    rng.bit_generator.state = state
    true, _ = law(rng, fine)
    change = 1e3 * (cut(got.program, fine) - cut(program, fine))
    seen = ~np.isnan(change)
    # Beside a wall stands the reading nearest to it.
    walls = {a.z_mm for a, b in itertools.pairwise(corners) if a.z_mm == b.z_mm}
    for wall in walls:
        seen &= np.abs(fine - wall) > 1.5 * pitch
    assert seen.mean() > 0.8
    left = true + change
    # Between readings the law leaves its chord by bend pitch²/8.
    assert np.abs(left[seen]).max() <= promised + bend * pitch**2 / 8 + 1e-6
    # And the prediction is the replay.
    ours, on = change_um(program, got.program, fine)
    assert np.abs(ours[seen & on] - change[seen & on]).max() < 1e-6
    assert np.abs(got.remaining_um[got.covered]).max() <= promised + 1e-6


BEGINNINGS = {
    "rapid to the line": "G7 G90\nG0 X60 Z100\nG1 Z0 F0.1\n",
    "X before Z": "G7 G90\nG0 X60\nZ100\nG1 Z0 F0.1\n",
    "feed in": "G7 G90\nG0 X60 Z102\nG1 Z0 F0.1\n",
    "plunge": "G7 G90\nG0 X64 Z100\nG1 X60 F0.1\nZ0\n",
    "face before": "G7 G90\nG0 X-1 Z100\nG1 X60 F0.1\nZ0\n",
    "radius": "G8 G90\nG0 X30 Z100\nG1 Z0 F0.1\n",
    "a second line behind a rapid": (
        "G7 G90\nG0 X60 Z100\nG1 Z60 F0.1\nX70\nZ30\nG0 X80\nG0 Z20\nG0 X75\nG1 Z0\n"
    ),
    "rapid by increments": "G7 G90\nG0 X64 Z100\nG91 X-2\nG90 G1 Z0 F0.1\n",
    "first rapid in inches": "G7 G90 G20\nG0 X2.5 Z4\nG21\nG1 Z0 F0.1\n",
}


@pytest.mark.parametrize("count", [40, 700])
@pytest.mark.parametrize("begins", BEGINNINGS)
def test_the_bound_holds_from_the_first_reading_on(begins: str, count: int) -> None:
    """However the line begins, and where the error is too rough for straight lines."""
    rng = np.random.default_rng(count)
    program = Program.parse(BEGINNINGS[begins], "linuxcnc-lathe")
    z = np.linspace(99.9, 0.1, count)
    error = 7 + 5 * np.sin(z / 15) + rng.normal(0, 3, count)
    for window in (1, 5):
        got = correct(program, (z, error), window=window, bound_um=0.5)
        assert got.bound_um == pytest.approx(1.5)
        change = 1e3 * (cut(got.program, got.window_z_mm) - cut(program, got.window_z_mm))
        assert np.abs(got.window_mean_um + change).max() <= 1.5 + 1e-6


def test_the_bounded_rule_needs_no_more_blocks_than_the_others() -> None:
    program = Program.parse("G7 G90\nG0 X60 Z100\nG1 Z0 F0.1\n", "linuxcnc-lathe")
    z = np.arange(99.5, 0, -1.0)
    error = -43 * (1 - np.exp(-(100 - z) / 67)) + 0.3 * np.sin(z)

    def run(rule: Rule, bound_um: float = 0.0) -> Correction:
        return correct(
            program,
            (z, error),
            rule=rule,
            unit_um=10.0,
            window=1,
            bound_um=bound_um,
        )

    paper, every, bounded = run("paper"), run("every-window"), run("bounded", 0.5)
    assert len(bounded.inserted) <= len(paper.inserted) < len(every.inserted)
    assert bounded.bound_um is not None
    assert np.abs(bounded.remaining_um).max() <= bounded.bound_um == 6.0


def fewest(target: FloatArray, tolerance: float) -> int:
    """Fewest inner corners by trying every set of corners and levels of a short line."""
    n = len(target)
    x = np.arange(n, dtype=float)
    levels = [[k for k in range(-40, 41) if abs(k - t) <= tolerance + 1e-9] for t in target]
    states = {(0, k): 0 for k in levels[0]}
    for i in range(n):
        for j in range(i + 1, n):
            for a in levels[i]:
                if (i, a) not in states:
                    continue
                for b in levels[j]:
                    line = a + (b - a) * (x[i : j + 1] - i) / (j - i)
                    if (np.abs(line - target[i : j + 1]) <= tolerance + 1e-9).all():
                        cost = states[i, a] + (j < n - 1)
                        states[j, b] = min(cost, states.get((j, b), n))
    return min(states[n - 1, k] for k in levels[-1] if (n - 1, k) in states)


@pytest.mark.parametrize("seed", range(20))
def test_the_bounded_rule_puts_in_the_fewest_blocks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    program = Program.parse("G7 G90\nG0 X60 Z13\nG1 Z0 F0.1\n", "linuxcnc-lathe")
    z = np.arange(13.0, -0.5, -1.0)
    error = np.cumsum(rng.normal(0, 1.5, len(z)))
    bound = float(rng.choice([0.0, 0.3, 1.0]))
    got = correct(program, (z, error), unit_um=1.0, bound_um=bound, window=1)
    assert len(got.inserted) == fewest(error, 0.5 + bound)
    assert got.bound_um is not None
    assert np.abs(got.remaining_um[got.covered]).max() <= got.bound_um


def test_an_arc_whose_ends_move_still_closes() -> None:
    text = "G7 G90\nG0 X40 Z50\nG1 Z30 F0.1\nG{arc}\nG1 Z0\n"
    z = np.arange(50, -0.5, -1.0)
    error = np.where(z > 25, -8.0, 13.0)
    for arc in ("2 X60 Z20 R10", "2 X60 Z20 I10", "2 X60 Z20 I10 K0", "3 X60 Z20 K-10"):
        program = Program.parse(text.format(arc=arc), "linuxcnc-lathe")
        got = correct(program, (z, error), unit_um=1.0, window=1)
        moves = follow(got.program)
        bend = moves.code > 1
        assert moves.start[bend, 0] == pytest.approx(20.004)
        assert moves.end[bend, 0] == pytest.approx(29.9935)
        radius = np.hypot(*(moves.start[bend][:, [2, 0]] - moves.centre_mm[bend]).T)
        assert radius == pytest.approx(10.0, abs=0.02)


def test_a_contour_between_p_and_q_is_corrected_and_renumbered() -> None:
    text = (
        "N0010G0X60.Z2.\nN0020G71U1.5R.5\nN0030G71P40Q60U.4W.1F.3\nN0040G0X20.\n"
        "N0050G1Z-40.F.1\nN0060X50.\nN0070G70P40Q60\nN0080M30\n"
    )
    program = Program.parse(text, "fanuc-lathe")
    z = np.arange(0.0, -40, -1.0)
    got = correct(program, (z, -20.0 * (z < -20)), rule="paper", unit_um=10.0)
    lines = got.program.text().splitlines()
    assert len(lines) == 9
    assert len(got.inserted) == 1
    assert "G71P40Q70" in lines[2]
    assert lines[7] == "N0080 G70P40Q70"
    assert lines[4].startswith("N0050 G1X20.02Z-2")
    assert lines[4].endswith("F.1")
    assert lines[5] == "N0060 Z-40."


def test_blocks_that_begin_a_line_hand_over_their_modes() -> None:
    text = "G7 G90\nG0 X60 Z100\nG1 Z0 F0.2 M8 (long)\nM2\n"
    z = np.arange(99.0, 0, -1.0)
    got = correct(Program.parse(text, "linuxcnc-lathe"), (z, 10 * np.sin(z / 20)), window=1)
    lines = got.program.text().splitlines()
    assert lines[2].startswith("G1")
    assert "M8" in lines[2]
    assert "F0.2" in lines[2]
    assert lines[-2].endswith("(long)")
    assert "G1" not in lines[-2]


def test_what_cannot_be_corrected_is_refused() -> None:
    z = np.arange(90.0, 10, -1.0)
    plain = Program.parse("G7 G90\nG0 X60 Z100\nG1 Z0 F0.1\n", "linuxcnc-lathe")
    steps = Program.parse("G7 G90\nG0 X60 Z100\nG91 G1 Z-100 F0.1\n", "linuxcnc-lathe")
    with pytest.raises(ProgramError, match="line 3, column 8: a move in increments"):
        correct(steps, (z, z))
    with pytest.raises(DataError, match="none of the readings"):
        correct(plain, (z + 200, z))
    with pytest.raises(InputError, match=r"readings\[1\]\[3\]"):
        correct(plain, (z, np.where(np.arange(80) == 3, np.nan, z)))
    with pytest.raises(InputError, match="reading 0, mm: got 60, expected at most 5 mm"):
        correct(plain, (z, z + 59_910.0))
    with pytest.raises(InputError, match="radius of the nose"):
        correct(plain, (z, z), nose_mm=-0.8)
    with pytest.raises(InputError, match="feed before the program"):
        correct(plain, (z, z), feed=-0.1)
    with pytest.raises(InputError, match="machine code: got 4503"):
        correct(plain, (z, z), machine_codes=[("4", 503.0)])
    with pytest.raises(InputError, match="unit"):
        correct(plain, (z, z), unit_um=0.0)
    with pytest.raises(InputError, match="window"):
        correct(plain, (z, z), window=0)


def test_the_picture_draws() -> None:
    program = Program.parse("G7 G90\nG0 X60 Z100\nG1 Z0 F0.1\n", "linuxcnc-lathe")
    z = np.arange(99.0, 0, -1.0)
    got = correct(program, (z, -0.3 * (100 - z)), window=1)
    assert plot_correction(got).get_ylabel().endswith("(µm)")
    assert "bound" in got.summary()
    assert got.to_dict()["rule"] == "bounded"


CONTOURS = {
    "curve": "G3 X60 Z20 R10\nG1 Z0",
    "fillet": "G2 X60 Z20 R10\nG1 Z0",
    "curve and a steep line": "G3 X50 Z25 R5\nG1 X70 Z22\nZ0",
    "steep line and a curve": "G1 X60 Z27\nG3 X64 Z25 R2\nG1 Z0",
}


@pytest.mark.parametrize("contour", CONTOURS)
@pytest.mark.parametrize("rule", ["paper", "every-window", "mid-run", "bounded"])
@pytest.mark.parametrize("look_ahead", [True, False])
def test_what_is_not_measured_is_corrected_linearly_between_its_ends(
    contour: str, rule: Rule, look_ahead: bool
) -> None:
    """Section 2.3(1): from the error of the line before to that of the line behind, no notch."""
    program = Program.parse(
        f"G7 G90\nG0 X40 Z50\nG1 Z30 F0.1\n{CONTOURS[contour]}\n", "linuxcnc-lathe"
    )
    z = np.concatenate([np.arange(49.0, 31.0, -0.5), np.arange(18.0, 1.0, -0.5)])
    corrected = correct(
        program, (z, np.where(z > 25, 10.0, 30.0)), rule=rule, look_ahead=look_ahead
    )
    between = np.linspace(29.9, 20.1, 99)
    change, covered = change_um(program, corrected.program, between)
    assert covered.all()
    # Ends are written to a micrometre; along the arc the change follows its radius.
    assert change.max() < -10.0 + 2.0
    assert change.min() > -30.0 - 2.0
    assert np.diff(change).max() < 1.0  # never back
    assert np.abs(corrected.between_um).max() < 22.0
    assert "not measured" in corrected.summary()


def test_a_curve_behind_the_last_measured_line_keeps_its_correction() -> None:
    program = Program.parse("G7 G90\nG0 X40 Z50\nG1 Z30 F0.1\nG3 X60 Z20 R10\n", "linuxcnc-lathe")
    z = np.arange(49.0, 31.0, -0.5)
    corrected = correct(program, (z, np.full(len(z), 10.0)), rule="paper")
    change, _ = change_um(program, corrected.program, np.linspace(29.5, 20.5, 30))
    np.testing.assert_allclose(change, -10.0, atol=1.0)

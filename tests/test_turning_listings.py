"""The four listings of Park and Park (1990), line for line."""

from pathlib import Path

import numpy as np
import pytest

from trunnion.nc import Program
from trunnion.turning import Corner, Profile, TurningProbe, correct, probe_path

DATA = Path(__file__).parent / "data" / "turning"

# Fig. 9, read back from Figs. 12 and 14: z, radius. The flange's radius below Z 35 is not
# determined by the listings; any of 41 mm or more gives them.
PART = Profile.from_points(
    [
        Corner(235, 0),
        Corner(235, 10),
        Corner(230, 15),
        Corner(190, 15),
        Corner(155, 25),
        Corner(155, 30),
        Corner(150, 35),
        Corner(125, 35, "fillet", 5),
        Corner(125, 20),
        Corner(65, 20),
        Corner(65, 35, "fillet", 5),
        Corner(35, 35),
        Corner(35, 42),
        Corner(0, 42),
    ]
)
FLANGE = len(PART.elements) - 1


def listing(name: str) -> str:
    return (DATA / name).read_text()


@pytest.mark.parametrize("angle_deg", [95.0, 110.0, 124.9])
def test_fig_12_from_the_shape(angle_deg: float) -> None:
    """Ball and allowance 5.5 mm, body 12 mm; any contact angle of this range."""
    path = probe_path(
        PART,
        TurningProbe(ball_diameter_mm=10.0, contact_angle_deg=angle_deg, body_diameter_mm=12.0),
        allowance_mm=0.5,
        skip=[FLANGE],
        retract_x_mm=50.0,
        approach_mm=1.0,
        chuck_radius_mm=0.0,
    )
    program = path.program("paper-um", first_number=3, tail=[[("T", 40)]], retract_last=False)
    assert program.text() == listing("fig12.nc")
    assert (path.clearance_mm > -1e-6).all()


def test_fig_14_from_the_shape_and_readings() -> None:
    """Centre path of a 0.8 mm nose; readings a millimetre apart that have the printed units."""
    plain = PART.finishing(
        "paper-um",
        follows="nose-centre",
        nose_mm=0.8,
        convex="meet",
        first_element=1,
        start_z_mm=236.5,
        retract_x_mm=50.0,
        approach_mm=1.0,
        access_z_mm=[92.945],
        first_number=3,
    )
    runs = [
        (range(230, 190, -1), [0, -1, -1, -1, -1, -2, -2, 0]),
        (range(190, 166, -1), [-2, -2, -2, -3, -1]),
        (range(150, 129, -1), [-2, -3, -3, -3, -2]),
        (range(113, 76, -1), [-3] * 8),
    ]
    z = np.concatenate([np.array(places) for places, _ in runs]).astype(float)
    error = np.concatenate([10.0 * np.repeat(k, 5)[: len(places)] for places, k in runs])
    # The paper leaves the nose out of account when it places blocks on the cone.
    corrected = correct(plain.program, (z, error), rule="paper", unit_um=10.0, window=5, feed=0.1)
    lines = listing("fig14.nc").splitlines()
    assert corrected.program.text().splitlines()[: len(lines)] == lines
    assert plain.left_out_mm == ((130.0, 92.945),)


ORIGINAL = """;CSS_T/T
N0001 G99
N0002 G97M41
N0003 G4503
N0004 T0101
N0005 G96S200.M3
N0006 G42
N0007 G0X{diameter}Z75.
N0008 G1Z65.F.1
N0009 {end}
N0010 X82.
N0011 G40
N0012 G0X100.Z150.
N0013 M30
"""


@pytest.mark.parametrize(
    ("name", "diameter", "end", "count", "runs"),
    [
        ("fig18.nc", "70.", "Z0F.10", 196, [(12, 0), (28, -1)]),
        ("fig20.nc", "52.", "Z0", 190, [(5, 0), (12, -1), (19, -2), (1, -3), (1, -2)]),
    ],
)
def test_figs_18_and_20_from_their_programs_and_readings(
    name: str, diameter: str, end: str, count: int, runs: list[tuple[int, int]]
) -> None:
    original = Program.parse(ORIGINAL.format(diameter=diameter, end=end), "fanuc-lathe")
    z = 65.0 - 60.0 * np.arange(1, count + 1) / count
    error = 10.0 * np.repeat([k for _, k in runs], [5 * windows for windows, _ in runs])[:count]
    corrected = correct(
        original,
        (z, error),
        rule="paper",
        unit_um=10.0,
        window=5,
        look_ahead=False,
        machine_codes=[("G", 4503)],
    )
    assert corrected.program.text() == listing(name)


@pytest.mark.parametrize("name", ["fig12.nc", "fig14.nc", "fig18.nc", "fig20.nc"])
def test_listings_come_back_as_they_were_read(name: str) -> None:
    dialect = "paper-um" if name in ("fig12.nc", "fig14.nc") else "fanuc-lathe"
    assert Program.parse(listing(name), dialect).text() == listing(name)

"""Effects of a tilting axis B: the machine turned by 90° about Z is one with a tilting axis A.

The contract's catalogue, the twin and the CasADi baseline know A only; what they check of A is
carried to B by this symmetry.
"""

from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.probing.model import TouchModel, catalogue

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # X to Y, Y to -X
CENTRE = np.array([20.0, -10.0, 60.0])
PAIRS: list[tuple[dict[str, float], dict[str, float], str]] = [
    ({"k_arcsec": 7.0}, {"k_arcsec": 7.0}, "positioning"),
    ({"k_arcsec": -4.0}, {"k_arcsec": -4.0}, "scale"),
    ({"ky_um": 5.0, "kz_um": 3.0}, {"kx_um": -5.0, "kz_um": 3.0}, "sag"),
    ({"k_arcsec": 60.0}, {"k_arcsec": -60.0}, "twist"),
    ({"b_arcsec": 9.0}, {"b_arcsec": 9.0}, "backlash"),
]


def setup(preset: str, centre: Any) -> tn.Setup:
    sphere = tn.Artefact("sphere", diameter_mm=22.0, centre_mm=tuple(centre))
    return tn.Setup(artefact=sphere, machine=tn.Machine(preset))


def touches(letter: str, turned: Any) -> tn.Touches:
    """Touches about the sphere's place at each tilt, seen from a machine turned by ``turned``."""
    rng = np.random.default_rng(4)
    n = 60
    tilt, turn = rng.uniform(-90, 90, n), rng.uniform(0, 360, n)
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    sense = rng.choice([-1, 1], n)
    a, c = np.deg2rad(tilt), np.deg2rad(turn)
    x, y, z = CENTRE
    at = np.column_stack([x * np.cos(c) - y * np.sin(c), x * np.sin(c) + y * np.cos(c), z + 0 * c])
    at = np.column_stack(
        [
            at[:, 0],
            at[:, 1] * np.cos(a) - at[:, 2] * np.sin(a),
            at[:, 1] * np.sin(a) + at[:, 2] * np.cos(a),
        ]
    )
    ball = (at - (11.0 + tn.Probe().ball_radius_mm) * direction) @ turned.T
    direction = direction @ turned.T
    columns: dict[str, Any] = {f"{letter}_deg": tilt, "c_deg": turn, f"{letter}_dir": sense}
    for i, axis in enumerate("xyz"):
        columns[f"{axis}_mm"], columns[f"dir_{axis}"] = ball[:, i], direction[:, i]
    return tn.Touches(columns)


@pytest.mark.parametrize(("of_a", "of_b", "what"), PAIRS, ids=[what for _, _, what in PAIRS])
def test_what_acts_on_b_is_what_acts_on_a_seen_from_the_side(
    of_a: dict[str, float], of_b: dict[str, float], what: str
) -> None:
    readings = []
    for letter, preset, values, turned in (
        ("a", "trt-ca", of_a, np.eye(3)),
        ("b", "trt-bc", of_b, QUARTER),
    ):
        id_ = f"{letter}_{what}"
        made = setup(preset, turned @ CENTRE)
        model = TouchModel(made, [id_])
        moves = model.moves(touches(letter, turned))
        plain = model.core.linearise(moves, model.values({}, {}, {}))[0]
        moved = model.core.linearise(moves, model.values({}, {}, {id_: values}))[0]
        assert np.abs(plain).max() < 1e-6
        readings.append(moved)
    assert np.abs(readings[0]).max() > 1.0
    assert readings[1] == pytest.approx(readings[0], abs=1e-8)


def test_every_effect_of_b_is_among_them() -> None:
    ids = {info.id for info in catalogue(setup("trt-bc", CENTRE)) if info.id.startswith("b_")}
    assert ids == {f"b_{what}" for _, _, what in PAIRS}

"""One bridge to the machine: nothing else applies a sense or makes the core's machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.machine.chain import Chain

PACKAGE = Path(tn.__file__).parent
BRIDGES = {
    "machine/chain.py",
}
TURNED = tn.Setup(artefact=tn.Artefact("cross"), axes={"A": tn.AxisSetup(-1)})


@pytest.mark.parametrize("call", [".sense(", "_core.MachineModel("])
def test_only_the_chain_calls_the_core_s_machine_or_applies_a_sense(call: str) -> None:
    found = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if call in path.read_text(encoding="utf-8").replace('setup.sense("C")', "", 1)
    }
    assert found <= BRIDGES
    assert "machine/chain.py" in found


def test_positions_go_to_the_machine_and_back() -> None:
    chain = Chain(TURNED)
    assert (chain.letters, chain.tilting, chain.senses.tolist()) == ("AC", "A", [-1.0, 1.0])
    given: dict[str, Any] = {"a": np.array([10.0, 0.0]), "C": 30.0}
    turned = chain.to_machine(given)
    assert turned.tolist() == [[-10.0, 30.0], [0.0, 30.0]]
    back = chain.to_control(turned)
    assert back["A"].tolist() == [10.0, 0.0]
    assert not np.signbit(back["A"]).any()
    assert back["C"].tolist() == [30.0, 30.0]


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ({"A": 0.0}, "c_deg: got none"),
        ({"A": 0.0, "C": 0.0, "B": 0.0}, "b_deg: got positions of axis B"),
        ({"A": np.nan, "C": 0.0}, "a_deg: got nan"),
        ({"A": [1.0, 2.0, 3.0], "C": [0.0, 1.0]}, r"c_deg: got shape \(2,\)"),
    ],
)
def test_bad_positions(positions: dict[str, float], message: str) -> None:
    with pytest.raises(tn.TrunnionError, match=message):
        Chain(TURNED).to_machine(positions)


def test_what_takes_a_control_s_sign_gives_the_same_machine() -> None:
    """A control that counts A the other way sees the same machine with A negated."""
    plain = tn.Setup(artefact=tn.Artefact("cross"))
    errors = {"EX0C": 12.0, "EB0A": 20.0, "EC0A": -15.0}
    effects = {"a_positioning": {"k_arcsec": 8.0}}
    one = tn.volumetric_error(plain, errors, effects, a_deg=[-30, 60], c_deg=45)
    other = tn.volumetric_error(TURNED, errors, effects, a_deg=[30, -60], c_deg=45)
    assert np.array_equal(one.field_um, other.field_um)
    found = [tn.cnc_parameters(s, errors, method="direct").zeros_arcsec for s in (plain, TURNED)]
    assert found[0]["C"] == found[1]["C"]
    assert found[0]["A"] == -found[1]["A"]


def test_names_and_effects() -> None:
    chain = Chain(TURNED)
    assert chain.location_errors["EX0C"] == "um"
    assert chain.named_errors({"e_a0a": 3.0}) == {"EA0A": 3.0}
    with pytest.raises(tn.UnknownNameError, match="EX0B"):
        chain.named_errors({"EX0B": 1.0})
    with pytest.raises(tn.InputError, match="two spellings"):
        chain.named_errors({"EA0A": 1.0, "EAOA": 2.0})
    assert {"artefact_diameter", "artefact_squareness", "a_sag"} <= set(chain.effects)
    assert "artefact_diameter" not in {e.id for e in chain.catalogue()}

"""Orientable toolholder of a Siemens 840D ($TC_CARR): vectors of a head, a table, or one of each.

6FC5397-1DP40-6BA1, swivelling: T has axes in the head, I1 = -(I2 + I3); P under the table,
I4 = -(I2 + I3); M one of each, I1 = -I2, I4 = -I3; a single axis is rotary axis 1.
6FC5397-0BP10-0BA0, W1, 2.5: vectors of a head point from the tool tip to the reference point, the
length is I1 + R1 (I2 + R2 (I3 + tool)), turns right-handed about V; V of zero does not turn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from trunnion.base.units import Floats
from trunnion.compensation.machine import MachineErrors
from trunnion.controls.files import Setting
from trunnion.controls.links import links, pivot_mm
from trunnion.controls.screws import Screw, screws
from trunnion.controls.stated import Need, lines
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

PLACES = 9
CARRIER = Need(
    "vector_sign", ("1", "-1"),
    "1: V of an axis of the table is the direction about which it turns right-handed for a "
    "positive position, as in the examples of W1 (6FC5397-0BP10-0BA0, 2.5.4 and 4.1), -1: the "
    "opposite; try one: at +45° about V = +Y a point above the axis goes towards +X",
)  # fmt: skip
NUMBERS = {
    "I1": (1, 2, 3), "I2": (4, 5, 6), "V1": (7, 8, 9), "V2": (10, 11, 12), "I3": (15, 16, 17),
    "I4": (18, 19, 20),
}  # fmt: skip
Meanings: TypeAlias = Mapping[str, str]
MEANINGS: Mapping[str, Meanings] = {
    "P": {
        "I2": "reference point to rotary axis 1",
        "V1": "direction of rotary axis 1",
        "V2": "direction of rotary axis 2",
        "I3": "rotary axis 1 to rotary axis 2",
        "I4": "closes the chain: -(I2 + I3)",
    },
    "T": {
        "I1": "closes the chain: -(I2 + I3)",
        "I2": "rotary axis 2 to rotary axis 1",
        "V1": "direction of rotary axis 1",
        "V2": "direction of rotary axis 2",
        "I3": "tool adapter to rotary axis 2",
    },
    "M": {
        "I1": "closes the head: -I2",
        "I2": "tool adapter to rotary axis 1",
        "V1": "direction of rotary axis 1, in the head",
        "V2": "direction of rotary axis 2, of the table",
        "I3": "reference point to rotary axis 2",
        "I4": "closes the table: -I3",
    },
}


@dataclass(frozen=True)
class Toolholder:
    """Lines of the axes of a machine, in machine coordinates, and the tool that was measured with.

    head, table: Axes of either side, each carrying the next.
    letters: Of rotary axes 1 and 2.
    tool: From the tool tip to where the tool length is 0, at zero of a head without errors, mm.
    tip: The tip from there, machine's own sense of Z.
    """

    head: Screw
    table: Screw
    letters: str
    tool: Floats
    tip: Floats

    @classmethod
    def of(cls, setup: Setup, known: MachineErrors) -> Toolholder:
        """Lines of a machine with errors.

        Raises InputError: no `centre_mm`; a head without `pivot_mm`.
        """
        sides = links(setup)
        tool = np.array([0.0, 0.0, setup.probe.length_mm - (pivot_mm(setup) or 0.0)])
        return cls(
            screws(setup, known, "head"), screws(setup, known, "table"),
            "".join(link.letter for link in (*sides.head, *sides.table)),
            tool, -tool * Chain(setup).linear_senses(),
        )  # fmt: skip

    @property
    def kind(self) -> str:
        """T, P or M; empty without rotary axes."""
        sides = bool(self.head.points.size), bool(self.table.points.size)
        return {(True, True): "M", (True, False): "T", (False, True): "P"}.get(sides, "")

    def late(self) -> Floats:
        """From where the tool tip comes at zero of the head to where it is meant, mm."""
        if not self.head.points.size:
            return np.zeros(3)
        place = self.head.zero
        return np.asarray(-self.tool - (place[:3, :3] @ self.tip + place[:3, 3]))

    def tilt(self) -> float:
        """By how much a tool longer by 1 mm misses, mm."""
        unit = np.sign(self.tip) + 0.0
        return float(np.linalg.norm(self.head.zero[:3, :3] @ unit + np.sign(self.tool)))

    def vectors(self, sign: int) -> dict[str, Floats]:
        """I1 to I4, V1, V2 of $TC_CARR; `sign` of V of the table's axes."""
        late, none = self.late(), np.zeros(3)
        ways = [*self.head.directions, *(sign * self.table.directions), none]
        found = {"V1": ways[0], "V2": ways[1]}
        if self.kind == "M":
            found |= {"I2": self.head.points[0] + late, "I3": self.table.points[0] + late}
            return found | {"I1": -found["I2"], "I4": -found["I3"]}
        points = self.head.points if self.kind == "T" else self.table.points
        if self.kind == "P":
            found |= {"I2": points[0], "I3": points[1] - points[0] if len(points) > 1 else none}
        elif len(points) > 1:
            found |= {"I2": points[0] - points[1], "I3": points[1] + late}
        else:
            found |= {"I2": points[0] + late, "I3": none}
        return found | {"I1" if self.kind == "T" else "I4": -(found["I2"] + found["I3"])}

    def settings(self, nominal: Toolholder, sign: int) -> list[Setting]:
        """$TC_CARR values: of the nominal machine and new."""
        if not self.kind:
            return []
        made = []
        old, new = nominal.vectors(sign), self.vectors(sign)
        for name, meaning in MEANINGS[self.kind].items():
            index = int(name[1]) - 1
            letter = self.letters[index : index + 1] or "none"
            said = f"{meaning} ({letter})" if name[0] == "V" else meaning
            why = "point of the axis nearest to the nominal" if name[0] == "I" else ""
            for number, axis, was, now in zip(
                NUMBERS[name], "XYZ", old[name], new[name], strict=True
            ):
                made.append(
                    Setting(
                        f"$TC_CARR{number}[1]", "tc_carr.spf", "" if name[0] == "V" else "mm",
                        float(was), float(now), f"{name} {axis}: {said}",
                        f"towards +{axis} of the machine", why if abs(now - was) > 1e-9 else "",
                    )
                )  # fmt: skip
        return made

    def files(self, settings: Sequence[Setting], said: Mapping[str, str]) -> dict[str, str]:
        """$TC_CARR, the frame and, of a table, the same values as a kinematic chain."""
        if not self.kind:
            return {}
        head = [*lines(said, ";"), "; mm; vectors without unit"]
        rows = (f"{s.name}={s.new:.{PLACES}f}" for s in settings)
        files = {
            "tc_carr.spf": "\n".join([*head, *rows]) + f'\n$TC_CARR23[1]="{self.kind}"\nM17\n',
            "frame.spf": self._frame(),
        }
        if self.kind == "P":
            files["kinematic_chain.csv"] = _chain(settings)
        return files

    def notes(self) -> list[str]:
        """What the frame is, and what a tool of another length leaves."""
        if not self.kind:
            return ["No rotary axis, no $TC_CARR: enc_comp.ini and cec.ini hold what there is."]
        said = [
            "The frame of frame.spf is the place of the table itself at zero of its axes, and of a "
            "head's tool tip: chain it in front of the work offset. With the vectors alone that "
            "tilt of the work stays.",
            "The tool direction is not corrected.",
        ]
        if self.kind != "P":
            said.append(
                f"The vectors hold for a tool of {self.tool[2]:g} mm, the probe's: $TC_CARR has no "
                "place for the tilt of the tool at zero of the head, which leaves "
                f"{1e5 * self.tilt():.3f} µm for each 100 mm that a tool is longer or shorter."
            )
        return said

    def _frame(self) -> str:
        """Frame of the table at zero; CROT turns about Z, then the new Y, then the new X."""
        turn, shift = self.table.zero[:3, :3], self.table.zero[:3, 3] + self.late()
        about_y = np.arcsin(-turn[2, 0])
        about_x = np.arctan2(turn[2, 1], turn[2, 2])
        about_z = np.arctan2(turn[1, 0], turn[0, 0])
        x, y, z = shift
        a, b, c = np.degrees([about_x, about_y, about_z])
        return (
            "; the table at zero of its axes, about the reference point; RPY: Z, Y', X'' "
            "(MD 10600 = 1)\n"
            f"$P_UIFR[1]=CTRANS(X,{x:.{PLACES}f},Y,{y:.{PLACES}f},Z,{z:.{PLACES}f})"
            f":CROT(X,{a:.{PLACES}f},Y,{b:.{PLACES}f},Z,{c:.{PLACES}f})\nM17\n"
        )


def _chain(settings: Sequence[Setting]) -> str:
    """Return the same values as elements of a kinematic chain."""
    kinds = {"I2": "OFFSET", "V1": "AXIS_ROT", "I3": "OFFSET", "V2": "AXIS_ROT", "I4": "OFFSET"}
    rows = ["element,type,x,y,z"]
    for name, kind in kinds.items():
        values = [f"{s.new:.{PLACES}f}" for s in settings if s.meaning.startswith(f"{name} ")]
        rows.append(",".join((name, kind, *values)))
    return "\n".join(rows) + "\n"

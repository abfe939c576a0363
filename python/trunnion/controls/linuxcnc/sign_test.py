"""A program that shows the senses of the rotary axes before anything is trusted to them."""

from __future__ import annotations

import numpy as np

from trunnion.machine.chain import Chain
from trunnion.setup import Setup

MARK_MM = (40.0, 30.0, 0.0)
"""On the table, off all axes."""


def sign_test(setup: Setup) -> str:
    """Where a mark of the table must go when an axis turns: to be looked at, nothing is touched."""
    chain = Chain(setup)
    letters = chain.letters
    off = setup.control.tcp_off or "M429"
    mark = np.array(MARK_MM)
    lines = [
        f"(Sign test. Mark the table top at X {MARK_MM[0]:g} Y {MARK_MM[1]:g} from its centre.)",
        f"(Keep the tool high: it does not move while an axis turns, by {off}.)",
        f"G21 G90 G94 {setup.control.wcs}",
        off,
    ]
    for letter, angle in ((letters[-1], 90.0), (letters[0], 10.0)):
        turned = dict.fromkeys(letters, 0.0) | {letter: angle}
        turn, shift = chain.table_pose(chain.to_machine(turned))
        place = turn[0] @ mark + shift[0]
        x, y, z = place * chain.linear_senses()
        said = f"X {x:.1f} Y {y:.1f} Z {z:.1f}"
        lines += [
            f"(MSG, {letter} turns to {angle:+g}: the mark must go to {said})",
            "M0",
            f"G1 F300 {letter}{angle:g}",
            f"(MSG, Is the mark at {said}? If not, [axes.{letter}] sense is wrong)",
            "M0",
            f"G1 F300 {letter}0",
        ]
    return "\n".join([*lines, "M2"]) + "\n"

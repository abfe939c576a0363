"""A program that shows the senses of the rotary axes before anything is trusted to them."""

from __future__ import annotations

import numpy as np

from trunnion.machine.chain import Chain
from trunnion.machine.kinematics import forward_kinematics
from trunnion.setup import Setup

MARK_MM = (40.0, 30.0, 0.0)
"""On the table, off all axes."""


def sign_test(setup: Setup) -> str:
    """Where a mark of the table, or the tool point, must go when an axis turns: to be looked at.

    Linear axes stand still, nothing is touched.
    """
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
    for letter in reversed(letters):
        on_table = chain.sides[letter] == "table"
        angle = 90.0 if on_table and letter == chain.turning else 10.0
        turned = chain.to_machine(dict.fromkeys(letters, 0.0) | {letter: angle})
        if on_table:
            what = "mark"
            turn, shift = chain.table_pose(turned)
            place = turn[0] @ mark + shift[0]
        else:
            what = "point of a tool as long as the probe"
            place = forward_kinematics(setup, np.hstack([np.zeros((1, 3)), turned]), {})[0][0]
        x, y, z = place * chain.linear_senses() + 0.0
        said = f"X {x:.1f} Y {y:.1f} Z {z:.1f}" + ("" if on_table else " from where it was")
        lines += [
            f"(MSG, {letter} turns to {angle:+g}: the {what} must go to {said})",
            "M0",
            f"G1 F300 {letter}{angle:g}",
            f"(MSG, Is the {what} at {said}? If not, [axes.{letter}] sense is wrong)",
            "M0",
            f"G1 F300 {letter}0",
        ]
    return "\n".join([*lines, "M2"]) + "\n"

"""Common mistakes of a measurement, recognised by what they do to its estimates.

A sentence names the likely cause; no number is changed.
"""

from __future__ import annotations

from collections.abc import Mapping

from trunnion.setup import Setup

TIP_SHARE = 0.1
"""Of the ball's radius: how near an estimate has to come; errors of machines are smaller."""

LEAST_UM = 200.0
"""Below this an estimate is an ordinary error of a machine."""


def likely_mistakes(errors: Mapping[str, float], setup: Setup) -> tuple[str, ...]:
    """Name what is likely wrong with a measurement that gives these location errors, µm."""
    radius = setup.probe.ball_radius_mm * 1e3
    said = []
    for name, value in errors.items():
        height = value - setup.machine.errors.get(name, 0.0)
        near = abs(abs(height) - radius) <= TIP_SHARE * radius
        if name.startswith("EZ0") and near and abs(height) >= LEAST_UM:
            where = "to the tip of the ball" if height < 0 else "beyond the centre of the ball"
            said.append(
                f"{name} is {height:+.0f} µm, about the radius of the ball ({radius:.0f} µm): was "
                f"the tool's length measured {where}? It is expected to the centre."
            )
    return tuple(said)

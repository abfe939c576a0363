"""Targets on one rotary axis, on the diagnosis engine: circle, axis average line, error motions.

A target fixed to the axis at v (mm, frame of the axis average line) is measured at ::

    p = O + F A [ o + E_xyz + T(E_A, E_B) Rz(θ + E_C) v ] + noise

F, O: the axis average line as the plain circles give it; o, A: its shift and tilt from there; v:
one for each target (its radius, phase and height). All of these are nuisance. E: the error motions
of ISO 230-7 at the commanded position θ: radial E_X, E_Y and axial E_Z (µm), tilt E_A, E_B and
angular positioning E_C (arcsec), in the frame of the axis, whose third direction is the one about
which a positive position turns right-handed. Effects are error motions; formulas are in
docs/reference/effects.md. Predictions and derivatives are exact.

A reading is one coordinate of a target in its own radial, tangential and axial direction, in µm
from the plain circle. Axes position less well than instruments measure, so that the three are
brought to one noise before anything is tested.
"""

from trunnion.models.rotary.geometry import Circle as Circle
from trunnion.models.rotary.geometry import circles as circles
from trunnion.models.rotary.geometry import fit_circles as fit_circles
from trunnion.models.rotary.model import ExtendedSweep as ExtendedSweep
from trunnion.models.rotary.model import SweepModel as SweepModel
from trunnion.models.rotary.model import build as build

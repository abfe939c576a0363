"""Points on the diagnosis engine: features made by linear axes and measured outside the machine.

A feature programmed at q (mm, machine frame) lies at ``q + e(q)`` on the part, and the instrument
reads ::

    m = T_g R_g (q + e(q)) + noise

with one rigid placement T_g R_g a set-up (``group``), which is nuisance. A reading is one measured
coordinate, in µm, turned back into the machine frame by the placement of the plain fit. Effects
are what the axes do, ``e``; formulas and units are in docs/reference/effects.md. Derivatives are
exact.

What the axes of one machine do alike on every part is *named*; what is left but changes slowly from
place to place is *field*; what belongs to one hole and is there again when the hole is measured
again is *hole by hole*; the residual is the measurement. :func:`repeatable_part` separates them.
"""

from trunnion.models.points.model import ExtendedPoints as ExtendedPoints
from trunnion.models.points.model import FeatureScatter as FeatureScatter
from trunnion.models.points.model import PointsModel as PointsModel
from trunnion.models.points.model import build as build
from trunnion.models.points.repeatability import RepeatablePart as RepeatablePart
from trunnion.models.points.repeatability import repeatable_part as repeatable_part

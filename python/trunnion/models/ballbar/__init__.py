"""Ball-bar lengths on the diagnosis engine: hybrid machine and plain three-axis circle tests.

One model for both. A reading is the measured length less the length that the nominal machine would
give, in µm. Every effect is a displacement δ of the tool point, or of a part of the bar, and enters
with the bar's direction n: reading += n·δ. A three-axis machine goes where it is commanded; the
hybrid machine gets there through its loops, and its effects act on the legs, the joints and the
wrist, from where the exact sensitivities take them to the tool point. Always fitted: the ball's
centre of each set-up, and for the hybrid machine its 17 errors (trunnion.hybrid.mechanism).
Formulas and signs of the effects are in docs/reference/effects.md, the keys of the table
``[ballbar]`` in `BallbarSettings`. A machine is hybrid if the data command joints or
the set-up has a table ``[hybrid]``.
"""

from trunnion.models.ballbar.model import BallbarModel as BallbarModel
from trunnion.models.ballbar.model import ExtendedBallbarModel as ExtendedBallbarModel
from trunnion.models.ballbar.model import build as build
from trunnion.models.ballbar.model import described as described
from trunnion.models.ballbar.settings import BallbarSettings as BallbarSettings

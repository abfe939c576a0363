"""The hybrid parallel machine of paper 004: two outer UPR legs, a central SPR leg, two-axis wrist.

Kinematics and sensitivities are the core's; here are names, files, results, the study of the
paper's section 3 and the use of a ball-bar. Pictures are in :mod:`trunnion.plot.hybrid`.
"""

from trunnion.hybrid.ballbar import (
    BallbarIdentification,
    Identifiability,
    ballbar_plan,
    choose_poses,
    identifiability,
    identify_ballbar,
)
from trunnion.hybrid.cube import (
    CubeChange,
    CubeStudy,
    cube_study,
    transformed_cube,
)
from trunnion.hybrid.mechanism import (
    OUTSIDE_ERRORS,
    PAPER_ERRORS,
    ClosureDependence,
    Constraint,
    Forward,
    Mechanism,
    Sensitivity,
)

__all__ = [
    "OUTSIDE_ERRORS",
    "PAPER_ERRORS",
    "BallbarIdentification",
    "ClosureDependence",
    "Constraint",
    "CubeChange",
    "CubeStudy",
    "Forward",
    "Identifiability",
    "Mechanism",
    "Sensitivity",
    "ballbar_plan",
    "choose_poses",
    "cube_study",
    "identifiability",
    "identify_ballbar",
    "transformed_cube",
]

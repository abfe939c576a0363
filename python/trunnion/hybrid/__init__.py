"""A hybrid parallel machine: two outer UPR legs, a central SPR leg, two-axis wrist.

After D. Ko, T. Kim, K. T. Kim and S. P. Na, "Representation of Sensitivities with respect to
Geometric Errors for a Hybrid-Structure Machining Center"; "the paper" in this package. Kinematics
and sensitivities are the core's; here are names, files, results, the study of the paper's section 3
and the use of a ball-bar. Plots are in :mod:`trunnion.plot.hybrid`.
"""

from trunnion.hybrid.choose import choose_poses
from trunnion.hybrid.cube import (
    CubeChange,
    CubeStudy,
    cube_study,
    transformed_cube,
)
from trunnion.hybrid.identifiability import Identifiability, identifiability
from trunnion.hybrid.identify import BallbarIdentification, identify_ballbar
from trunnion.hybrid.mechanism import Mechanism
from trunnion.hybrid.parameters import OUTSIDE_ERRORS, PAPER_ERRORS
from trunnion.hybrid.plan import ballbar_plan
from trunnion.hybrid.results import ClosureDependence, Constraint, Forward, Sensitivity

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

"""A hybrid parallel machine: two outer UPR legs, a central SPR leg, two-axis wrist.

After D. Ko, T. Kim, K. T. Kim and S. P. Na, "Representation of Sensitivities with respect to
Geometric Errors for a Hybrid-Structure Machining Center"; "the paper" in this package. Kinematics
and sensitivities are the core's; here are names, files, results, the study of the paper's section 3
and the use of a ball-bar. Plots are in :mod:`trunnion.plot.hybrid`.
"""

from trunnion.hybrid.choose import choose_poses as choose_poses
from trunnion.hybrid.cube import CubeChange as CubeChange
from trunnion.hybrid.cube import CubeStudy as CubeStudy
from trunnion.hybrid.cube import cube_study as cube_study
from trunnion.hybrid.cube import transformed_cube as transformed_cube
from trunnion.hybrid.identifiability import Identifiability as Identifiability
from trunnion.hybrid.identifiability import identifiability as identifiability
from trunnion.hybrid.identify import BallbarIdentification as BallbarIdentification
from trunnion.hybrid.identify import identify_ballbar as identify_ballbar
from trunnion.hybrid.mechanism import Mechanism as Mechanism
from trunnion.hybrid.parameters import OUTSIDE_ERRORS as OUTSIDE_ERRORS
from trunnion.hybrid.parameters import PAPER_ERRORS as PAPER_ERRORS
from trunnion.hybrid.plan import ballbar_plan as ballbar_plan
from trunnion.hybrid.results import ClosureDependence as ClosureDependence
from trunnion.hybrid.results import Constraint as Constraint
from trunnion.hybrid.results import Forward as Forward
from trunnion.hybrid.results import Sensitivity as Sensitivity

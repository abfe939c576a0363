"""Ball-bar lengths on the diagnosis engine: hybrid machine and plain three-axis circle tests.

One model for both. A reading is the measured length less the length that the nominal machine would
give, in µm. Every effect is a displacement δ of the tool point, or of a part of the bar, and enters
with the bar's direction n: reading += n·δ. A three-axis machine goes where it is told; the hybrid
machine gets there through its loops, and its effects act on the legs, the joints and the wrist,
from where the exact sensitivities take them to the tool point. Always fitted: the ball's centre of
each set-up, and for the hybrid machine the 17 errors of the paper.

Signs of the three-axis machine are those of touches: p_actual = (I + Λ) p + δ with
Λ_ii += ppm, Λ_xy -= squareness_xy, Λ_xz += squareness_xz, Λ_yz -= squareness_yz, and backlash
δ_i -= b/2 · sign of travel. The others:

================  =============================  ===============================================
id                parameters                     what it does
================  =============================  ===============================================
reversal_spike_x  a_um, decay_ms (decay_mm)      δ_x -= a · sign of travel · exp(-t/decay), t since
                                                 the axis reversed (mm of path without feed, time)
gain_mismatch     y_x_ms, z_x_ms (or _um)        an axis lags the first moving axis by this time
                                                 (by this distance along the path without a feed):
                                                 δ_y -= velocity_y · y_x
cyclic_x          a_um, b_um, pitch_mm           δ_x += a cos(2π x/pitch) + b sin(2π x/pitch)
drift_x           rate_um_h                      δ_x += rate · t
ballbar_length    dl_um                          the bar reads longer by dl
================  =============================  ===============================================

On the hybrid machine (legs 1, 2, 3 together, or one of them: ids with ``_1``, ``_2``, ``_3``):

=================  ===========================  ================================================
leg_expansion      ppm[, tau_min]               leg longer by L ppm (1 - exp(-t/tau)); without
                                                times L ppm
lost_motion        b_um                         leg longer by -b/2 · sign of its travel
screw_cyclic       a_um, b_um, pitch_mm         leg longer by a cos(2π L/pitch) + b sin(2π L/pitch)
gravity            k_um                         ends of the legs sink square to them by
                                                k (L/1000 mm)³ · cos(slope): gravity along -Z
wrist_squareness   arcsec                       q5 axis not square to q4: tilt b at place wrist5
base_shift         dy_um, dz_um                 base joint of leg 3 is displaced
base_shift_2       dx_um, dz_um                 base joint of leg 2 is displaced
=================  ===========================  ================================================

Set-up file, table ``[ballbar]``; every key has the default shown::

    [ballbar]
    calibrated = true        # false: the bar's length has an unknown constant, one for all
    repeatability_um = 0.0   # 1 σ of a reading; 0 = unknown, to be estimated
    direction = [0, 0, -1]   # hybrid machine commanded in coordinates: spindle to tool point
    wrist = 1                #   and branch of the wrist, +1 or -1

A machine is hybrid if the data command joints or the set-up has a table ``[hybrid]``.
"""

from trunnion.models.ballbar.model import BallbarModel, ExtendedBallbarModel, build
from trunnion.models.ballbar.settings import BallbarSettings

__all__ = ["BallbarModel", "BallbarSettings", "ExtendedBallbarModel", "build"]

"""Turning: probe the part, correct its finishing program, predict what the correction leaves.

After C. K. Park and D. S. Park, "A Study on the Automatic Compensation of Machining Error in NC
Turning", Transactions of the KSME, 1990. Coordinates are z from the chuck face outward and x, the
**radius**, in mm; diameter errors are measured minus nominal, in µm on the diameter, negative where
the part is too thin.

>>> profile = Profile.from_points([(100, 20), (50, 20), (50, 30), (0, 30)])
>>> path = probe_path(profile, TurningProbe(ball_diameter_mm=3.0), retract_x_mm=60)
>>> print(path.program("linuxcnc-lathe", feed=200).text())   # doctest: +SKIP
"""

from trunnion.turning.correction import Correction as Correction
from trunnion.turning.correction import change_um as change_um
from trunnion.turning.correction import correct as correct
from trunnion.turning.gauge import Gauge as Gauge
from trunnion.turning.listing import Crossing as Crossing
from trunnion.turning.listing import crossings as crossings
from trunnion.turning.probing import Interval as Interval
from trunnion.turning.probing import ProbePath as ProbePath
from trunnion.turning.probing import TurningProbe as TurningProbe
from trunnion.turning.probing import probe_path as probe_path
from trunnion.turning.profile import Corner as Corner
from trunnion.turning.profile import Finishing as Finishing
from trunnion.turning.profile import Profile as Profile
from trunnion.turning.shape import read_shape as read_shape

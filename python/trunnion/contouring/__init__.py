"""Five-axis contouring with cross-coupled control (Byun and Jee 2010).

- `Path`: where tool tip and tool axis should be;
- `Servo`, `LinearAxis`, `RotaryAxis`, `Coupling`, `read_servo`: what moves and what controls it;
- `simulate`, `sweep`: one run, or thousands in one call, with true errors;
- `margins`: gain and stability margins of the coupled loop;
- `compare`, `order_of_controller`, `position_models`, `offsets`: the paper's comparisons.

What is wrong in a servo model is found from a log by ``tn.diagnose(tn.read_axis_log(...), setup)``.

Errors of the paper, and what is done here:

- eq. (4) turns the tool axis about itself, which changes nothing; the axis of the turn is
  O(k-d) × O(neighbour);
- Table 1 mixes units (µm, degrees, counts); only products and ratios of its gains enter the loop.
  C_I/K_p is 5.5 1/s for the linear axes and 4.9 1/s for the rotary ones;
- the text passes the controllers' output through the inverse Jacobian, J⁻¹ (C ε). With the numbers
  of Table 1 as printed that loop is worse, and diverges with the path 100 mm from the rotary axes;
  with right units it is nearly the same as C (J⁻¹ ε), because the ratios C/K_p of all axes are: see
  `Coupling.order` and `order_of_controller`;
- the tool is "perpendicular to the path": taken as the normal of the surface z = 15 - x²/15 -
  y²/1000 on which the path lies. The curve's own normal would tilt A to 133 deg;
- the place of the path on the table is not published: see `offsets`;
- eq. (8) is numbered (0); Fig. 7 is captioned "contour error models" and shows orientation errors.
"""

from trunnion.contouring.margins import Margins as Margins
from trunnion.contouring.margins import margins as margins
from trunnion.contouring.paths import Path as Path
from trunnion.contouring.reproduction import ContourComparison as ContourComparison
from trunnion.contouring.reproduction import compare as compare
from trunnion.contouring.reproduction import offsets as offsets
from trunnion.contouring.reproduction import order_of_controller as order_of_controller
from trunnion.contouring.reproduction import position_models as position_models
from trunnion.contouring.servo import Controller as Controller
from trunnion.contouring.servo import Coupling as Coupling
from trunnion.contouring.servo import LinearAxis as LinearAxis
from trunnion.contouring.servo import RotaryAxis as RotaryAxis
from trunnion.contouring.servo import Servo as Servo
from trunnion.contouring.servo import read_servo as read_servo
from trunnion.contouring.simulation import ContourRun as ContourRun
from trunnion.contouring.simulation import ContourSweep as ContourSweep
from trunnion.contouring.simulation import Feed as Feed
from trunnion.contouring.simulation import simulate as simulate
from trunnion.contouring.simulation import sweep as sweep

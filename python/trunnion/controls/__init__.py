"""Files for controls: what is to be set, old and new, and what it leaves.

- `files`: what every control gets, as one result;
- `linuxcnc`: a kinematics component, pins, offsets of homing and work, COMP_FILE tables.
"""

from trunnion.controls.files import ControlFiles as ControlFiles
from trunnion.controls.files import Setting as Setting
from trunnion.controls.linuxcnc.axis_tables import comp_file as comp_file
from trunnion.controls.linuxcnc.files import linuxcnc_files as linuxcnc_files

"""Files for controls: what is to be set, old and new, and what it leaves.

- `files`: what every control gets, as one result;
- `tables`: errors by ISO 230-1 name for any control; volumetric compensation of the ISG kernel;
- `linuxcnc`: a kinematics component, pins, offsets of homing and work, COMP_FILE tables.
"""

from trunnion.controls.files import ControlFiles as ControlFiles
from trunnion.controls.files import Setting as Setting
from trunnion.controls.linuxcnc.axis_tables import comp_file as comp_file
from trunnion.controls.linuxcnc.files import linuxcnc_files as linuxcnc_files
from trunnion.controls.tables import isg_files as isg_files
from trunnion.controls.tables import iso_table as iso_table

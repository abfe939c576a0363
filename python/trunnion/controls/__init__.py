"""Files for controls: what is to be set, old and new, and what it leaves.

- `files`, `forecast`, `stated`: what every control gets, what it leaves, what its user must state;
- `axis_tables`, `screws`: errors of single axes over a position; rotary axes as lines and steps;
- `iso`: errors by ISO 230-1 name for any control; `isg`, `siemens`, `heidenhain`;
- `part_program`, `tool_path`: part programs corrected move by move;
- `linuxcnc`: a kinematics component, pins, offsets of homing and work, COMP_FILE tables.
"""

from trunnion.controls.files import ControlFiles as ControlFiles
from trunnion.controls.files import Setting as Setting
from trunnion.controls.heidenhain import heidenhain_files as heidenhain_files
from trunnion.controls.isg import isg_files as isg_files
from trunnion.controls.isg import twincat_files as twincat_files
from trunnion.controls.iso import iso_table as iso_table
from trunnion.controls.linuxcnc.comp_file import comp_file as comp_file
from trunnion.controls.linuxcnc.comp_file import measured_comp_file as measured_comp_file
from trunnion.controls.linuxcnc.files import linuxcnc_files as linuxcnc_files
from trunnion.controls.part_program import CorrectedProgram as CorrectedProgram
from trunnion.controls.part_program import correct_program as correct_program
from trunnion.controls.siemens import siemens_files as siemens_files

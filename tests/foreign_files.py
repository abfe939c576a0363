"""Small files of controls and instruments, as their programs write them; columns= for each."""

from typing import Any

TWINCAT = (
    "Name;axis;\nFile;C:\\a.csv;\nStarttime of export;132907960342450000;Thursday;16:47\n\n"
    "Name;Cmd;Vel;Act\nData-Type;REAL64;REAL64;REAL64\nSampleTime;10;10;10\n"
    "Unit;mm;(None);m\n\n\n"
    "132907960342450000;1{0}5;0;0{0}0015\n132907960342550000;2;0;0{0}002\n\nEOF\n"
)
HALSCOPE = (
    "Sampling period is 1000000 nSec \n\nx-cmd +1.50000000000000 x-fb +1.40000000000000 \n"
    "x-cmd +2.50000000000000 x-fb +2.40000000000000 \nx-cmd +9.0 x-fb +9.0 \n"
)
CAMONITOR = (
    "AX:Set     2022-04-06 14:02:21.000000 1.0  \n"
    "AX:Act     2022-04-06 14:02:20.500000 7.0 HIHI MAJOR\n"
    "AX:Act     2022-04-06 14:02:21.250000 1.1  \n"
    "AX:Gone    *** Not connected (PV not found)\n"
    "AX:Stat    2022-04-06 14:02:21.3 moving  \n"
    "AX:Act     2022-04-06 14:02:21.500000 1.4  \n"
    "AX:Set     2022-04-06 14:02:22.000000 3.0  \n"
)
HALSAMPLER = "4 1.5 1.4 \noverrun\n9 2.5 2.4 \n10 2.6 2.4 \n"
TRACKER = "        x\t        y\t z\n 1.0\t 2.0\t 3.0\n -1.0\t2.0\t3.5\n"
OTHER_NAMES = "t;Ref;Enc;u\n0;0,5;0,4;2\n1;1,5;1,4;2\n"

FOREIGN: dict[str, tuple[str, dict[str, Any]]] = {
    "twincat": (TWINCAT.format("."), {"x_cmd_mm": "Cmd", "x_act_mm": "Act"}),
    "halscope": (HALSCOPE, {"x_cmd_mm": "x-cmd [inch]", "x_act_mm": "x-fb"}),
    "halsampler": (HALSAMPLER, {"time_s": "1 [ms]", "x_cmd_mm": "2", "x_act_mm": "3"}),
    "camonitor": (CAMONITOR, {"x_cmd_mm": "AX:Set", "x_act_mm": "AX:Act"}),
    "tracker": (
        TRACKER,
        {"x_mm": "x [m]", "y_mm": "y", "z_mm": "z", "target": 1, "angle_deg": "x"},
    ),
    "other names": (OTHER_NAMES, {"time_s": "t [ms]", "x_cmd_mm": "Ref [m]", "x_act_mm": "Enc"}),
}
"""Name → a good file, and the columns that make data of it."""

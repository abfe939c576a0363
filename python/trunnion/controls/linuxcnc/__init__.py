"""LinuxCNC: kinematics with errors, pins, offsets, tables of single joints."""

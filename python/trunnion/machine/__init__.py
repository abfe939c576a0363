"""The machine: its chain of axes, kinematics, and what a measurement says of it."""

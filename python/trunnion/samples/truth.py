"""What is hidden in the samples, and the errors that the paper of the main job injected."""

TABLE_2 = {
    "EA0A": 21.6,
    "EB0A": 18.0,
    "EC0A": 10.8,
    "EY0A": 17.0,
    "EZ0A": 12.0,
    "EB0C": 25.2,
    "EX0C": 15.0,
    "EY0C": 21.0,
}
"""Errors of the sample ``cross``: those that Kang, Kim and Jee (2022) injected (Table 2), µm and
arcsec, absolute."""

OTHER_ERRORS = {
    "EA0A": -31.0,
    "EB0A": 24.0,
    "EC0A": 17.0,
    "EY0A": -9.0,
    "EZ0A": 22.0,
    "EB0C": -13.0,
    "EX0C": 27.0,
    "EY0C": -16.0,
}
"""Errors of the sample ``hidden``, without Table 2's coincidence EC0A + (EB0C − EB0A) = EB0A."""

HIDDEN_EFFECTS = {
    "drift_z": {"rate_um_h": 6.0},
    "c_positioning_2": {"a2_arcsec": 6.0, "b2_arcsec": -4.0},
}
"""Effects in the sample ``hidden``: Z drifts, the table's scale is eccentric."""

HIDDEN_BACKLASH_UM = 4.0
"""Backlash of Y in the sample ``contour/axislog.csv``, µm."""

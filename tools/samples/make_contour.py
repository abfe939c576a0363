"""Make the sample of an axis log again: ``python tools/samples/make_contour.py``.

``contour/setup.toml``
    The servo axes of Byun and Jee 2010 (Table 1) as a ``[servo]`` table.
``contour/axislog.csv``
    Two runs along their path, 1 and 3 m/min, logged every 4 ms; 0.2 µm and 1 arcsec of noise. The
    machine that was logged has 4 µm of backlash in Y, which the set-up does not say.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import trunnion as tn
from trunnion import contouring as ct
from trunnion.samples.truth import HIDDEN_BACKLASH_UM

__all__ = ["make_contour"]

EVERY = 4

SETUP = """\
# Five servo axes, for `trunnion contour simulate` and `trunnion contour diagnose`.
[servo]
period_ms = 1.0                # control period
feedback = "motor"             # "motor" | "load": which position the loops are closed on

[servo.X]
gain_per_s = 81.28             # of the whole loop: at speed v the axis lies v / gain behind
time_constant_ms = 5.76        # of the drive

[servo.Y]
gain_per_s = 80.544
time_constant_ms = 5.77

[servo.Z]
gain_per_s = 81.184
time_constant_ms = 5.50

[servo.A]
gain_per_s = 81.957
time_constant_ms = 5.85

[servo.C]
gain_per_s = 81.8201
time_constant_ms = 5.75

[report]
machine = "simulated five-axis machine (sample of trunnion)"
"""


def make_contour(folder: Path) -> None:
    """Write ``setup.toml`` and ``axislog.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(SETUP, encoding="utf-8")
    servo = ct.read_servo(folder / "setup.toml")
    worn = replace(servo.axes["Y"], backlash_um=HIDDEN_BACKLASH_UM)  # type: ignore[arg-type]
    servo = replace(servo, axes={**servo.axes, "Y": worn})
    logs = [
        ct.simulate(ct.Path.paper(), feed, controller="independent", servo=servo).axis_log(
            noise_um=0.2, noise_arcsec=1.0, seed=2010 + i, run=f"{feed:g} mm/min"
        )[::EVERY]
        for i, feed in enumerate((1000.0, 3000.0))
    ]
    log = tn.AxisLog.concatenate(logs)
    places = {"time_s": 3, **{name: 6 for name in log.columns if name.endswith(("_mm", "_deg"))}}
    rounded = {name: np.round(log.columns[name], digits) for name, digits in places.items()}
    log.with_columns(**rounded).to_csv(folder / "axislog.csv")


if __name__ == "__main__":
    SAMPLES = Path(__file__).parents[2] / "python" / "trunnion" / "samples"
    make_contour(SAMPLES / "contour")

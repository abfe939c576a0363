"""Make the turning samples again: ``python tools/samples/make_turning.py``.

``turning/part.ngc``: a finishing program (LinuxCNC) of a 70 mm shaft. ``setup.toml``: 65 mm
of overhang, 0.1 mm and 1200 revolutions a minute. ``diameters.csv``: one pass of it, read by the
paper's gauge; ``passes.csv``: that pass and one with reversed feed and twice the depth of cut. In
them the tool heats up (30 µm, 25 s) and the part bends (10 µm at its free end).
"""

from pathlib import Path

import numpy as np

import trunnion as tn
from trunnion.turning import Gauge

__all__ = ["make_turning"]

PROGRAM = """\
G7 G18 G21 G90 G97 S1200 M3
G95 F0.1
G0 X70. Z65.
G1 Z20.
G2 X80. Z15. R5.
G1 X90.
Z0.
G0 X100. Z100.
M2
"""

SETUP = """\
[turning]
overhang_mm = 65.0
feed_mm_rev = 0.1
spindle_rpm = 1200.0

[report]
machine = "simulated lathe (sample of trunnion)"
"""


def _pass(number: int, sign: int, depth_mm: float) -> tn.Diameters:
    z = np.linspace(64.5, 20.5, 881)
    time = (65.0 - z if sign < 0 else z) / 2.0
    error = -30.0 * (1.0 - np.exp(-time / 25.0)) + 10.0 * depth_mm * (z / 65.0) ** 3
    gauge = Gauge()
    at, read = gauge.read(z, error, feed_mm_min=1200.0, noise_um=0.5, seed=number)
    count = len(at)
    return tn.Diameters(
        {
            "z_mm": np.round(at, 3),
            "error_um": read,
            "pass": np.full(count, number),
            "feed_sign": np.full(count, sign),
            "depth_mm": np.full(count, depth_mm),
        }
    )


def make_turning(folder: Path) -> None:
    """Write program, set-up and diameters."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "part.ngc").write_text(PROGRAM, encoding="utf-8")
    (folder / "setup.toml").write_text(SETUP, encoding="utf-8")
    first, second = _pass(1, -1, 1.0), _pass(2, 1, 2.0)
    first.to_csv(folder / "diameters.csv")
    tn.Diameters.concatenate([first, second]).to_csv(folder / "passes.csv")


if __name__ == "__main__":
    SAMPLES = Path(__file__).parents[2] / "python" / "trunnion" / "samples"
    make_turning(SAMPLES / "turning")

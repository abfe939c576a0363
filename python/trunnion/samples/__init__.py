"""Sample files that come with the package.

``cross/setup.toml`` and ``cross/touches.csv``: a trt-ca table with the errors of the paper's
Table 2, simulated by ``samples/make_samples.py`` (an artefact 50 µm and 60" off its place, 0.3 µm
repeatability, 0.1 µm ticks).
``rotary/setup.toml``, ``rotary/rtest.csv``: an R-test of the machine of ``hidden``, made by the
same.
``plate/first.csv``, ``plate/second.csv``, ``axis/sweep.csv``, ``axis/arc.csv``,
``ballbar/circle.csv``, ``positioning/axis.csv``, ``levels/bed.csv``, ``levels/plate.csv``: points,
sweeps, a ball-bar test, stops of an axis and a level on a bed and on a plate, made by
``samples/make_measured.py``, which says what is in them.
``contour/setup.toml``, ``contour/axislog.csv``: a servo and a log of five axes at two feeds, made
by ``samples/make_contour.py``.
``turning/part.ngc``, ``turning/setup.toml``, ``turning/diameters.csv``, ``turning/passes.csv``: a
finishing program and what its part came out as, made by ``samples/make_turning.py``.
"""

from importlib.resources import as_file, files
from pathlib import Path

from trunnion.base.arguments import checked
from trunnion.base.checks import choose

__all__ = ["sample_path"]


@checked
def sample_path(name: str) -> Path:
    """Path of a sample, for instance ``cross/setup.toml``, or of the folder of one, ``cross``.

    Raises
    ------
    UnknownNameError
        No sample of this name.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.sample_path("cross/setup.toml").name
    'setup.toml'
    """
    with as_file(files(__name__)) as folder:
        found = [path for path in folder.glob("*/*") if path.suffix in {".toml", ".csv", ".ngc"}]
        known = sorted(str(path.relative_to(folder)) for path in found)
        groups = {path.parent.name for path in found}
        return folder / (name if name in groups else choose("sample", name, known))

"""Simulation of the contouring loop: one run, or thousands in one call."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

import trunnion._core as _core
from trunnion.base.arguments import check_fields, checked
from trunnion.base.checks import instance, numbers, positive, whole, within
from trunnion.base.errors import InputError
from trunnion.base.report import Result, Table
from trunnion.base.saved import Columns, Gridded
from trunnion.base.units import Flags, Floats
from trunnion.contouring.paths import Path
from trunnion.contouring.servo import Controller, Coupling, Servo, coupling_of
from trunnion.data.axis_log import AxisLog
from trunnion.machine.chain import Chain
from trunnion.setup import Artefact, Setup

ERRORS = (
    "contour_um",
    "orientation_arcsec",
    "following_um",
    "circle_um",
    "tangent_um",
    "proposed_arcsec",
    "tangent_arcsec",
)
"""Columns of a run that are errors."""
TOOL_FIGURES = {
    "contour_max_um": "contour max µm",
    "contour_rms_um": "contour rms µm",
    "orientation_max_arcsec": "orientation max arcsec",
    "orientation_rms_arcsec": "orientation rms arcsec",
    "following_max_um": "following max µm",
}
"""Figures of a run, with headings: errors of the tool."""
MODEL_FIGURES = {
    "circle_max_um": "circle max µm",
    "tangent_max_um": "tangent max µm",
    "proposed_max_arcsec": "proposed max arcsec",
    "tangent_max_arcsec": "tangent max arcsec",
}
"""Likewise: the models of the controllers, less the truth."""


@dataclass(frozen=True)
class Feed:
    """How fast a path is travelled.

    Attributes
    ----------
    feed_mm_min:
        Feed of the tool tip in the part's frame.
    acceleration_time_s:
        Time from rest to the feed; the acceleration is constant. 0: starts at full feed.
    decelerate:
        Slow down to rest at the end with the same acceleration. Without it, as in the paper, the
        samples end at full feed just before the end of the path.
    normal_acceleration_mm_s2:
        Largest v² times curvature; finite: the feed is reduced in curves and zero in corners.
    dwell_s:
        Rest at the end (with ``decelerate``), for the axes to settle.
    """

    feed_mm_min: float
    acceleration_time_s: float = 0.15
    decelerate: bool = False
    normal_acceleration_mm_s2: float = inf
    dwell_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the feed, in its own unit, and that a dwell follows a stop."""
        check_fields(self)
        if self.dwell_s and not self.decelerate:
            raise InputError(f"dwell_s: got {self.dwell_s:g} without decelerate, expected it too")
        positive("feed_mm_min", self.feed_mm_min)

    @property
    def core(self) -> tuple[float, float, bool, float, float]:
        """Arguments of the core."""
        return (
            float(self.feed_mm_min),
            float(self.acceleration_time_s),
            bool(self.decelerate),
            float(self.normal_acceleration_mm_s2),
            float(self.dwell_s),
        )


@dataclass(frozen=True, eq=False, repr=False)
class ContourRun(Result):
    """One simulated run: one row a control period, n in all.

    Attributes
    ----------
    controller:
        What controlled it.
    period_ms:
        Control period.
    diverged:
        The axes left the reference by more than 1000 mm or rad; rows end there.
    u:
        Path parameter of the reference samples.
    point_mm, tip_mm:
        Reference and actual tool tip in the part's frame, shape (n, 3).
    reference, commanded, actual:
        Positions of the five `axes` (mm, deg), shape (n, 5): of the path, those commanded to the
        position loops (with what the coupling adds), and the actual ones.
    foot_u:
        Path parameter of the true foot point of the tool tip: solved, not sampled.
    contour_vector_um, contour_um:
        From the tool tip to the foot point, shape (n, 3), and its length.
    orientation_arcsec:
        Angle between the tool axis and that of the path at the foot point.
    following_um:
        Distance from the tool tip to the reference sample.
    circle_um, tangent_um:
        How far the foot points of the two contour-error models are from the true one.
    proposed_arcsec, tangent_arcsec:
        How far the tool axes of the two orientation-error models are from the true one. The models
        are evaluated along this run, whatever controlled it; 0 at the first two samples.
    axes:
        Letters of the axes: X, Y, Z and the machine's rotary axes.
    """

    controller: str
    period_ms: float
    diverged: bool
    u: Floats
    point_mm: Floats
    tip_mm: Floats
    reference: Floats
    commanded: Floats
    actual: Floats
    foot_u: Floats
    contour_vector_um: Floats
    contour_um: Floats
    orientation_arcsec: Floats
    following_um: Floats
    circle_um: Floats
    tangent_um: Floats
    proposed_arcsec: Floats
    tangent_arcsec: Floats
    axes: str = "XYZAC"

    def __len__(self) -> int:
        """Count of control periods."""
        return len(self.u)

    @property
    def time_s(self) -> Floats:
        """Time of each row."""
        return np.arange(len(self), dtype=np.float64) * (self.period_ms * 1e-3)

    @property
    def figures(self) -> dict[str, float]:
        """Largest and root-mean-square errors, by name; inf where the loop diverged."""
        largest = inf if self.diverged else 0.0

        def top(values: Floats) -> float:
            return max(float(values.max(initial=0.0)), largest)

        def rms(values: Floats) -> float:
            return max(float(np.sqrt(np.mean(values**2))) if len(values) else 0.0, largest)

        return {
            "contour_max_um": top(self.contour_um),
            "contour_rms_um": rms(self.contour_um),
            "orientation_max_arcsec": top(self.orientation_arcsec),
            "orientation_rms_arcsec": rms(self.orientation_arcsec),
            "following_max_um": top(self.following_um),
            "circle_max_um": top(self.circle_um),
            "tangent_max_um": top(self.tangent_um),
            "proposed_max_arcsec": top(self.proposed_arcsec),
            "tangent_max_arcsec": top(self.tangent_arcsec),
        }

    @checked
    def axis_log(
        self,
        *,
        noise_um: float = 0.0,
        noise_arcsec: float = 0.0,
        log_delay_ms: float = 0.0,
        seed: int = 0,
        run: str | int | None = None,
    ) -> AxisLog:
        """Return what a control would log: commanded and actual axis positions.

        The commands are those that the position loops get; under cross-coupled control they are not
        those of the path. Noise is normal, 1 σ. ``log_delay_ms``: the actual positions are those of
        so much earlier (cubic interpolation between samples).

        Raises
        ------
        InputError
            Noise, delay or seed that is negative or not finite.
        """
        within("noise_um", noise_um, 0.0)
        within("noise_arcsec", noise_arcsec, 0.0)
        rng = np.random.default_rng(whole("seed", seed, 0))
        actual: Floats = self.actual
        if within("log_delay_ms", log_delay_ms, 0.0) != 0.0:
            actual = _earlier(self.time_s, actual, log_delay_ms * 1e-3)
        sigma = np.array([noise_um * 1e-3] * 3 + [noise_arcsec / 3600.0] * 2)
        actual = actual + sigma * rng.standard_normal(actual.shape)
        columns: dict[str, Any] = {"time_s": self.time_s}
        for i, letter in enumerate(self.axes):
            axis, unit = letter.lower(), "mm" if letter in "XYZ" else "deg"
            columns[f"{axis}_cmd_{unit}"] = self.commanded[:, i]
            columns[f"{axis}_act_{unit}"] = actual[:, i]
        if run is not None:
            columns["run"] = [run] * len(self)
        return AxisLog(**columns)

    def headline(self) -> str:
        """Controller, and the largest errors."""
        f = self.figures
        return (
            f"{self.controller}, {len(self)} control periods of {self.period_ms:g} ms: largest "
            f"contour error {f['contour_max_um']:.3g} µm, orientation error "
            f"{f['orientation_max_arcsec']:.3g} arcsec"
        )

    def sentences(self) -> Sequence[str]:
        """Controller, largest errors, and whether the loop diverged."""
        return (f"{self.headline()}{', diverged' if self.diverged else ''}.",)

    def tables(self) -> tuple[Table, ...]:
        """Largest and root-mean-square errors."""
        f = self.figures
        rows = (
            ("contour error µm", f["contour_max_um"], f["contour_rms_um"]),
            ("orientation error arcsec", f["orientation_max_arcsec"], f["orientation_rms_arcsec"]),
            ("following error µm", f["following_max_um"], None),
            ("circle model less truth µm", f["circle_max_um"], None),
            ("tangent model less truth µm", f["tangent_max_um"], None),
            ("proposed orientation model less truth arcsec", f["proposed_max_arcsec"], None),
            ("tangent orientation model less truth arcsec", f["tangent_max_arcsec"], None),
        )
        return (Table.of("Errors along the path", ("", "max", "rms"), rows),)

    def derived(self) -> Mapping[str, Any]:
        """The figures."""
        return {"figures": self.figures}

    def gridded(self) -> Gridded:
        """Return what `to_columns` holds, over time."""
        columns = dict(self.to_columns())
        arrays = {name: (("time_s",), np.asarray(v)) for name, v in columns.items()}
        return Gridded({"time_s": arrays.pop("time_s")[1]}, arrays, {"controller": self.controller})

    def to_columns(self) -> Columns:
        """Return one row a control period."""
        columns: dict[str, Floats] = {"time_s": self.time_s, "u": self.u}
        for name in ("point", "tip"):
            columns |= {
                f"{name}_{a}_mm": v for a, v in zip("xyz", vars(self)[f"{name}_mm"].T, strict=True)
            }
        for name in ("reference", "commanded", "actual"):
            units = zip("xyzac", ("mm",) * 3 + ("deg",) * 2, vars(self)[name].T, strict=True)
            columns |= {f"{name}_{axis}_{unit}": values for axis, unit, values in units}
        for name in ERRORS:
            columns[name] = vars(self)[name]
        return columns


def _earlier(time_s: Floats, values: Floats, delay_s: float) -> Floats:
    """Values so much earlier; before the first sample the axes rest."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(time_s, values, axis=0)
    return np.asarray(spline(np.clip(time_s - delay_s, time_s[0], time_s[-1])))


def five_axis_machine(setup: Setup | None, errors: Mapping[str, float] | None) -> _core.Machine:
    """Return the machine of a set-up (by default a ``trt-ca``) with these errors or its own.

    Raises InputError: another number of rotary axes than two; an axis that counts the other way.
    """
    chain = Chain(Setup(artefact=Artefact("none")) if setup is None else setup)
    if chain.count != 2:
        raise InputError(f"setup: got {chain.name}, expected one with two rotary axes")
    for letter, sense in zip(chain.letters, chain.senses, strict=True):
        if sense < 0:
            raise InputError(
                f"axes.{letter}.sense: got -1, expected 1: a simulation of contouring counts every "
                "axis right-handed"
            )
    return chain.machine(None if errors is None else numbers("location errors", errors))


def _path(path: Path) -> Path:
    return instance("path", path, Path, "a Path")


def period_ms(servo: Servo) -> float:
    """Return the control period; 1 ms where the servo has none."""
    period = instance("servo", servo, Servo, "a Servo").period_ms
    return 1.0 if period is None else positive("period_ms", period)


def _name(controller: Controller) -> str:
    if isinstance(controller, Coupling):
        c = controller
        labels = {"jacobian_last": ", J⁻¹ last", "as_printed": ", as printed"}
        order = labels.get(c.order, "")
        return f"coupled ({c.position}, {c.orientation}{order})"
    return controller


@checked
def simulate(
    path: Path,
    feed: Feed | float,
    *,
    controller: Controller = "proposed",
    servo: Servo | None = None,
    errors: Mapping[str, float] | None = None,
    assumed: Mapping[str, float] | None = None,
    setup: Setup | None = None,
) -> ContourRun:
    """Simulate one run of the five-axis loop along a path.

    Parameters
    ----------
    path:
        In the part's frame.
    feed:
        A `Feed`, or a feed in mm/min with the paper's 0.15 s of acceleration and no deceleration.
    controller:
        "independent", "proposed" (circle and the paper's orientation model), "existing" (circle and
        the reconstructed tangent-line orientation model), or a `Coupling`.
    servo:
        Axes; by default those of the paper's Table 1.
    errors:
        Location errors of the machine as it is (ISO names, µm and arcsec). They enter the true
        errors of the tool on the part. None: those that the set-up has.
    assumed:
        Location errors that the control knows: its reference axis positions and its error models
        use the machine with them. Identified ones take out what ``errors`` do. None: those that
        the set-up has.
    setup:
        The machine: any with two rotary axes; by default a ``trt-ca``.

    Raises
    ------
    InputError, UnknownNameError
        A parameter out of range or unknown.
    """
    servo = Servo.paper() if servo is None else servo
    coupling = coupling_of(controller)
    period = period_ms(servo)
    real, known = five_axis_machine(setup, errors), five_axis_machine(setup, assumed)
    letters = f"XYZ{real.letters}"
    columns = _core.contour_simulate(
        _path(path).core,
        (feed if isinstance(feed, Feed) else Feed(feed)).core,
        period_s=period * 1e-3,
        axes=servo.rows(letters),
        feedback=servo.feedback,
        coupling=None if coupling is None else coupling.core,
        assumed=known,
        real=real,
    )
    arrays: dict[str, Any] = dict(columns)
    return ContourRun(controller=_name(controller), period_ms=period, axes=letters, **arrays)


@dataclass(frozen=True, eq=False, repr=False)
class ContourSweep(Result):
    """Figures of many runs: one entry a combination, shape (paths, feeds, controllers).

    Attributes
    ----------
    feeds_mm_min, controllers:
        Axes of the arrays; paths are in the order given.
    steps, diverged:
        Control periods, and whether the loop diverged (its errors are inf).
    contour_max_um, contour_rms_um, orientation_max_arcsec, orientation_rms_arcsec:
        True errors.
    following_max_um:
        Following error of the tool tip.
    circle_max_um, tangent_max_um, proposed_max_arcsec, tangent_max_arcsec:
        Errors of the models along the run.
    """

    feeds_mm_min: Floats
    controllers: tuple[str, ...]
    GRID = dict.fromkeys(
        ("steps", "diverged", *TOOL_FIGURES, *MODEL_FIGURES),
        ("path", "feeds_mm_min", "controllers"),
    )

    steps: NDArray[np.int64]
    diverged: Flags
    contour_max_um: Floats
    contour_rms_um: Floats
    orientation_max_arcsec: Floats
    orientation_rms_arcsec: Floats
    following_max_um: Floats
    circle_max_um: Floats
    tangent_max_um: Floats
    proposed_max_arcsec: Floats
    tangent_max_arcsec: Floats

    def headline(self) -> str:
        """Counts, and how many diverged."""
        paths, feeds, controllers = self.steps.shape
        return (
            f"paths: {paths}, feeds: {feeds}, controllers: {controllers}; "
            f"{int(self.diverged.sum())} of {self.steps.size} runs diverged"
        )

    def sentences(self) -> Sequence[str]:
        """Counts, and how many diverged."""
        return (f"{self.headline()}.",)

    def tables(self) -> tuple[Table, ...]:
        """Errors of the tool, then those of the models; one row a path, feed and controller."""
        runs = {"steps": "steps", "diverged": "diverged"}
        return (
            self._table("Errors of the tool", TOOL_FIGURES),
            self._table("Runs, and errors of the models", runs | MODEL_FIGURES),
        )

    def _table(self, title: str, columns: Mapping[str, str]) -> Table:
        rows = [
            (
                self.controllers[k],
                i,
                f"{self.feeds_mm_min[j]:g}",
                *(vars(self)[name][i, j, k].item() for name in columns),
            )
            for i, j, k in np.ndindex(self.steps.shape)
        ]
        return Table.of(title, ("controller", "path", "feed mm/min", *columns.values()), rows)


@checked
def sweep(
    paths: Sequence[Path],
    feeds_mm_min: Sequence[float] | Floats,
    *,
    controllers: Sequence[Controller] = ("independent", "existing", "proposed"),
    servo: Servo | None = None,
    feed: Feed | None = None,
    errors: Mapping[str, float] | None = None,
    assumed: Mapping[str, float] | None = None,
    setup: Setup | None = None,
) -> ContourSweep:
    """Simulate every combination of path, feed and controller, on all cores.

    ``feed`` gives what is the same for all feeds (acceleration, deceleration, limit); other
    parameters as in `simulate`. The interpreter lock is released.
    """
    if np.ndim(feeds_mm_min) != 1:
        raise InputError(f"feeds_mm_min: got {feeds_mm_min!r}, expected a list of feeds")
    if isinstance(paths, Path):
        raise InputError("paths: got one Path, expected a sequence of them")
    servo = Servo.paper() if servo is None else servo
    common = feed or Feed(1.0)
    shape = (len(paths), len(feeds_mm_min), len(controllers))
    index = list(np.ndindex(*shape))
    couplings = [coupling_of(c) for c in controllers]
    feeds = [replace(common, feed_mm_min=f).core for f in feeds_mm_min]
    real, known = five_axis_machine(setup, errors), five_axis_machine(setup, assumed)
    rows = servo.rows(f"XYZ{real.letters}")
    names, values = _core.contour_sweep(
        [_path(p).core for p in paths],
        path_index=[i for i, _, _ in index],
        feeds=[feeds[j] for _, j, _ in index],
        period_s=period_ms(servo) * 1e-3,
        axes=np.tile(rows, (len(index), 1)),
        feedback=servo.feedback,
        couplings=[None if c is None else c.core for c in couplings],
        coupling_index=[k for _, _, k in index],
        assumed=known,
        real=real,
    )
    kinds: dict[str, type] = {"steps": np.int64, "diverged": bool}
    columns: dict[str, Any] = {
        name: values[:, i].reshape(shape).astype(kinds.get(name, np.float64))
        for i, name in enumerate(names)
    }
    return ContourSweep(
        feeds_mm_min=np.asarray(feeds_mm_min, dtype=np.float64),
        controllers=tuple(_name(c) for c in controllers),
        **columns,
    )

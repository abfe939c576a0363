"""A ball-bar on the hybrid machine: plan, what it can see, identification, choice of poses.

A reading is the distance of the tool point from a ball that rests on the table; the ball's centre
is unknown, once a set-up. Lengths and derivatives are the core's, exact.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from trunnion.base.errors import DataError, InputError
from trunnion.base.report import Table, number
from trunnion.data.ballbar import Ballbar
from trunnion.hybrid.mechanism import PAPER_ERRORS, Mechanism, error_name
from trunnion.machine.estimate import CODE, Estimate, named_combination

__all__ = [
    "BallbarIdentification",
    "Identifiability",
    "ballbar_plan",
    "choose_poses",
    "identifiability",
    "identify_ballbar",
]

Floats = NDArray[np.float64]

#: Axes of the circles: first and second coordinate; angles run from the first to the second.
PLANES: Mapping[str, tuple[int, int]] = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0), "XZ": (0, 2)}
#: Relative singular values below this are zero: the exact nulls come out at 1e-13 and less.
RANK_TOLERANCE = 1e-9
NAMED_SHARE = 0.1  # of the largest component of a combination, from which one is named
#: A direction with a smaller standard error (µm or arcsec) counts as well determined.
WELL_UM = 5.0
#: Identification leaves a combination alone that it would find no better than this (µm, arcsec).
WORTH_UM = 1000.0
#: A bar further from the modelled length than this belongs to no model, mm.
FAR_OFF_MM = 5.0
#: Readings of a set-up that place the ball's centre.
LEAST_READINGS = 3


def ballbar_plan(
    mechanism: Mechanism,
    centre_mm: ArrayLike,
    *,
    setup: int | str = 0,
    radius_mm: float = 150.0,
    direction: ArrayLike = (0.0, 0.0, -1.0),
    wrist: int = 1,
    circles: Sequence[tuple[str, float, float]] = (
        ("XY", 0.0, 360.0),
        ("XZ", -20.0, 200.0),
        ("YZ", -20.0, 200.0),
    ),
    step_deg: float = 5.0,
    both_senses: bool = True,
    repeat_first: bool = True,
    feed_mm_min: float = 1000.0,
    pause_s: float = 30.0,
    start_s: float = 0.0,
) -> Ballbar:
    """Plan circles and arcs around one ball centre; lengths are the nominal radius.

    Parameters
    ----------
    mechanism
        The nominal inverse of it gives the commanded joints.
    centre_mm
        Where the ball is believed to be, machine frame.
    setup
        Label of the set-up.
    radius_mm
        Nominal length of the bar.
    direction, wrist
        Unit vector from spindle to tool point, and branch of the wrist.
    circles
        Plane, first and last angle (deg). A vertical arc of 220° stays above the table.
    step_deg
        Between readings.
    both_senses
        Run each there and back.
    repeat_first
        Run the first circle again at the end: what drifts shows.
    feed_mm_min, pause_s, start_s
        Feed along the circle, pause between circles, time of the first reading.

    Returns
    -------
    Ballbar
        Columns `setup`, `circle` (number of the run), the joints, `sense`, `feed_mm_min`, `time_s`.

    Raises
    ------
    KinematicsError
        A point out of reach.
    """
    centre = np.asarray(centre_mm, dtype=np.float64)
    if centre.shape != (3,):
        raise InputError(f"centre_mm: got shape {centre.shape}, wanted (3,)")
    for what, value in (("radius_mm", radius_mm), ("step_deg", step_deg), ("feed", feed_mm_min)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{what}: got {value!r}, wanted more than 0")
    runs = []
    for plane, first, last in circles:
        if plane not in PLANES:
            raise InputError(f"plane of a circle: got {plane!r}, wanted one of {list(PLANES)}")
        angles = np.linspace(first, last, round(abs(last - first) / step_deg) + 1)
        runs.append((plane, angles, 1))
        if both_senses:
            runs.append((plane, angles[::-1], -1))
    if repeat_first:
        runs.append(runs[0])
    points, circle, sense, times = [], [], [], []
    clock = start_s
    for number_, (plane, angles, way) in enumerate(runs):
        i, j = PLANES[plane]
        point = np.tile(centre, (len(angles), 1))
        point[:, i] += radius_mm * np.cos(np.radians(angles))
        point[:, j] += radius_mm * np.sin(np.radians(angles))
        along = np.abs(np.radians(angles - angles[0])) * radius_mm
        points.append(point)
        circle.append(np.full(len(angles), number_))
        sense.append(np.full(len(angles), way))
        times.append(clock + along / feed_mm_min * 60.0)
        clock = float(times[-1][-1]) + pause_s
    joints = mechanism.nominal.inverse(np.vstack(points), direction, wrist=wrist)
    count = len(joints)
    return Ballbar(
        setup=np.full(count, setup),
        circle=np.concatenate(circle),
        l1_mm=joints[:, 0],
        l2_mm=joints[:, 1],
        l3_mm=joints[:, 2],
        q4_deg=joints[:, 3],
        q5_deg=joints[:, 4],
        length_mm=np.full(count, radius_mm),
        sense=np.concatenate(sense),
        feed_mm_min=np.full(count, feed_mm_min),
        time_s=np.concatenate(times),
    )


def setup_index(data: Ballbar) -> tuple[NDArray[np.intp], tuple[str, ...]]:
    """Number of the set-up of each row, and their labels in order of appearance."""
    _, first, inverse = np.unique(data.setup, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    labels = tuple(str(data.setup[first[k]]) for k in order)
    return np.asarray(rank[inverse], dtype=np.intp), labels


def joints_of(data: Ballbar) -> Floats:
    """Return the commanded joints, (n, 5).

    Raises
    ------
    DataError
        The data command coordinates, not joints.
    """
    joints = data.joints
    if joints is None:
        raise DataError(
            "ball-bar data: got no joints, wanted columns l1_mm, l2_mm, l3_mm, q4_deg, q5_deg"
        )
    return joints


def start_centres(tips: Floats, lengths_mm: Floats, index: NDArray[np.intp]) -> Floats:
    """Centre of the sphere (of each set-up) that fits tool points and lengths best, (setups, 3).

    |p|² - L² = 2 p·c - |c|² + const is linear in the centre; where the points lie in a plane the
    centre starts in it.
    """
    centres = np.zeros((int(index.max()) + 1, 3))
    for k in range(len(centres)):
        rows = index == k
        points = tips[rows]
        mean = points.mean(axis=0)
        arms = points - mean
        right = 0.5 * ((arms**2).sum(axis=1) - lengths_mm[rows] ** 2)
        design = np.column_stack([arms, np.ones(len(arms))])
        found, *_ = np.linalg.lstsq(design, right, rcond=1e-9)
        centres[k] = mean + found[:3]
    return centres


def check_near(lengths_mm: Floats, reference_mm: Floats) -> None:
    """Refuse lengths that the commanded points cannot have, whatever the ball's centre.

    Raises
    ------
    DataError
        A length more than 5 mm from the distance of the commanded point to the best centre.
    """
    off = np.abs(lengths_mm - reference_mm)
    worst = int(np.argmax(off))
    if off[worst] > FAR_OFF_MM:
        raise DataError(
            f"length_mm (row {worst}): got {lengths_mm[worst]:.4f}, wanted within "
            f"{FAR_OFF_MM:g} mm of {reference_mm[worst]:.4f}, the distance of the "
            "commanded point from the best centre"
        )


def check_enough(index: NDArray[np.intp], labels: Sequence[str]) -> None:
    """Refuse set-ups whose readings cannot place the ball.

    Raises
    ------
    DataError
        A set-up with fewer than three readings.
    """
    counts = np.bincount(index, minlength=len(labels))
    for label, count in zip(labels, counts, strict=True):
        if count < LEAST_READINGS:
            raise DataError(
                f"ball-bar: got {count} reading{'' if count == 1 else 's'} in set-up {label}, "
                f"wanted at least {LEAST_READINGS} to place the ball"
            )


def gradient_with_centres(gradient: Floats, direction: Floats, index: NDArray[np.intp]) -> Floats:
    """Columns of the errors followed by three of each centre: the latter are -direction."""
    setups = int(index.max()) + 1
    full = np.zeros((len(gradient), gradient.shape[1] + 3 * setups))
    full[:, : gradient.shape[1]] = gradient
    for axis in range(3):
        full[np.arange(len(gradient)), gradient.shape[1] + 3 * index + axis] = -direction[:, axis]
    return full


def _combination(vector: Floats, names: Sequence[str], least: float = 0.1) -> str:
    """A unit vector in parameters as text, largest first."""
    order = np.argsort(-np.abs(vector))
    kept = [k for k in order if abs(vector[k]) >= least] or [order[0]]
    sign = np.sign(vector[kept[0]])
    terms = [f"{sign * vector[k]:+.2f} {names[k]}" for k in kept]
    return " ".join(terms).lstrip("+").replace("-", "− ").replace(" +", " + ")


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What a plan can see of the errors, before anything is measured.

    Attributes
    ----------
    parameters
        Names of the errors.
    readings, setups
        Counts.
    sigma_um
        Noise of one reading that the standard errors assume.
    rank
        Of the derivative of the readings by the errors, ball centres eliminated.
    condition
        Largest over smallest non-zero singular value, columns in µm per µm or arcsec.
    singular_values
        (k,), largest first, of the same matrix.
    directions
        Right singular vectors, one a row, (k, k): combinations in order of how well they are seen.
    std_errors
        Of each error, µm or arcsec; inf for what cannot be seen.
    direction_errors
        Standard error of each combination, (k,); inf for what cannot be seen.
    """

    parameters: tuple[str, ...]
    readings: int
    setups: int
    sigma_um: float
    rank: int
    condition: float
    singular_values: Floats
    directions: Floats
    std_errors: dict[str, float]
    direction_errors: Floats

    def well_determined(self, within: float = WELL_UM) -> int:
        """Count the combinations with a standard error below this, µm or arcsec."""
        return int(np.sum(self.direction_errors < within))

    @property
    def unseen(self) -> tuple[str, ...]:
        """Combinations that the plan cannot see, as text."""
        return tuple(_combination(v, self.parameters) for v in self.directions[self.rank :])

    def table(self) -> Table:
        """Singular directions, best seen first."""
        rows = [
            (
                str(k + 1),
                number(float(self.direction_errors[k]), 3),
                _combination(self.directions[k], self.parameters, 0.3),
            )
            for k in range(len(self.parameters))
        ]
        return Table.of(
            "Combinations of errors, best seen first", ("", "std. error", "combination"), rows
        )

    def summary(self) -> str:
        """Table and sentences."""
        lines = [
            self.table().text(),
            f"{self.readings} readings of {self.sigma_um:g} µm in {self.setups} set-up(s): rank "
            f"{self.rank} of {len(self.parameters)}, condition {self.condition:.0f}, "
            f"{self.well_determined()} combinations within {WELL_UM:g} µm or arcsec.",
        ]
        lines.extend(f"Cannot be seen: {text}." for text in self.unseen)
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        lines = self.summary().splitlines()[-1 - len(self.unseen) :]
        return self.table().html() + "".join(f"<p>{html.escape(line)}</p>" for line in lines)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain Python values; infinities as strings "inf"."""
        return {
            "parameters": list(self.parameters),
            "readings": self.readings,
            "setups": self.setups,
            "sigma_um": self.sigma_um,
            "rank": self.rank,
            "condition": self.condition,
            "singular_values": self.singular_values.tolist(),
            "directions": self.directions.tolist(),
            "std_errors": {k: _plain(v) for k, v in self.std_errors.items()},
            "direction_errors": [_plain(v) for v in self.direction_errors],
            "unseen": list(self.unseen),
        }


def _plain(value: float) -> float | str:
    return float(value) if np.isfinite(value) else "inf"


@dataclass(frozen=True)
class _Spectrum:
    """Singular values and directions of a design with its ball centres eliminated."""

    values: Floats
    directions: Floats
    rank: int

    @classmethod
    def of(cls, full: Floats, errors: int) -> _Spectrum:
        own, centres = full[:, :errors], full[:, errors:]
        # Orthonormal basis of the centres' columns; what they explain is taken off.
        u, s, _ = np.linalg.svd(centres, full_matrices=False)
        basis = u[:, s > 1e-10 * s[0]]
        rest = own - basis @ (basis.T @ own)
        _, values, directions = np.linalg.svd(rest, full_matrices=True)
        padded = np.zeros(errors)
        padded[: len(values)] = values
        rank = int(np.sum(padded > RANK_TOLERANCE * max(float(padded[0]), 1e-300)))
        return cls(padded, directions, rank)

    def down_to(self, least: float) -> _Spectrum:
        """Count only combinations with at least this singular value."""
        return _Spectrum(self.values, self.directions, int(np.sum(self.values > least)))

    def in_terms_of(self, outer: _Spectrum) -> _Spectrum:
        """From the coordinates of another spectrum's seen combinations to parameters."""
        directions = outer.directions.copy()
        directions[: outer.rank] = self.directions @ outer.directions[: outer.rank]
        return _Spectrum(np.append(self.values, outer.values[outer.rank :]), directions, self.rank)

    def direction_errors(self, sigma: float) -> Floats:
        """Sigma over the singular values; inf beyond the rank."""
        out = np.full(len(self.values), np.inf)
        out[: self.rank] = sigma / self.values[: self.rank]
        return out

    def covariance(self, sigma: float) -> Floats:
        """Of the part that can be seen."""
        seen = self.directions[: self.rank]
        return np.asarray((seen.T / self.values[: self.rank] ** 2) @ seen * sigma**2)

    def std_errors(self, sigma: float) -> Floats:
        """Of each parameter; inf where it has a share in what cannot be seen."""
        errors = np.sqrt(np.diag(self.covariance(sigma)))
        hidden = np.abs(self.directions[self.rank :]).max(axis=0, initial=0.0) > 1e-6
        return np.where(hidden, np.inf, errors)


def identifiability(
    plan: Ballbar,
    mechanism: Mechanism,
    *,
    parameters: Sequence[str] = PAPER_ERRORS,
    sigma_um: float = 0.5,
    threads: int | None = 1,
) -> Identifiability:
    """Say what ball-bar readings at these poses can tell of the errors.

    Parameters
    ----------
    plan
        Commanded joints and set-ups; `length_mm` is the nominal radius.
    mechanism
        The machine around which derivatives are taken.
    parameters
        Errors to estimate; the paper's 17 by default.
    sigma_um
        Noise of one reading (1 σ).

    Raises
    ------
    DataError
        No joints in the plan.
    InputError
        `sigma_um` not above 0.
    """
    names = tuple(error_name(p) for p in parameters)
    if not (np.isfinite(sigma_um) and sigma_um > 0):
        raise InputError(f"sigma_um: got {sigma_um!r}, wanted more than 0")
    joints = joints_of(plan)
    index, labels = setup_index(plan)
    tips = mechanism.forward(joints, threads=threads).tip_mm
    centres = start_centres(tips, plan.length_mm, index)
    _, direction, gradient = mechanism.ballbar(joints, centres[index], names, threads=threads)
    spectrum = _Spectrum.of(gradient_with_centres(gradient, direction, index), len(names))
    return Identifiability(
        parameters=names,
        readings=len(plan),
        setups=len(labels),
        sigma_um=sigma_um,
        rank=spectrum.rank,
        condition=float(spectrum.values[0] / spectrum.values[spectrum.rank - 1]),
        singular_values=spectrum.values,
        directions=spectrum.directions,
        std_errors=dict(zip(names, map(float, spectrum.std_errors(sigma_um)), strict=True)),
        direction_errors=spectrum.direction_errors(sigma_um),
    )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class BallbarIdentification(Estimate):
    """Errors of the hybrid machine estimated from ball-bar readings: an :class:`Estimate`.

    Of combinations that are not identifiable, the smallest change from the nominal machine is
    taken; the covariance is that of the part that is.

    Attributes
    ----------
    centres_mm
        Ball centre of each set-up.
    residuals_um
        Measured minus modelled length, (n,).
    rank
        Combinations of errors that were determined.
    converged
        Whether the last step was within rounding.
    mechanism
        The machine with the estimated errors.
    """

    centres_mm: dict[str, tuple[float, float, float]]
    residuals_um: Floats
    rank: int
    converged: bool
    mechanism: Mechanism = field(metadata=CODE)

    @property
    def rms_um(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals_um**2)))

    def sentences(self) -> list[str]:
        """What is worth saying beside the table."""
        lines = [
            f"{len(self.residuals_um)} readings, {self.degrees_of_freedom:g} degrees of freedom, "
            f"residuals {self.rms_um:.4f} µm rms, one reading {self.sigma_um:.4f} µm (1 σ); "
            f"{self.rank} of {len(self.errors)} combinations determined."
        ]
        if not self.converged:
            lines.append("Did NOT converge: do not use these numbers.")
        return [*lines, *super().sentences()]


def identify_ballbar(
    data: Ballbar,
    mechanism: Mechanism,
    *,
    parameters: Sequence[str] = PAPER_ERRORS,
    sigma_um: float | None = None,
    tolerance: float | None = None,
    threads: int | None = 1,
) -> BallbarIdentification:
    """Estimate errors and ball centres from ball-bar readings: least squares on the exact model.

    Parameters
    ----------
    data
        Readings with commanded joints.
    mechanism
        The nominal machine; errors that it has are where the search starts, and estimates are
        totals that include them.
    parameters
        Errors to estimate.
    sigma_um
        Noise of one reading if known; else from the residuals.
    tolerance
        What is known beforehand: each error is within this (1 σ, µm or arcsec) of the machine's
        own. It must come with `sigma_um`, which weighs readings against it. Then every error has
        an estimate. None: the readings alone decide.
    threads
        For the forward solutions.

    Raises
    ------
    DataError
        Fewer readings than unknowns, no joints, or lengths more than 5 mm from what the joints
        allow.
    InputError
        `tolerance` without `sigma_um`, or values not above 0.
    """
    names = tuple(error_name(p) for p in parameters)
    if tolerance is not None and sigma_um is None:
        raise InputError("tolerance: got no sigma_um with it, wanted the noise of a reading")
    for what, value in (("tolerance", tolerance), ("sigma_um", sigma_um)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"{what}: got {value!r}, wanted more than 0")
    joints = joints_of(data)
    index, labels = setup_index(data)
    count, setups = len(names), len(labels)
    unknowns = count + 3 * setups
    if tolerance is None and len(data) <= unknowns:
        raise DataError(f"ball-bar: got {len(data)} readings, wanted more than {unknowns} unknowns")
    start_errors = np.array([mechanism.errors.get(name, 0.0) for name in names])
    rest = {k: v for k, v in mechanism.errors.items() if k not in names}
    tips = mechanism.forward(joints, threads=threads).tip_mm
    centres = start_centres(tips, data.length_mm, index)
    measured = data.length_mm
    placed = np.bincount(index)[index] > LEAST_READINGS
    if placed.any():
        near = np.linalg.norm(tips - centres[index], axis=1)
        check_near(np.where(placed, measured, near), near)

    def machine(x: Floats) -> Mechanism:
        return mechanism.with_errors(rest | dict(zip(names, map(float, x[:count]), strict=True)))

    def where(x: Floats) -> Floats:
        return centres + x[count:].reshape(setups, 3) * 1e-3

    weight = 0.0 if tolerance is None or sigma_um is None else sigma_um / tolerance

    def residuals(x: Floats) -> Floats:
        length, _, _ = machine(x).ballbar(joints, where(x)[index], (), threads=threads)
        held = weight * (x[:count] - start_errors)
        return np.concatenate([(length - measured) * 1e3, held])

    def jacobian(x: Floats) -> Floats:
        _, direction, gradient = machine(x).ballbar(joints, where(x)[index], names, threads=threads)
        held = np.zeros((count, unknowns))
        held[:, :count] = weight * np.eye(count)
        return np.vstack([gradient_with_centres(gradient, direction, index), held])

    # The search goes along what the readings can tell, each combination scaled to one noise; a
    # combination that cannot be told stays where it is.
    start = np.concatenate([start_errors, np.zeros(3 * setups)])
    plan = _Spectrum.of(jacobian(start), count).down_to((sigma_um or 1.0) / WORTH_UM)
    way = np.zeros((unknowns, plan.rank + 3 * setups))
    way[:count, : plan.rank] = plan.directions[: plan.rank].T / plan.values[: plan.rank]
    way[count:, plan.rank :] = np.eye(3 * setups)

    def rest_along(z: Floats) -> Floats:
        return residuals(start + way @ z)

    def slope_along(z: Floats) -> Floats:
        return np.asarray(jacobian(start + way @ z) @ way)

    found = optimize.least_squares(
        rest_along,
        np.zeros(way.shape[1]),
        jac=slope_along,
        x_scale="jac",
        method="lm",
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-12,
    )
    x = start + way @ np.asarray(found.x)
    seen = plan.directions[: plan.rank]
    full = jacobian(x)
    spectrum = _Spectrum.of(
        np.hstack([full[:, :count] @ seen.T, full[:, count:]]), plan.rank
    ).in_terms_of(plan)
    left = -residuals(x)[: len(data)]
    freedom = len(data) - 3 * setups - (plan.rank if tolerance is None else 0)
    sigma = sigma_um if sigma_um is not None else float(np.sqrt(left @ left / max(freedom, 1)))
    hidden = plan.directions[plan.rank :]
    final = where(x)
    return BallbarIdentification(
        errors=dict(zip(names, map(float, x[:count]), strict=True)),
        std_errors=dict(zip(names, map(float, spectrum.std_errors(sigma)), strict=True)),
        names=names,
        covariance=spectrum.covariance(sigma),
        centres_mm={
            label: (float(c[0]), float(c[1]), float(c[2]))
            for label, c in zip(labels, final, strict=True)
        },
        residuals_um=left,
        sigma_um=sigma,
        degrees_of_freedom=freedom,
        rank=spectrum.rank,
        combinations=tuple(named_combination(names, v, NAMED_SHARE) for v in hidden),
        converged=bool(found.success),
        mechanism=machine(x),
    )


def choose_poses(
    candidates: Ballbar,
    mechanism: Mechanism,
    count: int,
    *,
    parameters: Sequence[str] = PAPER_ERRORS,
    sigma_um: float = 0.5,
    tolerance: float = 100.0,
    blocks: ArrayLike | None = None,
    threads: int | None = 1,
) -> NDArray[np.intp]:
    """Choose readings by D-optimality: the largest determinant of the errors' information.

    Each reading (or block) is added where the determinant grows most, then exchanged as long as
    that helps. Ball centres are unknown; errors are known to `tolerance` beforehand, so that the
    determinant exists before they are all seen.

    Parameters
    ----------
    candidates
        Poses to choose from, set-ups labelled.
    mechanism
        The machine around which derivatives are taken.
    count
        How many readings, or blocks, to choose.
    parameters, sigma_um, tolerance
        Errors that matter, noise of a reading, what is known beforehand (µm, arcsec).
    blocks
        Label of the block of each candidate, (n,): chosen as a whole (a circle, a set-up). None:
        every reading is its own.

    Returns
    -------
    ndarray of int
        Rows of `candidates`, in order: ``candidates[rows]`` is the plan.
    """
    names = tuple(error_name(p) for p in parameters)
    joints = joints_of(candidates)
    index, labels = setup_index(candidates)
    label = np.arange(len(candidates)) if blocks is None else np.asarray(blocks)
    if label.shape != (len(candidates),):
        raise InputError(f"blocks: got shape {label.shape}, wanted ({len(candidates)},)")
    kinds, block = np.unique(label, return_inverse=True)
    if not 1 <= count <= len(kinds):
        raise InputError(f"count: got {count}, wanted 1 to {len(kinds)}")
    tips = mechanism.forward(joints, threads=threads).tip_mm
    centres = start_centres(tips, candidates.length_mm, index)
    _, direction, gradient = mechanism.ballbar(joints, centres[index], names, threads=threads)
    rows = gradient_with_centres(gradient, direction, index) / sigma_um
    # A centre is known to a millimetre before it is measured: next to nothing.
    known = np.concatenate([np.full(len(names), tolerance), np.full(3 * len(labels), 1000.0)])
    members = [np.flatnonzero(block == k) for k in range(len(kinds))]
    chosen = _exchange([rows[m] for m in members], np.diag(1 / known**2), count)
    return np.sort(np.concatenate([members[k] for k in chosen]))


def _exchange(blocks: Sequence[Floats], information: Floats, count: int) -> list[int]:
    """Greedy choice of blocks, then exchanges, for the largest determinant."""
    rows = np.vstack(blocks)
    single = len(rows) == len(blocks)

    def gains(matrix: Floats, among: Sequence[int]) -> Floats:
        """Growth of the logarithm of the determinant by each block on top of a matrix."""
        inverse = np.linalg.inv(matrix)
        if single:
            own = rows[among]
            return np.asarray(np.log1p(np.sum((own @ inverse) * own, axis=1)))
        inner = [np.eye(len(blocks[k])) + blocks[k] @ inverse @ blocks[k].T for k in among]
        return np.array([np.linalg.slogdet(m)[1] for m in inner])

    free = list(range(len(blocks)))
    chosen: list[int] = []
    current = information.copy()
    for _ in range(count):
        best = free.pop(int(np.argmax(gains(current, free))))
        chosen.append(best)
        current += blocks[best].T @ blocks[best]
    for _ in range(3):
        better = False
        for place, old in enumerate(chosen if free else ()):
            without = current - blocks[old].T @ blocks[old]
            own, *others = gains(without, [old, *free])
            at = int(np.argmax(others))
            if others[at] > own + 1e-9:
                best = free[at]
                chosen[place], free[at] = best, old
                current = without + blocks[best].T @ blocks[best]
                better = True
        if not better:
            break
    return chosen

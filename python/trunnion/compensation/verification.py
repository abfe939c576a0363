"""A ball held at one point of the table: where the control finds it at every posture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import whole
from trunnion.base.errors import DataError, InputError
from trunnion.base.report import Cell, Result, Table, rough
from trunnion.base.units import ARCSEC, Floats
from trunnion.compensation.control import ModelCompensation
from trunnion.compensation.machine import NOMINAL, MachineErrors
from trunnion.compensation.uncertainty import draw_changes, freedom_of, taking_part
from trunnion.data.distinct import distinct_rows, given_again
from trunnion.data.frame import COLUMNS, listed
from trunnion.data.mistaken import of_each
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import Estimate
from trunnion.probing.identify import mistakes_of
from trunnion.probing.model import known_sigma_um, stops_of
from trunnion.probing.on_table import on_table
from trunnion.setup import Setup

LEVEL = 0.95
ROUNDS = 20
SETTLED_MM = 1e-10
MAX_DRAWS = 100_000
SHOWN_UM = 0.005
"""Sizes below it are shown as 0.00."""
FAR_BEYOND = 3.0
"""Times as much as is expected, from which what is left is asked for a shift of an axis."""
MOVED = "{name} was {before} and is {after}"


@dataclass(frozen=True, eq=False, repr=False)
class BallVerification(Result):
    """Where a ball on the table was found at postures of the rotary axes, before and after.

    Attributes
    ----------
    rotary_deg
        Letter → position at each posture, control's sign, (n,).
    after_um
        Place of the ball's centre at each posture less the mean of all, table's frame, (n, 3).
    before_um
        The same of the measurement before the corrections; None without one.
    sigma_um
        Standard deviation of one reading after the corrections.
    touches_um
        Interval (95 %) of the largest distance that touches alone would leave.
    forecast_um
        The same for touches and the uncertainty of the estimate; None without an estimate.
    mistakes
        What is likely wrong with the touches or the set-up, as a diagnosis names it, or why more is
        left than was to be expected.
    notes
        Sentences on what the control did while it measured.
    """

    rotary_deg: Mapping[str, Floats]
    after_um: Floats
    before_um: Floats | None
    sigma_um: float
    touches_um: tuple[float, float]
    forecast_um: tuple[float, float] | None = None
    mistakes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def max_after_um(self) -> float:
        """Largest distance from the mean place, after."""
        return _largest(self.after_um)

    @property
    def max_before_um(self) -> float | None:
        """Largest distance from the mean place, before."""
        return None if self.before_um is None else _largest(self.before_um)

    @property
    def as_forecast(self) -> bool | None:
        """Whether the largest distance lies in the forecast; None without one."""
        if self.forecast_um is None:
            return None
        return self.forecast_um[0] <= self.max_after_um <= self.forecast_um[1]

    def sentences(self) -> Sequence[str]:
        """Before, after, forecast, and what the control did."""
        return (*self.verdict(), *self.notes)

    def verdict(self) -> tuple[str, ...]:
        """Return what is likely wrong, then what was found before and after, and the forecast."""
        after, before = self.max_after_um, self.max_before_um
        lines = [
            f"The ball's centre lies within {after:.2f} µm of its mean place at "
            f"{len(self.after_um)} postures (rms {_rms(self.after_um):.2f} µm)."
        ]
        if before is not None and self.before_um is not None:
            lines.append(
                f"Before the corrections: {before:.2f} µm (rms {_rms(self.before_um):.2f} µm)"
                f"{_times(before, after)}."
            )
        low, high = self.touches_um
        lines.append(f"The touches alone leave {low:.2f} to {high:.2f} µm (95 %).")
        if self.forecast_um is not None:
            low, high = self.forecast_um
            found = "as found" if self.as_forecast else "which does not hold"
            lines.append(
                f"Forecast with the uncertainty of the estimate: {low:.2f} to {high:.2f} µm "
                f"(95 %), {found}."
            )
            if after > high:
                lines.append(
                    "More is left than the estimate leaves: are the corrections loaded and on, is "
                    "the place of the table that of the set-up, are there effects that the "
                    "estimate does not have (trunnion diagnose)?"
                )
        return (*self.mistakes, *lines)

    def tables(self) -> tuple[Table, ...]:
        """Every posture."""
        names = [*self.rotary_deg, *(("before",) if self.before_um is not None else ())]
        rows: list[tuple[Cell, ...]] = []
        for i, place in enumerate(self.after_um):
            row: list[Cell] = [float(values[i]) for values in self.rotary_deg.values()]
            if self.before_um is not None:
                row.append(float(np.linalg.norm(self.before_um[i])))
            rows.append((*row, float(np.linalg.norm(place)), *map(float, place)))
        head = (*names, "after", "X", "Y", "Z")
        return (Table.of("Distance from the mean place, µm; after: in X, Y, Z", head, rows),)

    def derived(self) -> Mapping[str, Any]:
        """Largest distances, and whether the forecast holds."""
        return {
            "max_after_um": self.max_after_um,
            "max_before_um": self.max_before_um,
            "as_forecast": self.as_forecast,
        }


@checked
def verify_ball(
    after: Touches,
    setup: Setup,
    *,
    before: Touches | None = None,
    estimate: Estimate | None = None,
    draws: int = 4000,
    seed: int = 0,
) -> BallVerification:
    """Judge corrections by a ball on the table: it must not move when the rotary axes do.

    Parameters
    ----------
    after
        Touches of a sphere with the corrections on: of a program with ``tcp=True``
        (:func:`read_table_log`) or with ``corrected=True``.
    setup
        Machine, sphere and probe.
    before
        The same plan measured without the corrections.
    estimate
        What the corrections were made from: gives the forecast. One that no compensation is made
        of is refused as a compensation refuses it.
    draws, seed
        Of the intervals.

    Notes
    -----
    Each posture gives a place of the ball's centre in the table's frame, all together one radius
    (pre-travel that is equal in all directions is in it). The mean place takes off where the ball
    stands. Pre-travel that differs between the spindle's direction and the others turns with the
    table, and stays.

    Raises
    ------
    InputError
        An artefact that is no sphere; an estimate without covariance.
    DataError
        Touches off the modelled ball, with the likely cause; one posture only; a posture whose
        touches do not give the centre; `before` at other postures than `after`, with the same
        readings, or with another shift of a rotary axis by the work offset; an estimate of what
        corrections leave.

    Examples
    --------
    >>> import trunnion as tn
    >>> ball = tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(30.0, 20.0, 60.0))
    >>> setup = tn.Setup(ball)
    >>> plan = tn.plan(setup, c_deg=(0, 120, 240), a_deg=(40, -40))
    >>> free, wrong = tn.simulate(plan, setup), tn.simulate(plan, setup, errors={"EX0C": 20.0})
    >>> found = tn.verify_ball(free, setup, before=wrong)
    >>> round(found.max_before_um or 0.0), found.max_after_um < 0.001
    (25, True)
    """
    if setup.artefact.kind != "sphere":
        raise InputError(f"artefact: got a {setup.artefact.kind}, expected a sphere on the table")
    whole("draws", draws, 100, MAX_DRAWS)
    whole("seed", seed, 0)
    given = {"after": after} if before is None else {"before": before, "after": after}
    mistakes = of_each({name: mistakes_of(touches, setup) for name, touches in given.items()})
    if before is not None:
        _check_pair(before, after)
    places = {name: _places(touches, setup, name) for name, touches in given.items()}
    found, earlier = places["after"], places.get("before")
    random = np.random.default_rng(seed)
    noise = _noise(found, random, draws)
    left, forecast = found.deviations_um, None
    mean, rotary = found.centres.mean(axis=0), found.postures
    if estimate is not None:
        moved = _left(setup, estimate, mean, rotary, random, draws)
        forecast = _interval(noise + moved)
    if not mistakes:
        most = _interval(noise)[1] if forecast is None else forecast[1]
        mistakes = tuple(_shifts(setup, left, mean, rotary, most))
    if earlier is not None:
        mistakes += tuple(_worse(earlier, left, noise - _noise(earlier, random, draws)))
    return BallVerification(
        rotary_deg=found.rotary_deg,
        after_um=left,
        before_um=None if earlier is None else earlier.deviations_um,
        sigma_um=found.sigma_um,
        touches_um=_interval(noise),
        forecast_um=forecast,
        mistakes=mistakes,
        notes=(
            *(f"{name}: {said}" for name, place in places.items() for said in place.notes),
            *_of_frames(before, after),
        ),
    )


@dataclass(frozen=True)
class _Places:
    """Centres at postures, mm (n, 3); their covariance, µm² (3 n, 3 n), and what it rests on.

    rotary_deg: Letter → position at each posture, (n,). notes: Rows that were left out.
    """

    rotary_deg: dict[str, Floats]
    centres: Floats
    covariance: Floats
    sigma_um: float
    freedom: float
    notes: tuple[str, ...]

    @property
    def postures(self) -> Floats:
        """Positions of the rotary axes, (n, k)."""
        return np.column_stack([np.round(v, 3) for v in self.rotary_deg.values()])

    @property
    def deviations_um(self) -> Floats:
        """Centres less their mean, (n, 3)."""
        return np.asarray(1e3 * (self.centres - self.centres.mean(axis=0)))


def _places(given: Touches, setup: Setup, what: str) -> _Places:
    """Centres in the table's frame and one radius by least squares."""
    touches, _, _, repeated = distinct_rows(given)
    stops = stops_of(touches)
    count = int(stops.max()) + 1
    first = np.unique(stops, return_index=True)[1]
    seen = on_table(touches, setup)
    assert setup.artefact.diameter_mm is not None
    radius = setup.artefact.diameter_mm / 2 + setup.probe.ball_radius_mm
    contact = seen.position_mm + radius * seen.direction
    centres = np.array([contact[stops == i].mean(axis=0) for i in range(count)])
    jacobian = np.zeros((len(touches), 3 * count + 1))
    jacobian[:, -1] = -1.0
    for _ in range(ROUNDS):
        away = seen.position_mm - centres[stops]
        far = np.linalg.norm(away, axis=1)
        for axis in range(3):
            jacobian[np.arange(len(touches)), 3 * stops + axis] = -away[:, axis] / far
        step, _, rank, _ = np.linalg.lstsq(jacobian, radius - far, rcond=1e-9)
        if rank < jacobian.shape[1] or count < 2:
            raise DataError(
                f"{what}: got {len(touches)} touches at {count} postures, expected two postures or "
                "more and, at each, touches from sides enough to give the centre of the ball"
            )
        centres += step[:-1].reshape(count, 3)
        radius += float(step[-1])
        if np.abs(step).max() < SETTLED_MM:
            break
    left = 1e3 * (np.linalg.norm(seen.position_mm - centres[stops], axis=1) - radius)
    freedom, sigma = float(len(left) - jacobian.shape[1]), known_sigma_um(setup, touches)
    if sigma > 0:
        freedom = np.inf
    elif freedom > 0:
        sigma = float(np.sqrt(left @ left / freedom))
    else:
        raise DataError(
            f"{what}: got as many touches as unknowns, expected more, or a repeatability"
        )
    covariance = np.asarray(sigma**2 * np.linalg.inv(jacobian.T @ jacobian)[:-1, :-1], np.float64)
    rotary = {k.upper(): v[first] for k, v in touches.rotary_deg.items()}
    return _Places(rotary, centres, covariance, sigma, freedom, repeated)


def _noise(found: _Places, random: np.random.Generator, draws: int) -> Floats:
    """Deviations of the centres by the noise of touches alone, µm, (draws, n, 3)."""
    blocks = draw_changes(random, found.covariance, found.freedom, draws)
    return np.concatenate(list(blocks)).reshape(draws, -1, 3)


def _left(
    setup: Setup,
    estimate: Estimate,
    point: Floats,
    rotary: Floats,
    random: np.random.Generator,
    draws: int,
) -> Floats:
    """Deviations by errors of the estimate alone, µm, (draws, n, 3)."""
    if not estimate.names:
        raise InputError("estimate: got one without covariance, expected it for the forecast")
    try:
        known = MachineErrors.to_compensate(setup, estimate)
    except DataError as error:
        raise DataError(
            f"estimate: expected the one that the corrections were made from, got {error}"
        ) from None
    index, numbers = taking_part(setup, known, estimate.names)
    covariance = estimate.covariance[np.ix_(index, index)]
    assumed, zeros = ModelCompensation(known).control_model(setup)
    rows = np.ascontiguousarray(rotary * Chain(setup).senses)
    rates = known.core(setup).truth_rates(assumed, zeros, rows).reshape(len(rows), -1, 3, 4)
    by = rates[:, numbers] @ np.append(point, 1.0)
    blocks = draw_changes(random, covariance, freedom_of(setup, estimate), draws)
    return np.concatenate([np.einsum("dp,kpi->dki", block, by) for block in blocks])


def _worse(before: _Places, left: Floats, noise: Floats) -> Iterator[str]:
    """Say that more is left than was before, where touches alone (draws of both) do not make it."""
    least = max(_interval(noise)[1], SHOWN_UM)
    if _largest(left) - _largest(before.deviations_um) > least:
        yield (
            "More is left than there was before the corrections: were the two files swapped, are "
            "signs of the corrections turned, or are they those of another machine?"
        )


def _shifts(
    setup: Setup, left: Floats, point: Floats, rotary: Floats, most_um: float
) -> Iterator[str]:
    """Name the rotary axes of which a shift would do what is left far beyond `most_um`.

    left: µm, (n, 3). point: Mean place of the ball, mm, (3,). rotary: Control's sign, (n, k).
    """
    size, chain = _largest(left), Chain(setup)
    if size < FAR_BEYOND * most_um:
        return
    core = NOMINAL.core(setup)
    names = [name for name, _ in core.parameters]
    assumed, zeros = ModelCompensation(NOMINAL).control_model(setup)
    rates = core.truth_rates(assumed, zeros, np.ascontiguousarray(rotary * chain.senses))
    rates = rates.reshape(len(rotary), len(names), 3, 4) @ np.append(point, 1.0)
    for letter in chain.letters:
        zero = f"E{letter}0{letter}"
        if zero not in names:
            continue
        rate = -rates[:, names.index(zero)]  # the ball is found where the machine is not
        rate = rate - rate.mean(axis=0)
        turn = float(np.sum(rate * left) / np.sum(rate**2)) if np.any(rate) else 0.0
        # What is linear here is wrong by about the turn times as much.
        if _largest(left - turn * rate) <= most_um + abs(turn) * ARCSEC * size:
            said = f"{rough(turn, 4, signed=True)} arcsec ({rough(turn / 3600, 3)} deg)"
            yield (
                f"What is left is what {zero} = {said} alone does: did the work "
                f"offset shift {letter}, was the axis homed anew, or is the "
                "correction of this error not in force?"
            )


def _check_pair(before: Touches, after: Touches) -> None:
    """Refuse touches that are no pair: given twice, of other postures, of frames that do not fit.

    Of frames: without corrections after those with them, and rotary axes shifted between.
    """
    _check_postures(before, after)
    if given_again([before, after]):
        raise DataError(
            f"{_named('before', before)}: got the same readings in every row as "
            f"{_named('after', after)}, expected two measurements: was one file given twice?"
        )
    one, other = before.control_frame, after.control_frame
    if one is None or other is None:
        return
    if one.corrected and other.corrected is False:
        raise DataError(
            "control_corrected: got touches before with the control's corrections on and those "
            "after without, expected the other way round: were the two files swapped?"
        )
    shifted = one.differences(other, [name for name in COLUMNS if name.endswith("_deg")])
    if shifted:
        said = listed(shifted, "{name}: got {after} after, expected {before} as before")
        raise DataError(
            f"{said}: the work offset shifts the axis otherwise, so that it stood elsewhere at the "
            "same positions and the ball moved by more than the corrections moved it. Measure both "
            "with one work offset"
        )


def _of_frames(before: Touches | None, after: Touches) -> Iterator[str]:
    """Say where the control measured otherwise than a verification takes it to have."""
    frame = after.control_frame
    if frame is None:
        return
    if frame.corrected is False:
        yield (
            "control_corrected is 0 after: the touches were made without the control's "
            "corrections (trunnion program without --tcp and --corrected), so that only what acts "
            "without them (COMP_FILE, HOME_OFFSET, the work offset) is verified."
        )
    earlier = None if before is None else before.control_frame
    places = [*(f"wcs_{x}_mm" for x in "xyz"), "tool_length_mm"]
    if moved := [] if earlier is None else earlier.differences(frame, places):
        said = listed(moved, "{name} was {before} before and is {after} after", MOVED)
        yield (
            f"{said}: what another place of the work offset or tool length does is in the "
            "difference, beside what the corrections do."
        )


def _check_postures(before: Touches, after: Touches) -> None:
    """Refuse touches of which one has postures of the rotary axes that the other has not."""
    mine, theirs = ({*map(tuple, _rotary(one).tolist())} for one in (before, after))
    alone = {"before": sorted(mine - theirs), "after": sorted(theirs - mine)}
    letters = [letter.upper() for letter in after.rotary_deg]
    said = [
        " ".join(f"{letter} {at:.6g}" for letter, at in zip(letters, some[0], strict=True))
        + f"{f' and {len(some) - 1} more are' if len(some) > 1 else ' is'} in {name} alone"
        for name, some in alone.items()
        if some
    ]
    if said:
        raise DataError(
            f"{_named('before', before)}: got {len(mine)} postures, expected the {len(theirs)} of "
            f"{_named('after', after)}, as both are logs of one plan: {'; '.join(said)}"
        )


def _rotary(touches: Touches) -> Floats:
    return np.column_stack([np.round(v, 3) for v in touches.rotary_deg.values()])


def _times(before: float, after: float) -> str:
    """How many times what is left was there before; empty where as good as nothing is left."""
    if after < SHOWN_UM:
        return ""
    times = before / after
    return f", {f'{times:.0f}' if times >= 10 else f'{times:.2g}'} times as much"


def _named(what: str, touches: Touches) -> str:
    """Return what a measurement is called, with its files."""
    files = touches.origin.names if touches.origin else ()
    return f"{what} ({' and '.join(files)})" if files else what


def _interval(drawn: Floats) -> tuple[float, float]:
    sizes = np.linalg.norm(drawn - drawn.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    low, high = np.quantile(sizes, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return float(low), float(high)


def _largest(places: Floats) -> float:
    return float(np.linalg.norm(places, axis=1).max())


def _rms(places: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(places**2, axis=1))))

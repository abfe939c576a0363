"""The gauge that reads the part: range, resolution, sampling rate and response (2.3(6), 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trunnion.base.arguments import check_fields, checked
from trunnion.base.checks import count_of, line, positive, whole, within
from trunnion.base.errors import DataError, InputError
from trunnion.base.units import Floats


@dataclass(frozen=True)
class Gauge:
    """An electric micrometer on the tool post.

    It touches one side of the part, so that half of a diameter's error moves its stylus, and it
    rides on the slides that cut: what the slides do on the way is in the part and in the gauge's
    own path alike, and is not measured.

    Parameters
    ----------
    range_um
        Travel of the stylus; it is set to the middle on the nominal surface.
    resolution_um
        Step of the reading, of the stylus: 0.5 µm is 1 µm on the diameter.
    rate_hz
        Samples a second that are stored with the position.
    response_s
        Time constant of the stylus and its filter.
    cycle_ms
        Period of the control in which it gives the position: a stored place is that of its last
        cycle, up to feed times this behind, half of it on average; 0: it is exact.
    """

    range_um: float = 150.0
    resolution_um: float = 0.5
    rate_hz: float = 50.0
    response_s: float = 0.02
    cycle_ms: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("range_um", "rate_hz"):
            positive(name, getattr(self, name))
        for name in ("resolution_um", "response_s", "cycle_ms"):
            within(name, getattr(self, name), 0.0)

    @checked
    def tick_mm(self, feed_mm_min: float) -> float:
        """Distance between two places that the control gives: feed times its cycle time."""
        return positive("feed_mm_min", feed_mm_min) / 60.0 * 1e-3 * self.cycle_ms

    @checked
    def feed_limit_mm_min(
        self, pitch_mm: float, *, slope_um_mm: float = 0.0, lag_um: float = 1.0
    ) -> float:
        """Fastest measuring feed.

        Parameters
        ----------
        pitch_mm
            Distance expected between readings: feed <= pitch · rate.
        slope_um_mm
            Steepest change of the diameter error along z that is to be followed.
        lag_um
            How far the reading of the diameter may lag on it: feed <= lag / (slope · response).
        """
        limit = positive("pitch_mm", pitch_mm) * self.rate_hz
        lag = positive("lag_um", lag_um)
        if (growth := within("slope_um_mm", slope_um_mm, 0.0) * self.response_s) > 0:
            limit = min(limit, lag / growth)
        return 60.0 * limit

    @checked
    def read(
        self,
        z_mm: npt.ArrayLike,
        error_um: npt.ArrayLike,
        *,
        feed_mm_min: float,
        noise_um: float = 0.0,
        seed: int | None = None,
    ) -> tuple[Floats, Floats]:
        """Give what the gauge stores on one interval.

        Parameters
        ----------
        z_mm, error_um
            The error of the diameter along the interval, in the order of travel, straight between
            the places given.
        feed_mm_min
            Measuring feed.
        noise_um
            Standard deviation of one reading of the diameter, before rounding.
        seed
            Of the noise.

        Returns
        -------
        z_mm, error_um : ndarray
            Places and readings, feed / rate apart, the first at the start of the interval.

        Raises
        ------
        trunnion.DataError
            If the stylus leaves its range; the message has the place.
        """
        z, error = line("z_mm", z_mm), line("error_um", error_um)
        way = np.abs(z - z[:1])
        if not 0 < z.size == error.size or (np.diff(way) <= 0).any():
            raise InputError(
                f"z_mm, error_um: got {z.size} and {error.size}, expected equally many places in "
                "the order of travel"
            )
        pitch = positive("feed_mm_min", feed_mm_min) / 60.0 / self.rate_hz
        count = count_of("feed_mm_min / rate_hz", way[-1], pitch) + 1
        at: Floats = np.float64(pitch) * np.arange(count)
        read = np.interp(at, way, error) - self._lag(at, way, error, feed_mm_min / 60.0)
        if noise_um > 0:
            seed = None if seed is None else whole("seed", seed, 0)
            read = read + np.random.default_rng(seed).normal(0.0, noise_um, read.size)
        stylus = read / 2
        beyond = np.abs(stylus) > self.range_um / 2
        if beyond.any():
            first = int(np.argmax(beyond))
            place = float(np.interp(at[first], way, z))
            raise DataError(
                f"gauge at z {place:.3f} mm: got {stylus[first]:.1f} µm on the stylus, expected "
                f"within ±{self.range_um / 2:g} µm"
            )
        if self.resolution_um > 0:
            read = 2 * self.resolution_um * np.round(stylus / self.resolution_um)
        tick = self.tick_mm(feed_mm_min)
        stored = np.floor(at / tick + 1e-9) * tick if tick > 0 else at
        return np.interp(stored, way, z), read

    def _lag(self, at: Floats, way: Floats, error: Floats, feed_mm_s: float) -> Floats:
        """Give what a first-order response still lacks; exact for an error straight by pieces."""
        if self.response_s == 0:
            return np.zeros_like(at)
        nodes = np.union1d(at, way)
        slope = np.diff(np.interp(nodes, way, error)) / np.diff(nodes)
        span = feed_mm_s * self.response_s
        lag = np.zeros_like(nodes)
        for i, (rise, step) in enumerate(zip(slope, np.diff(nodes), strict=True)):
            settled = rise * span
            lag[i + 1] = settled + (lag[i] - settled) * np.exp(-step / span)
        return np.interp(at, nodes, lag)

"""A smooth field over scattered places, without a name: thin-plate splines, sized by the data.

Thin-plate splines are scipy's. What is here is their size: how many of the spline's own modes, or
how much smoothing, predicts a place best from all the others. That prediction has a closed form
(PRESS), so no fold is drawn.
"""

from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats

MAX_PLACES = 700  # a dense matrix of places: 700 take a second
MAX_SHARE = 0.2  # modes to places: beyond it modes describe single places
FEWEST = 6
SMOOTHINGS = 81


def _spline(places: Floats, values: Floats, smoothing: float, at: Floats) -> Floats:
    """Spline of the least bending: r² ln r in the plane, r³ on a line and in space."""
    from scipy.interpolate import RBFInterpolator  # takes 0.1 s to load

    plane = places.shape[1] == 2
    spline = RBFInterpolator(
        places,
        values,
        kernel="thin_plate_spline" if plane else "cubic",
        degree=1,
        smoothing=smoothing,
    )
    return np.asarray(spline(at), dtype=np.float64)


def _bending(places: Floats) -> Floats:
    from scipy.spatial.distance import cdist

    r = cdist(places, places)
    if places.shape[1] == 2:
        return np.asarray(r * r * np.log(np.where(r > 0, r, 1.0)))
    return np.asarray(r**3)


@dataclass(frozen=True)
class _Spectrum:
    """Linear functions over the places and modes of the bending energy, smoothest first.

    ``linear``: (m, d + 1), orthonormal; ``modes``: (m, m - d - 1), orthonormal; ``weight``: how
    little each mode bends.
    """

    linear: Floats
    modes: Floats
    weight: Floats

    @classmethod
    def of(cls, places: Floats) -> "_Spectrum":
        m = len(places)
        q = np.linalg.qr(np.column_stack([np.ones(m), places]))[0]
        k = _bending(places)
        k = k - q @ (q.T @ k)
        k = k - (k @ q) @ q.T
        w, v = np.linalg.eigh((k + k.T) / 2)
        order = np.argsort(-np.abs(w))[: m - q.shape[1]]
        return cls(q, v[:, order], np.abs(w[order]))

    def smoothing(self, readings: Floats) -> tuple[float, float]:
        """Smoothing with the smallest PRESS of readings (m, c), and what freedom it leaves."""
        q, v, w = self.linear, self.modes, self.weight
        along = v.T @ readings
        left0 = readings - q @ (q.T @ readings)
        leverage0 = np.einsum("ij,ij->i", q, q)
        score, best = np.inf, (np.inf, float(q.shape[1]))
        for smoothing in np.geomspace(w.max() * 1e-8, w.max() * 1e2, SMOOTHINGS):
            s = w / (w + smoothing)
            leverage = leverage0 + (v * v) @ s
            left = left0 - v @ (s[:, None] * along)
            press = float(np.sum((left / np.maximum(1 - leverage, 1e-6)[:, None]) ** 2))
            if press < score:
                score, best = press, (float(smoothing), float(leverage.sum()))
        return best


@dataclass(frozen=True)
class Modes:
    """The smoothest functions over the places, smoothest first, linear ones left out.

    ``places``: (m, d), different from each other, scaled to about 1. ``values``: (m, k), of unit
    rms at the places.
    """

    places: Floats
    values: Floats

    @classmethod
    def of(cls, places: Floats, readings: Floats, share: float = MAX_SHARE) -> "Modes | None":
        """Modes over places (m, d), for readings (m, c); None: too few places.

        As many as the smoothing spline that predicts the readings best is worth in parameters, at
        most the ``share`` of the places.
        """
        m, d = places.shape
        if m > MAX_PLACES:  # evenly thinned: a mode is smooth, and needs no more
            some = np.linspace(0, m - 1, MAX_PLACES).astype(int)
            places, readings, m = places[some], readings[some], MAX_PLACES
        most = int(share * m)
        if most < FEWEST or np.linalg.matrix_rank(np.column_stack([np.ones(m), places])) < d + 1:
            return None
        spectrum = _Spectrum.of(places)
        freedom = spectrum.smoothing(readings)[1] - (d + 1)
        count = int(np.clip(round(freedom), FEWEST, most))
        return cls(places, spectrum.modes[:, :count] * np.sqrt(m))

    @property
    def count(self) -> int:
        """How many modes."""
        return int(self.values.shape[1])

    def at(self, places: Floats) -> Floats:
        """Return the modes at any places, shape (n, count)."""
        return _spline(self.places, self.values, 0.0, places)


@dataclass(frozen=True)
class SmoothField:
    """A smoothing thin-plate spline through readings at places.

    ``smoothing`` is scipy's: 0 goes through every reading. ``freedom``: how many parameters it
    is worth, of each column of readings.
    """

    places: Floats
    readings: Floats
    smoothing: float
    freedom: float

    @classmethod
    def of(cls, places: Floats, readings: Floats) -> "SmoothField":
        """Smooth readings (m, c) as much as predicts each place best from the others (PRESS)."""
        return cls(places, readings, *_Spectrum.of(places).smoothing(readings))

    def at(self, places: Floats) -> Floats:
        """Return the field at any places, shape (n, c)."""
        return _spline(self.places, self.readings, self.smoothing, places)

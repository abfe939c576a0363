"""Structure without a name, and the recorded quantity that it depends on.

A dictionary of *terms*, each a few columns: a function of one covariate (harmonics, polynomials,
waves of unknown length, a jump, a class of its own) times one component by which a disturbance can
enter the readings. A term is no cause. It says that something is there, and what it goes with.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats as Array
from trunnion.base.units import Integers as IntArray
from trunnion.diagnosis.effect import lengths
from trunnion.diagnosis.model import Covariate, Model

__all__ = ["SCAN_LEVEL", "Dictionary", "Term"]

SCAN_LEVEL = 0.01
HARMONICS = 6
DEGREE = 4
WAVES = 10
JUMPS = 48


@dataclass(frozen=True)
class Term:
    """A function of one covariate that enters through one component.

    ``kind``: "harmonic", "polynomial", "wave", "jump" or "class"; ``number``: its harmonic, its
    degree, its waves over the range, the value at which it jumps, or the label of its class.
    """

    covariate: str
    kind: str
    number: object
    component: str
    unit: str = ""

    def sentence(self) -> str:
        """Say it in words."""
        where = f" in {self.component}" if self.component else ""
        u = f" {self.unit}" if self.unit else ""
        match self.kind:
            case "harmonic":
                how = f"{ordinal(int(str(self.number)))} harmonic"
            case "polynomial":
                how = {1: "linear", 2: "quadratic", 3: "cubic"}.get(
                    int(str(self.number)), f"smooth, degree {self.number}"
                )
            case "wave":
                how = f"periodic, period {float(str(self.number)):.4g}{u}"
            case "jump":
                how = f"a jump at {float(str(self.number)):.4g}{u}"
            case _:
                return f"{self.covariate} {self.number} (by itself)"
        return f"{self.covariate} ({how}{where})"


def ordinal(n: int) -> str:
    """Write 1st, 2nd, 3rd, 4th."""
    return f"{n}{ {1: 'st', 2: 'nd', 3: 'rd'}.get(n if n < 20 else n % 10, 'th') }"


class Dictionary:
    """All terms of a model's covariates and components.

    Attributes
    ----------
    terms:
        What each block of columns stands for.
    columns:
        Shape (n, M).
    start, width:
        Where the columns of each term start and how many there are.
    """

    def __init__(self, model: Model, rows: IntArray) -> None:
        components = {"": np.ones(len(rows))}
        for name, c in model.components.items():
            c = np.asarray(c, dtype=np.float64)[rows]
            if not any(np.array_equal(c, d) for d in components.values()) and np.any(c):
                components[name] = c
        names = list(components)
        enter = np.stack(list(components.values()))  # (c, n)
        terms: list[Term] = []
        width: list[int] = []
        columns: list[Array] = []  # each (m, n)
        seen: list[tuple[bool, bool, IntArray]] = []
        for v in model.covariates:
            values = np.asarray(v.values)[rows]
            said = False
            if not v.classes:
                values = values.astype(np.float64)
                ranks = np.unique(values, return_inverse=True)[1]
                periodic = v.period is not None
                same = [q for k, q, s in seen if k == periodic and np.array_equal(ranks, s)]
                if ranks.max(initial=0) < 1 or (same and (any(same) or not v.sequence)):
                    continue  # constant, or says what another covariate says
                said = bool(same)
                seen.append((periodic, v.sequence, ranks))
            for kind, numbers, f in _functions(v, values):
                if said and kind != "jump":
                    continue
                ways = names[:1] if kind == "class" else names
                k = f.shape[1]
                terms += [Term(v.name, kind, number, w, v.unit) for number in numbers for w in ways]
                width += [k] * (len(numbers) * len(ways))
                # number, component, column, reading
                block = f[:, None] * enter[None, : len(ways), None]
                columns.append(block.reshape(-1, len(rows)))
        self.terms = terms
        self.width = np.array(width, dtype=np.intp)
        self.start = np.concatenate([[0], np.cumsum(self.width)[:-1]]).astype(np.intp)
        raw = np.concatenate(columns).T if columns else np.zeros((len(rows), 0))
        self.columns = raw / lengths(raw)

    def gains(self, r: Array, basis: Array) -> tuple[Array, IntArray]:
        """Gain in RSS of every term alone, and how many columns it adds.

        ``r``: residuals (n,), or many of them (n, s), orthogonal to ``basis`` (n, q), which holds
        all that is fitted. Shapes (t,) or (t, s), and (t,).
        """
        t: Array = basis.T @ self.columns
        z = (self.columns.T @ r).reshape(self.columns.shape[1], -1)
        gain = np.zeros((len(self.terms), z.shape[1]))
        rank = np.zeros(len(self.terms), dtype=np.intp)
        for k in np.unique(self.width):
            b = np.flatnonzero(self.width == k)
            index = self.start[b][:, None] + np.arange(k)
            zk = [z[index[:, i]] for i in range(k)]
            a = [
                [_dots(self.columns, t, index[:, i], index[:, j], i == j) for j in range(i + 1)]
                for i in range(k)
            ]
            for i in range(k):
                seen = a[i][i] > 1e-4
                inverse = np.where(seen, 1.0 / np.where(seen, a[i][i], 1.0), 0.0)
                gain[b] += zk[i] ** 2 * inverse[:, None]
                rank[b] += seen
                for row in range(i + 1, k):
                    factor = a[row][i] * inverse
                    zk[row] = zk[row] - factor[:, None] * zk[i]
                    for col in range(i + 1, row + 1):
                        a[row][col] = a[row][col] - factor * a[col][i]
        return gain.reshape((-1, *r.shape[1:])).astype(np.float64), rank

    def block(self, term: int) -> Array:
        """Columns of a term, shape (n, k)."""
        return self.columns[:, self.start[term] : self.start[term] + self.width[term]]


def _dots(columns: Array, t: Array, i: IntArray, j: IntArray, same: bool) -> Array:
    """Inner products of columns i and j after the basis took its part."""
    left = np.ones(len(i)) if same else np.einsum("nm,nm->m", columns[:, i], columns[:, j])
    out: Array = left - np.einsum("qm,qm->m", t[:, i], t[:, j])
    return out


def _functions(v: Covariate, values: Array) -> Iterator[tuple[str, list[object], Array]]:
    """Functions of one covariate, by kind and width: numbers (m,) and columns (m, k, n)."""
    distinct = np.unique(values)
    if v.classes:
        if len(distinct) > 1:
            yield "class", list(distinct), (values == distinct[:, None]).astype(float)[:, None]
        return
    if v.period is not None:
        turn = 2 * np.pi * values / v.period
        different = len(np.unique(np.round(np.mod(values, v.period), 9)))
        orders = np.arange(1, min(HARMONICS, different - 1) + 1)
        yield "harmonic", list(orders), _waves(orders, turn)
    low, high = distinct[0], distinct[-1]
    x = 2 * (values - low) / (high - low) - 1
    if v.period is None or high - low < 0.9 * v.period:
        top = min(DEGREE, len(distinct) - 1)
        legendre = np.polynomial.legendre.legvander(x, top).T
        for k in range(1, top + 1):
            yield "polynomial", [k], legendre[None, 1 : k + 1]
    if v.period is None:
        waves = np.arange(1.5, min(WAVES, len(distinct) / 3), 0.5)
        yield "wave", list((high - low) / waves), _waves(np.pi * waves, x)
    if v.sequence:
        places = distinct[max(1, len(distinct) // JUMPS) :: max(1, len(distinct) // JUMPS)]
        yield "jump", list(places), (values >= places[:, None]).astype(float)[:, None]


def _waves(rates: Array | IntArray, x: Array) -> Array:
    """Return cosine and sine of each multiple, shape (m, 2, n)."""
    angle = np.multiply.outer(np.asarray(rates, dtype=np.float64), x)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)

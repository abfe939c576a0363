"""What to turn next, when the diameters of the passes so far leave more than one explanation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from trunnion.data.diameters import Diameters
from trunnion.diagnosis.protocol import Effect, Model, Values
from trunnion.diagnosis.result import Diagnosis
from trunnion.errors import InputError

__all__ = ["NextPass", "next_passes"]

Array = npt.NDArray[np.float64]

# Two laws this many standard deviations apart are told apart in more than 99 of 100 cases.
APART = 4.0


@dataclass(frozen=True)
class NextPass:
    """A further pass and how far it would part what a diagnosis calls alike.

    Attributes
    ----------
    words : str
        What to turn.
    apart : dict
        For each other explanation (a set of causes) its distance from the named one, in standard
        deviations, once the pass is measured like the first one.
    """

    words: str
    apart: Mapping[frozenset[str], float]

    @property
    def parts(self) -> tuple[frozenset[str], ...]:
        """The explanations that the pass tells from the named one."""
        return tuple(causes for causes, distance in self.apart.items() if distance >= APART)

    def __str__(self) -> str:
        """Say what to turn, and what it would settle."""
        groups = [("parts them from", self.parts)]
        groups.append(("not from", tuple(c for c in self.apart if c not in self.parts)))
        said = [
            f"{verb} " + ", ".join(sorted(" + ".join(sorted(c)) for c in causes))
            for verb, causes in groups
            if causes
        ]
        return f"{self.words} ({'; '.join(said)})"

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        apart = [{"causes": sorted(c), "distance": d} for c, d in self.apart.items()]
        return {"words": self.words, "apart": apart}


def next_passes(diagnosis: Diagnosis) -> tuple[NextPass, ...]:
    """Say which further pass would part the alternatives of a diagnosis of diameters.

    Tried are the first measured pass again with reversed feed, with twice the depth of cut, with
    both, and with half the feed speed; each from a cold tool and with a tool setting of its own.
    The means under the named causes are fitted by every other set of causes; what is left, over the
    noise, is the distance.

    Returns
    -------
    tuple of NextPass
        The best first; empty where nothing is in doubt. Explanations that none of them parts want
        something else: more readings, a calibrated bar (shows the slides alone), a fresh insert
        (no wear).

    Raises
    ------
    trunnion.InputError
        If it is no diagnosis of diameters.
    """
    model = diagnosis.source
    if model is None or not isinstance(model.data, Diameters):
        raise InputError("next_passes: wanted a diagnosis of diameters")
    others = [s for s in diagnosis.alternatives if s != diagnosis.named]
    if not others:
        return ()
    noise = max(diagnosis.sigma, 1e-9)
    found = []
    for words, wider in _candidates(model.data):
        bound = model.bind(wider)
        truth = bound.predict(np.zeros(len(bound.nuisance)), diagnosis.effects)
        found.append(NextPass(words, {o: _distance(bound, truth, o) / noise for o in others}))
    return tuple(sorted(found, key=lambda n: (-len(n.parts), -min(n.apart.values()))))


def _candidates(data: Diameters) -> Iterable[tuple[str, Diameters]]:
    n = len(data)
    labels = np.full(n, "1") if data.pass_ is None else np.asarray(data.pass_).astype(str)
    first = np.flatnonzero(labels == labels[0])
    sign = np.full(n, -1) if data.feed_sign is None else np.asarray(data.feed_sign)
    depth = np.ones(n) if data.depth_mm is None else np.asarray(data.depth_mm)
    time = data.time_s

    def with_pass(reverse: bool, deep: bool, slow: bool) -> Diameters:
        columns: dict[str, Any] = {
            name: np.concatenate([values, values[first]]) for name, values in data.columns.items()
        }
        columns["pass"] = np.concatenate([labels, np.full(len(first), "next")])
        columns["feed_sign"] = np.concatenate([sign, (-1 if reverse else 1) * sign[first]])
        columns["depth_mm"] = np.concatenate([depth, (2 if deep else 1) * depth[first]])
        if time is not None:
            new = np.asarray(time)[first]
            new = new.max() + new.min() - new if reverse else new
            columns["time_s"] = np.concatenate([time, (2 if slow else 1) * new])
        elif slow and data.spindle_rpm is not None:
            rpm = np.asarray(data.spindle_rpm)
            columns["spindle_rpm"] = np.concatenate([rpm, rpm[first] / 2])
        return Diameters(columns)

    yield "turn a pass with reversed feed, from a cold tool", with_pass(True, False, False)
    yield "turn a pass with twice the depth of cut", with_pass(False, True, False)
    yield "turn a pass with reversed feed and twice the depth", with_pass(True, True, False)
    if time is not None or data.spindle_rpm is not None:
        yield "turn a pass at half the feed speed", with_pass(False, False, True)


def _distance(model: Model, truth: Array, causes: frozenset[str]) -> float:
    """Least that a set of causes leaves of the truth, root of the sum of squares."""
    effects = [e for e in model.effects if e.id in causes]
    shapes = [_shapes(model, effect) for effect in effects]
    base = model.jacobian(np.zeros(len(model.nuisance)), {})
    least = np.inf
    for columns in product(*shapes):
        design = np.column_stack([base, *columns])
        rest = truth - design @ np.linalg.lstsq(design, truth, rcond=1e-10)[0]
        least = min(least, float(np.sqrt(rest @ rest)))
    return least


def _shapes(model: Model, effect: Effect) -> list[Array]:
    """Columns of an effect's linear parameters, for every value of one that is not linear."""
    linear = [i for i, p in enumerate(effect.parameters) if p.linear]
    grids = [p.grid if not p.linear else (1.0,) for p in effect.parameters]
    start = np.zeros(len(model.nuisance))
    return [
        model.effect_jacobian(
            start,
            effect,
            Values(zip((p.name for p in effect.parameters), point, strict=True)),
        )[:, linear]
        for point in product(*grids)
    ]

"""What a diagnosis says."""

import html
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trunnion.base.units import Floats as Array
from trunnion.base.units import Integers as IntArray
from trunnion.diagnosis.model import Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Alternative", "Cause", "Diagnosis", "Gain", "Verdict"]

Verdict = Literal["consistent", "explained", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class Cause:
    """A named cause.

    Attributes
    ----------
    id:
        The effect.
    parameters, std_errors:
        By parameter name, in the unit of the name.
    p_value:
        Of the data without this cause, the others kept, times the number of candidates.
    aliases:
        Effects that could take its place.
    words:
        How a sentence calls it.
    """

    id: str
    parameters: dict[str, float]
    std_errors: dict[str, float]
    p_value: float
    aliases: tuple[str, ...] = ()
    words: str = ""


@dataclass(frozen=True)
class Gain:
    """Residual rms (µm, or the unit of the readings) of the plain and of the extended model.

    Held out: each group of readings predicted from the others.
    """

    rms_before_um: float
    rms_after_um: float
    heldout_rms_before_um: float
    heldout_rms_after_um: float


@dataclass(frozen=True)
class Alternative:
    """A set of causes that explains the data about as well, and how well.

    ``distance``: penalised -2 ln L above the best set's. ``start``: values of nonlinear parameters
    (a slip's time) from which a fit of the set starts.
    """

    causes: frozenset[str]
    distance: float
    rms_um: float
    start: Mapping[str, Mapping[str, float]] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Diagnosis:
    """Whether the model explains the data, and if not, what does. See :func:`diagnose`.

    Attributes
    ----------
    verdict:
        "consistent", "explained" (by named causes, or by outliers alone), "ambiguous" (several
        sets of causes do) or "unexplained" (something is there that no known cause makes).
    causes:
        Strongest first.
    alternatives:
        Every set of causes within 6 of the best in penalised -2 ln L, the named set first.
    gain:
        Residual rms before and after, fitted and held out.
    unexplained:
        What the rest depends on, or None.
    errors_before, errors_after:
        The machine's errors under the plain and the extended model.
    errors_std:
        Standard errors of ``errors_after``; inf where the data cannot see one.
    outliers:
        Data rows that belong to no model.
    lost:
        Errors of the machine that nothing determines without these rows; they stay where the fit
        began.
    model:
        The extended model, in the form its kind of data is used with.
    p_value:
        Of the data under the plain model, over all tests together.
    sigma:
        Noise of one reading under the extended model, in the readings' unit.
    evidence:
        The alternatives with their distance and rms.
    invisible:
        Effects that these data cannot see.
    """

    verdict: Verdict
    causes: tuple[Cause, ...]
    alternatives: tuple[frozenset[str], ...]
    gain: Gain
    unexplained: str | None
    errors_before: dict[str, float]
    errors_after: dict[str, float]
    errors_std: dict[str, float]
    outliers: tuple[int, ...]
    model: Any
    p_value: float
    sigma: float
    evidence: tuple[Alternative, ...] = ()
    invisible: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    source: Model | None = field(default=None, repr=False)
    nuisance_before: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    nuisance_after: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict, repr=False)
    residuals_before: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    residuals_after: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    kept: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp), repr=False)

    @property
    def named(self) -> frozenset[str]:
        """The ids of the named causes."""
        return frozenset(c.id for c in self.causes)

    def score(self, other: Any) -> Gain:
        """Gain on data that the diagnosis has not seen.

        ``other``: data of the same kind, or a model of it. Errors of the machine and effects are
        kept from this diagnosis; what belongs to the set-up or the workpiece is fitted anew.
        Readings that belong to no model are left out.
        """
        from trunnion.diagnosis.score import score

        return score(self, other)

    def summary(self) -> str:
        """Say it in plain words, then as a table."""
        from trunnion.diagnosis.words import summary

        return summary(self)

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Residuals before and after, against what the strongest cause depends on."""
        from trunnion.plot.diagnosis import plot_diagnosis

        return plot_diagnosis(self, ax=ax)

    def to_html(self, path: str | Path) -> Path:
        """Write one self-contained page with words, tables and pictures; return its path."""
        from trunnion.plot.diagnosis import page

        target = Path(path)
        target.write_text(page(self), encoding="utf-8")
        return target

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain numbers and strings, ready for JSON (inf as "inf")."""
        return {
            "verdict": self.verdict,
            "causes": [plain(asdict(c)) for c in self.causes],
            "alternatives": [sorted(s) for s in self.alternatives],
            "evidence": [
                {"causes": sorted(a.causes), "distance": a.distance, "rms_um": a.rms_um}
                for a in self.evidence
            ],
            "gain": asdict(self.gain),
            "unexplained": self.unexplained,
            "errors_before": plain(self.errors_before),
            "errors_after": plain(self.errors_after),
            "errors_std": plain(self.errors_std),
            "outliers": list(self.outliers),
            "lost": list(self.lost),
            "p_value": self.p_value,
            "sigma": self.sigma,
            "invisible": list(self.invisible),
        }

    def __str__(self) -> str:
        """Return the summary."""
        return self.summary()

    def _repr_html_(self) -> str:
        """Show the summary in a notebook."""
        return f"<pre>{html.escape(self.summary())}</pre>"


def plain(value: Any) -> Any:
    """Replace what JSON cannot carry: numpy numbers by their value, infinity by "inf"."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else "inf"
    return value

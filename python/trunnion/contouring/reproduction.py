"""The comparisons of Byun and Jee 2010: Figs. 7, 8 and 9 as data.

The published figures have no numbers beside their curves, the path's place on the table is not
published, and the rounding of Table 1 moves the figures of independent axes by a third. What can be
compared is ordering and ratio:

- Fig. 7: the proposed orientation model is as good as the numerical truth at both feeds; the
  earlier one is about ten times worse at 3 m/min than at 1 m/min;
- Fig. 8: coupling cuts the contour error several times;
- Fig. 9: the proposed controller has by far the smallest orientation error; with the earlier model
  it may be worse than with independent axes.

`compare` runs it; `order_of_controller` and `offsets` show what the order of controller and inverse
Jacobian and the unpublished place change.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from trunnion.contouring.paths import Path
from trunnion.contouring.servo import Controller, Coupling, Servo
from trunnion.contouring.simulation import ContourRun, simulate

__all__ = ["Comparison", "compare", "offsets", "order_of_controller"]

CONTROLLERS: tuple[Controller, ...] = ("independent", "existing", "proposed")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Runs by feed (mm/min) and controller."""

    runs: dict[tuple[float, str], ContourRun]

    @property
    def feeds_mm_min(self) -> tuple[float, ...]:
        """Feeds, in order."""
        return tuple(dict.fromkeys(feed for feed, _ in self.runs))

    @property
    def controllers(self) -> tuple[str, ...]:
        """Controllers, in order."""
        return tuple(dict.fromkeys(name for _, name in self.runs))

    def __getitem__(self, key: tuple[float, str]) -> ContourRun:
        return self.runs[key]

    def ratio(self, figure: str, feed_mm_min: float, over: str, under: str) -> float:
        """Ratio of a figure of `ContourRun.figures` between two controllers."""
        above = self.runs[feed_mm_min, over].figures[figure]
        return above / self.runs[feed_mm_min, under].figures[figure]

    def summary(self) -> str:
        """Return the figures as a table."""
        head = (
            f"{'feed mm/min':>11}  {'controller':<24} {'contour µm max/rms':>20} "
            f"{'orientation arcsec max':>23} {'models: proposed/existing arcsec':>34}"
        )
        lines = [head]
        for (feed, name), run in self.runs.items():
            f = run.figures
            contour = f"{f['contour_max_um']:.3f} / {f['contour_rms_um']:.3f}"
            models = f"{f['proposed_max_arcsec']:.3f} / {f['tangent_max_arcsec']:.1f}"
            lines.append(
                f"{feed:>11g}  {name:<24} {contour:>20} "
                f"{f['orientation_max_arcsec']:>23.2f} {models:>34}"
            )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures by feed and controller."""
        return {f"{feed:g} mm/min, {name}": run.figures for (feed, name), run in self.runs.items()}

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"


def compare(
    *,
    path: Path | None = None,
    feeds_mm_min: Sequence[float] = (1000.0, 3000.0),
    controllers: Iterable[Controller] = CONTROLLERS,
    servo: Servo | None = None,
) -> Comparison:
    """Run the paper's comparison: three controllers at two feeds along eq. (8)."""
    path = path or Path.paper()
    controllers = tuple(controllers)
    runs: dict[tuple[float, str], ContourRun] = {}
    for feed in feeds_mm_min:
        for controller in controllers:
            run = simulate(path, feed, controller=controller, servo=servo)
            runs[feed, run.controller] = run
    return Comparison(runs)


def order_of_controller(*, path: Path | None = None, feed_mm_min: float = 3000.0) -> Comparison:
    """Run C(z) after J⁻¹ (stable) beside J⁻¹ after C(z), in right units and as printed."""
    orders = (Coupling(), Coupling(order="jacobian_last"), Coupling(order="as_printed"))
    return compare(path=path, feeds_mm_min=(feed_mm_min,), controllers=orders)


def offsets(
    places_mm: Iterable[Sequence[float]] = ((0, 0, 0), (0, 0, 50), (0, 0, 100), (50, 0, 50)),
    *,
    feed_mm_min: float = 3000.0,
) -> dict[tuple[float, ...], Comparison]:
    """Run the comparison with the path at other places on the table: the true one is unknown."""
    return {
        tuple(float(v) for v in place): compare(
            path=Path.paper(offset_mm=place), feeds_mm_min=(feed_mm_min,)
        )
        for place in places_mm
    }

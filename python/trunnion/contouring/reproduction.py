"""The comparisons of Byun and Jee 2010: Figs. 7, 8 and 9 as data.

The published figures have no numbers beside their curves, the path's place on the table is not
published, and the rounding of Table 1 moves the figures of independent axes by a third. What can be
compared is ordering and ratio:

- Fig. 7: the proposed orientation model is as good as the numerical truth at both feeds; the
  earlier one is about ten times worse at 3 m/min than at 1 m/min;
- Fig. 8: coupling cuts the contour error several times;
- Fig. 9: the proposed controller has by far the smallest orientation error; with the earlier model
  it may be worse than with independent axes.

`compare` runs it; `order_of_controller`, `position_models` and `offsets` show what the order of
controller and inverse Jacobian, the contour-error model of the earlier work and the unpublished
place change.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from trunnion.base.arguments import checked
from trunnion.base.report import Cell, Result, Table
from trunnion.contouring.paths import Path
from trunnion.contouring.servo import Controller, Coupling, Servo
from trunnion.contouring.simulation import MODEL_FIGURES, TOOL_FIGURES, ContourRun, simulate

CONTROLLERS: tuple[Controller, ...] = ("independent", "existing", "proposed")


@dataclass(frozen=True, eq=False, repr=False)
class ContourComparison(Result):
    """Runs by feed and controller: ``comparison[3000.0, "proposed"]``.

    Attributes
    ----------
    feed_of_run_mm_min
        Feed of each run.
    all_runs
        The runs, in the same order.
    """

    feed_of_run_mm_min: tuple[float, ...]
    all_runs: tuple[ContourRun, ...]

    @property
    def runs(self) -> dict[tuple[float, str], ContourRun]:
        """Runs by feed (mm/min) and controller."""
        pairs = zip(self.feed_of_run_mm_min, self.all_runs, strict=True)
        return {(feed, run.controller): run for feed, run in pairs}

    @property
    def feeds_mm_min(self) -> tuple[float, ...]:
        """Feeds, in order."""
        return tuple(dict.fromkeys(self.feed_of_run_mm_min))

    @property
    def controllers(self) -> tuple[str, ...]:
        """Controllers, in order."""
        return tuple(dict.fromkeys(run.controller for run in self.all_runs))

    def __getitem__(self, key: tuple[float, str]) -> ContourRun:
        return self.runs[key]

    @checked
    def ratio(self, figure: str, feed_mm_min: float, over: str, under: str) -> float:
        """Ratio of a figure of `ContourRun.figures` between two controllers."""
        above = self.runs[feed_mm_min, over].figures[figure]
        return above / self.runs[feed_mm_min, under].figures[figure]

    def headline(self) -> str:
        """Feeds and controllers."""
        feeds = ", ".join(f"{feed:g}" for feed in self.feeds_mm_min)
        return f"{', '.join(self.controllers)} at {feeds} mm/min"

    def tables(self) -> tuple[Table, ...]:
        """Errors of the tool, then those of the models; one row a feed and controller."""
        return (
            self._table("Errors of the tool", TOOL_FIGURES),
            self._table("Errors of the models", MODEL_FIGURES),
        )

    def _table(self, title: str, columns: Mapping[str, str]) -> Table:
        rows: list[tuple[Cell, ...]] = [
            (name, f"{feed:g}", *(run.figures[key] for key in columns))
            for (feed, name), run in self.runs.items()
        ]
        return Table.of(title, ("controller", "feed mm/min", *columns.values()), rows, digits=3)


@checked
def compare(
    *,
    path: Path | None = None,
    feeds_mm_min: Sequence[float] = (1000.0, 3000.0),
    controllers: Iterable[Controller] = CONTROLLERS,
    servo: Servo | None = None,
) -> ContourComparison:
    """Run the paper's comparison: three controllers at two feeds along eq. (8)."""
    path = path or Path.paper()
    controllers = tuple(controllers)
    runs = {}
    for feed in feeds_mm_min:
        for controller in controllers:
            run = simulate(path, feed, controller=controller, servo=servo)
            runs[feed, run.controller] = run
    return ContourComparison(tuple(feed for feed, _ in runs), tuple(runs.values()))


@checked
def order_of_controller(
    *, path: Path | None = None, feed_mm_min: float = 3000.0
) -> ContourComparison:
    """Run C(z) after J⁻¹ (stable) beside J⁻¹ after C(z), in right units and as printed."""
    orders = (Coupling(), Coupling(order="jacobian_last"), Coupling(order="as_printed"))
    return compare(path=path, feeds_mm_min=(feed_mm_min,), controllers=orders)


@checked
def position_models(
    *, path: Path | None = None, feeds_mm_min: Sequence[float] = (1000.0, 3000.0)
) -> ContourComparison:
    """Run the "existing" controller with either contour-error model beside independent axes.

    The paper does not say which model of the contour error its existing controller has. "existing"
    takes the circle, as the proposed one does, and differs in orientation alone. With the tangent
    line for both the loop leaves more than independent axes, which contradicts Fig. 8.
    """
    tangent = Coupling(position="tangent", orientation="tangent")
    return compare(
        path=path, feeds_mm_min=feeds_mm_min, controllers=("independent", "existing", tangent)
    )


@checked
def offsets(
    places_mm: Iterable[Sequence[float]] = ((0, 0, 0), (0, 0, 50), (0, 0, 100), (50, 0, 50)),
    *,
    feed_mm_min: float = 3000.0,
) -> dict[tuple[float, ...], ContourComparison]:
    """Run the comparison with the path at other places on the table: the true one is unknown."""
    return {
        tuple(float(v) for v in place): compare(
            path=Path.paper(offset_mm=place), feeds_mm_min=(feed_mm_min,)
        )
        for place in places_mm
    }

"""What is known of each measurement alone before the joint diagnosis: rows, noise, notes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from trunnion.base.resolution import Floor, Grid, Known
from trunnion.base.units import Floats, Integers
from trunnion.data.frame import frame_notes
from trunnion.data.times import time_notes
from trunnion.diagnosis.joint_ids import JointId
from trunnion.diagnosis.left import Left
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.processes import share_of_noise
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.scatter import Directions
from trunnion.diagnosis.steps import grid_of, weights_of, white_beside, white_rounding
from trunnion.diagnosis.whitening import Scaled, Scaling, Whiten, identity, sizes_of
from trunnion.files.table import Table
from trunnion.models.agreement import warm_alike
from trunnion.models.changes import done_otherwise
from trunnion.models.joint import JointModel
from trunnion.models.parts import Part
from trunnion.models.positioning import not_shared, supposed_alike
from trunnion.models.temperatures import temperature_notes

MIN_NOISE = 1e-9  # of a white reading: exact data
FAR_OUT = 1e6  # noise of an outlier beside that of the others: it says nothing


@dataclass(frozen=True)
class Measured:
    """One of several measurements of a machine.

    Attributes
    ----------
    kind, data
        Its kind, as the command line calls it, and the data.
    distinct
        Rows that are readings of their own (:mod:`trunnion.data.distinct`); None: all.
    alone
        What is left of it alone.
    model
        The model that it was diagnosed with, of the distinct rows.
    notes
        What was left out of the rows.
    """

    kind: str
    data: Any
    distinct: Integers | None
    alone: Left
    model: Model
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Count of data rows."""
        if isinstance(self.data, Table):
            return len(self.data)
        return int(np.max(self.data.readings.rows)) + 1

    @property
    def unexplained_rms(self) -> tuple[float, float] | None:
        """Rms of what the plain model and causes leave of it alone; None: they explain it."""
        if self.alone.unexplained is None:
            return None
        before, after = (np.sqrt(np.mean(x**2)) for x in (self.alone.before, self.alone.after))
        return float(before), float(after)

    @property
    def rows(self) -> Integers:
        """Data rows of a table that `used` is a model of, in order."""
        return self._bound[0]

    @property
    def used(self) -> Model:
        """The model of these rows: without outliers."""
        return self._bound[1]

    @cached_property
    def _bound(self) -> tuple[Integers, Model]:
        every = np.arange(self.size) if self.distinct is None else self.distinct
        if not isinstance(self.data, Table) or not self.alone.outliers:
            return every, self.model
        rows = np.setdiff1d(every, self.alone.outliers).astype(np.intp)
        model = self.model.bind(self.data[rows])
        if np.all(np.isin(rows[model.readings.rows], self.alone.rows)):
            return rows, model
        # of fewer rows a model may use some that it leaves out of all: where an axis just turns
        rows = np.intersect1d(rows, self.alone.rows).astype(np.intp)
        return rows, self.model.bind(self.data[rows])

    def part(self, name: str, start: int, model: Model, assumed: float = 0.0) -> Part:
        """Return this as one of several.

        ``start``: number of its first data row; ``assumed``: least variance of a white reading.
        """
        rows = np.asarray(model.readings.rows)
        rows = self.rows[rows] if isinstance(self.data, Table) else rows
        whiten, grid, share = self._noise(model, rows, assumed)
        known = self.alone.linearised
        if known is not None and not (known.model is model and known.whiten is whiten.whiten):
            known = None
        exact, more = self.alone.exact, share < 1 or self.alone.unexplained is not None
        terms = self.alone.dictionary
        count, columns = self.alone.candidates, None if known is None else self.alone.columns
        return Part(
            name,
            self.kind,
            model,
            rows + start,
            whiten,
            exact,
            more,
            grid,
            known,
            terms,
            count,
            columns,
        )

    def _noise(
        self, model: Model, rows: Integers, assumed: float
    ) -> tuple[Scaled, Grid | None, float]:
        """Return what makes the noise of the used readings white, of size 1, and their steps.

        And the share of it in what is left of it alone, which is less than 1 where that has what no
        cause makes: it would make causes of other measurements weigh more.

        ``rows``: data row of each reading of the model, which may leave out more than outliers.
        """
        found = self.alone
        kept = np.isin(found.rows, rows)
        outliers = np.isin(rows, found.outliers)  # of a model that is not bound to fewer rows
        before, after = (
            np.where(outliers, 0.0, left[kept]) for left in (found.before, found.after)
        )
        n = len(rows)
        parameters = found.parameters + len(model.nuisance)
        dof = max(n - int(outliers.sum()) - parameters, 1)
        jacobian = model.jacobian(model.start, {})
        grid = found.grid
        if found.whiten is None or model is not self.model:
            grid = grid_of(model, before, n - len(model.nuisance), jacobian)
        whiten = self._whiten(model, before, grid)
        floor = Floor(0.0 if grid is None else white_rounding(grid, whiten))
        share = 1.0
        if not found.exact:
            shown = found.unexplained is not None
            terms = Dictionary.of_all(model, whiten, found.dictionary) if shown else None
            asked = found.dictionary if model is self.model else None
            said = None if asked is None else asked.quantities
            share = share_of_noise(model, after, jacobian, whiten, floor, terms, said)
        after = after * np.sqrt(share)
        quiet = 0.0 if grid is None else grid.noise(after, dof, jacobian)
        if grid is not None:  # what the fit had for its weights
            quiet = grid.noise(after, dof, jacobian, weights_of(white_beside(grid, quiet)))
        if whiten is identity and grid is not None:
            whiten = white_beside(grid, quiet)
        directions = Directions.of(model) if whiten is identity else None
        if directions is not None and (grid is None or not grid.matters(quiet)):
            free = np.full(n, max(1.0 - parameters / n, 0.0))
            whiten = directions.of_residuals(after, free, np.arange(n)) or identity
        sizes = sizes_of(whiten, n) if outliers.any() else None
        whiten = whiten if sizes is None else Scaling(np.where(outliers, FAR_OUT, 1.0) * sizes)
        variance = float(np.sum(np.asarray(whiten(after)) ** 2)) / dof
        least = np.asarray(whiten(np.broadcast_to(model.readings.least, n).astype(float)))
        rounding = 0.0 if grid is None else white_rounding(grid, whiten)
        variance = max(variance, assumed, float(np.mean(least**2)), rounding, MIN_NOISE**2)
        white = Scaled(whiten, float(np.sqrt(variance)))
        if grid is None:
            return white, None, share
        scale = np.full(n, float(grid.step.max()))
        grid = replace(grid, known=Known(np.full(n, quiet), scale, rounding / variance))
        return white, grid, share

    def _whiten(self, model: Model, before: Floats, grid: Grid | None) -> Whiten:
        """Return what a model makes of what it leaves: that of its own diagnosis, if it may."""
        known = self.alone.whiten if model is self.model else None
        # without steps a scaling, or none, is the model's
        plain = known is identity or isinstance(known, Scaling)
        made = isinstance(known, Whitener) or (plain and grid is None)
        return known if made and known is not None else model.whitener(before)


IN_ORDER = (
    "The measurements are taken to be in the order of time, as they are given: what changed before "
    "one of them is changed in all that follow it."
)


def joint_model(
    measured: Sequence[Measured],
    binder: Callable[[Sequence[Any]], Model],
) -> JointModel:
    """Return the model of several measurements, each without the outliers of its own diagnosis.

    Exact ones beside others have the noise that their own diagnosis assumed, so that what columns
    linearised at the plain fit miss of them wants no causes here either.
    """
    beside = not all(one.alone.exact for one in measured)
    parts: list[Part] = []
    start = 0
    models = [one.used for one in measured]
    for one, used in zip(measured, models, strict=True):
        earlier = sum(part.kind == one.kind for part in parts)
        name = one.kind if not earlier else f"{one.kind} {earlier + 1}"
        model = used.beside(models)
        parts.append(one.part(name, start, model, one.alone.assumed if beside else 0.0))
        start += one.size
    return JointModel(parts, binder)


def joined(
    found: Diagnosis, model: JointModel, measured: Sequence[Measured], given: Mapping[str, Any]
) -> Diagnosis:
    """Return a joint diagnosis with what was found in each measurement alone.

    ``given``: further fields of the diagnosis.
    """
    starts = np.cumsum([0, *(one.size for one in measured)])[:-1]
    outliers = [
        int(start) + row
        for start, one in zip(starts, measured, strict=True)
        for row in one.alone.outliers
    ]
    notes = [
        said
        for kind in dict.fromkeys(part.kind for part in model.parts)
        for some in ([i for i, part in enumerate(model.parts) if part.kind == kind],)
        for said in done_otherwise(
            [model.parts[i].name for i in some], [measured[i].data for i in some]
        )
    ]
    notes += supposed_alike([one.data for one in measured])
    several = len({part.kind for part in model.parts}) > 1
    if several and any(JointId.of(i).happened for i in found.named):
        notes.append(IN_ORDER)
    notes += warm_alike(found, model)
    notes += temperature_notes(found, model, [one.data for one in measured])
    for part, one in zip(model.parts, measured, strict=True):
        others = [each.data for each in measured if each is not one]
        shared = not_shared(one.data, others)
        said = (*one.notes, *shared, *frame_notes(one.data), *time_notes(one.data))
        notes += [f"{part.name}: {n}" for n in said]
        # unless what is left of all says what it depends on
        if one.alone.unexplained is not None and f" of {part.name} (" not in f"{found.unexplained}":
            notes.append(f"{part.name} alone: {one.alone.unexplained}.")
    return replace(
        found,
        data=tuple(one.data for one in measured),
        outliers=tuple(outliers),
        notes=(*found.notes, *notes),
        **given,
    )

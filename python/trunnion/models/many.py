"""`diagnose_many`: many measurements, each by itself, on all cores."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from trunnion.base.arguments import checked
from trunnion.base.checks import whole
from trunnion.base.errors import InputError, TrunnionError
from trunnion.base.progress import progress_bar
from trunnion.base.read_files import RecordedFile, as_read
from trunnion.base.record import hold_files
from trunnion.base.report import Cell, Result, Table, significant
from trunnion.base.stored import fitting
from trunnion.base.workers import cores, map_processes
from trunnion.diagnosis.effect import EffectLike
from trunnion.diagnosis.records import percent
from trunnion.diagnosis.result import Diagnosis
from trunnion.files.csv_file import Options, options_in_force, reading
from trunnion.models.kinds import diagnose
from trunnion.models.read import read
from trunnion.setup import read_setup

LOG = logging.getLogger("trunnion.diagnosis")


@dataclass(frozen=True, eq=False, repr=False)
class FailedDiagnosis(Result):
    """A measurement that could not be read or diagnosed. See :func:`diagnose_many`.

    Attributes
    ----------
    error
        Name of the exception's class, such as "FileFormatError".
    message
        What was wrong, and where.
    verdict
        "failed".

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.diagnose_many(["none.csv"], workers=1)[0].message
    'none.csv: no such file or directory'
    """

    error: str
    message: str
    verdict: str = "failed"

    def headline(self) -> str:
        """Return verdict and message."""
        return f"failed: {self.message}"

    def sentences(self) -> tuple[str, ...]:
        """Say what was wrong."""
        return (self.headline(),)


@dataclass(frozen=True, eq=False, repr=False)
class DiagnosisBatch(Result):
    """Diagnoses of many measurements, in the order in which they were given: a sequence of them.

    Attributes
    ----------
    names
        Files, or "measurement 1" and so on.
    results
        A :class:`Diagnosis` each, or a :class:`FailedDiagnosis`.

    Examples
    --------
    >>> import trunnion as tn
    >>> files = [tn.sample_path("plate/first.csv"), "none.csv"]
    >>> [one.verdict for one in tn.diagnose_many(files, workers=1)]
    ['explained', 'failed']
    """

    names: tuple[str, ...]
    results: tuple[Diagnosis | FailedDiagnosis, ...]

    def __len__(self) -> int:
        return len(self.results)

    def __getitem__(self, place: int) -> Diagnosis | FailedDiagnosis:
        return self.results[place]

    def __iter__(self) -> Iterator[Diagnosis | FailedDiagnosis]:
        return iter(self.results)

    @property
    def failed(self) -> dict[str, str]:
        """Name → message of the measurements that could not be diagnosed."""
        return {
            name: one.message
            for name, one in zip(self.names, self.results, strict=True)
            if isinstance(one, FailedDiagnosis)
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DiagnosisBatch:
        """Return the batch that `to_dict` described."""
        if not isinstance(values, Mapping) or values.get("result") != cls.__name__:
            return super().from_dict(values)
        with fitting(cls.__name__):
            known: dict[str, type[Diagnosis | FailedDiagnosis]] = {
                each.__name__: each for each in (Diagnosis, FailedDiagnosis)
            }
            made = tuple(known[one["result"]].from_dict(one) for one in values["results"])
            return cls(tuple(map(str, values["names"])), made)

    def short_names(self) -> list[str]:
        """Return names without folders, or without those that all share."""
        short = [Path(name).name for name in self.names]
        if len(set(short)) == len(set(self.names)):
            return short
        whole = [os.path.abspath(name) for name in self.names]
        return [os.path.relpath(name, os.path.commonpath(whole)) for name in whole]

    def sentences(self) -> tuple[str, ...]:
        """Count the verdicts, and say what failed."""
        verdicts = [one.verdict for one in self.results]
        counts = ", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts))
        plural = "" if len(self) == 1 else "s"
        return (
            f"{len(self)} measurement{plural}: {counts}.",
            *(f"{name} failed: {message}" for name, message in self.failed.items()),
        )

    def tables(self) -> tuple[Table, ...]:
        """Return one line a measurement."""
        columns = ("", "verdict", "causes", "rms before", "rms after", "unit", "outliers")
        rows = [self._row(*pair) for pair in zip(self.short_names(), self.results, strict=True)]
        return (Table.of("Diagnoses", columns, rows),)

    @staticmethod
    def _row(name: str, one: Diagnosis | FailedDiagnosis) -> tuple[Cell, ...]:
        if isinstance(one, FailedDiagnosis):
            return name, one.verdict, one.error, None, None, None, None
        causes = ", ".join(f"{c.id} ({percent(c.probability)})" for c in one.causes) or "–"
        gain = one.gain
        before, after = significant(gain.rms_before_um), significant(gain.rms_after_um)
        return name, one.verdict, causes, before, after, gain.unit, len(one.outliers)


@dataclass(frozen=True)
class _Task:
    """One measurement, and how to read and diagnose it."""

    data: Any
    setup: Any
    effects: tuple[EffectLike | str, ...]
    kind: str | None
    options: Options

    def run(self) -> Diagnosis | FailedDiagnosis:
        """Diagnose it; what is wrong with it is a result, too."""
        data, setup = self.data, self.setup
        try:
            if isinstance(data, str | PathLike):
                with reading(self.options):
                    data = read(data, kind=self.kind)
            if isinstance(setup, str | PathLike):
                setup = read_setup(setup)
            return diagnose(data, setup, effects=self.effects)
        except TrunnionError as error:
            return FailedDiagnosis(type(error).__name__, str(error))
        except OSError as error:
            message = f"{error.filename or data}: {(error.strerror or str(error)).lower()}"
            return FailedDiagnosis(type(error).__name__, message)


@checked
def diagnose_many(
    data: Sequence[Any],
    setup: Any = None,
    *,
    effects: Sequence[EffectLike | str] = (),
    workers: int | None = None,
    progress: bool | None = None,
    kind: str | None = None,
    units: str = "mm",
    decimal: str | None = None,
) -> DiagnosisBatch:
    """Diagnose many measurements, each by itself, on all cores.

    What :func:`diagnose` says of each; the numbers do not depend on `workers`. A script that calls
    it with more than one worker needs ``if __name__ == "__main__":`` around its work, as all of
    Python's process pools do. Ctrl-C ends the workers at once.

    Parameters
    ----------
    data
        Files, which are read as :func:`read` does, or measured data.
    setup
        A set-up or its file, for all; or a list with one for each.
    effects
        Further candidates, as of :func:`diagnose`; with several workers they are defined at the
        top of a module.
    workers
        Processes; by default one a core, at most one a measurement.
    progress
        True: a bar with the time left; False: none; by default one in a terminal or a notebook
        once it takes longer than two seconds.
    kind, units, decimal
        How files are read, as of :func:`read`.

    Returns
    -------
    DiagnosisBatch
        In the order of `data`. A measurement that cannot be read or diagnosed is a
        :class:`FailedDiagnosis` in its place: one bad file does not stop the others.

    Raises
    ------
    InputError
        As many set-ups as measurements are expected, or one; a worker died.

    Examples
    --------
    >>> import trunnion as tn
    >>> files = [tn.sample_path("plate/first.csv"), "no-such-file.csv"]
    >>> batch = tn.diagnose_many(files, workers=1)
    >>> [one.verdict for one in batch]
    ['explained', 'failed']
    >>> batch.failed
    {'no-such-file.csv': 'no-such-file.csv: no such file or directory'}
    """
    count = whole("workers", cores() if workers is None else workers, 1)
    given = (tuple(effects), kind, options_in_force(Options(units=units, decimal=decimal)))
    pairs = zip(data, _setups(setup, len(data)), strict=True)
    tasks = [_Task(one, its, *given) for one, its in pairs]
    LOG.info("diagnosing %d measurements on %d processes", len(tasks), min(count, len(tasks)))
    with progress_bar("diagnose", len(tasks), 0, progress) as advance:
        results = map_processes(_Task.run, tasks, count, advance)
    names = tuple(_name_of(one, place) for place, one in enumerate(data))
    made = DiagnosisBatch(names, tuple(results))
    failed = [one for one, its in zip(data, made, strict=True) if isinstance(its, FailedDiagnosis)]
    paths = [one for one in failed if isinstance(one, str | PathLike)]
    hold_files(made, [as_read(one, "data") or RecordedFile.now(one, "data") for one in paths])
    return made


def _setups(setup: Any, count: int) -> list[Any]:
    """Return the set-up of each measurement; a file that all share is read once."""
    if isinstance(setup, list | tuple):
        if len(setup) != count:
            raise InputError(f"setup: got {len(setup)} set-ups, expected {count}, one each")
        return list(setup)
    if isinstance(setup, str | PathLike):
        setup = read_setup(setup)
    return [setup] * count


def _name_of(data: Any, place: int) -> str:
    if isinstance(data, str | PathLike):
        return str(data)
    origin = getattr(data, "origin", None)
    return ", ".join(map(str, origin.files)) if origin else f"measurement {place + 1}"

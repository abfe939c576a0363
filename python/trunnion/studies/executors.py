"""Executors of other engines in the style of `concurrent.futures`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trunnion.base.checks import optional_module


class RayExecutor:
    """Tasks of a Ray cluster as futures, for the `executor` of :func:`trunnion.sweep`.

    Ray is started as ``ray.init(...)`` before, or by the first task with Ray's own defaults.

    Parameters
    ----------
    options
        Of ``ray.remote`` for every task: ``num_cpus=1``, ``resources={...}``.

    Raises
    ------
    ImportError
        Ray is not installed (``pip install 'trunnion[ray]'``).
    """

    def __init__(self, **options: Any) -> None:
        ray = optional_module("ray", "sweeps on a Ray cluster", "ray")
        self._task = ray.remote(**{"num_cpus": 1, **options})(_call)

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Run it on the cluster; return a `concurrent.futures.Future`."""
        return self._task.remote(function, *arguments).future()


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)

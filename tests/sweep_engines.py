"""A small sweep on one engine, printed as digits: `python sweep_engines.py ENGINE`."""

import sys
from importlib import import_module
from typing import Any

import numpy as np

import trunnion as tn

GRID = {"noise_um": [0.1, 0.3]}


def small(executor: Any = None) -> str:
    """Return all numbers of a sweep, exactly."""
    found = tn.sweep(
        "calibration", GRID, 40, 3, executor, fixed={"identify": False}, chunk=7, progress=False
    )
    return " ".join(x.hex() for x in found["separating_error"].values.ravel()[:200].tolist())


NOT_STARTED = 77
"""Exit code where the engine does not start: Ray gives up on a machine that is overloaded."""


def of_ray() -> str:
    """On a Ray of this machine alone."""
    ray: Any = import_module("ray")
    here = {"num_cpus": 2, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    try:
        ray.init(**here, log_to_driver=False)
    except Exception as error:
        if "timed out during startup" not in str(error):
            raise
        print(error, file=sys.stderr)
        sys.exit(NOT_STARTED)
    try:
        return small(tn.studies.RayExecutor())
    finally:
        ray.shutdown()


def of_mpi() -> str:
    """On the processes that mpiexec started."""
    from mpi4py.futures import MPIPoolExecutor

    with MPIPoolExecutor() as executor:
        assert executor.num_workers >= 2
        return small(executor)


def of_dask() -> str:
    """On two processes of dask."""
    distributed: Any = import_module("distributed")

    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        return small(client.get_executor())


if __name__ == "__main__":
    np.seterr(all="ignore")
    print({"ray": of_ray, "mpi": of_mpi, "dask": of_dask}[sys.argv[1]]())

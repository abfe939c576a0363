"""The same numbers, bit for bit, on the real engines: dask, Ray, MPI; and no process stays."""

import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest

from sweep_engines import NOT_STARTED, small

HERE = Path(__file__).parent
SCRIPT = str(HERE / "sweep_engines.py")
MPIEXEC = shutil.which(
    "mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
)
MARK = "TRUNNION_TEST_ENGINE"
"""In the environment of every process that a test starts, and of those that they start."""


def command(engine: str) -> list[str]:
    if engine != "mpi":
        return [sys.executable, SCRIPT, engine]
    python = [sys.executable, "-m", "mpi4py.futures", SCRIPT, engine]
    return [str(MPIEXEC), "-n", "3", "--oversubscribe", "--allow-run-as-root", *python]


def left(mark: str) -> list[str]:
    """Return the processes with this mark in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}".encode() in (process / "environ").read_bytes():
                found.append((process / "cmdline").read_bytes().decode().replace("\0", " "))
        except OSError:  # it has ended, or is another user's
            continue
    return [line for line in found if line]


@pytest.mark.parametrize("engine", ["dask", "ray", "mpi"])
def test_an_engine_gives_the_same_numbers(engine: str, tmp_path: Path) -> None:
    needed = {"dask": ["distributed"], "ray": ["ray"], "mpi": ["mpi4py"]}[engine]
    for module in needed:
        if find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    if engine == "mpi" and MPIEXEC is None:
        pytest.skip("there is no mpiexec")
    mark = f"{engine}-{os.getpid()}"
    env = {
        **os.environ,
        MARK: mark,
        "PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parent / "python")]),
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0",
        "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
        "PRTE_MCA_prte_silence_shared_fs": "1",
        "RAY_AUTH_MODE": "disabled",
        "RAY_agent_register_timeout_ms": "120000",  # of a machine that is busy with other tests
        "RAY_raylet_start_wait_time_s": "60",
        "HOME": str(tmp_path),
        "TMPDIR": tempfile.mkdtemp(prefix="engine"),  # a short path: sockets are made below it
    }
    done = subprocess.run(
        command(engine),
        cwd=tmp_path,
        env=env,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    if done.returncode == NOT_STARTED:
        pytest.skip(f"{engine} did not start: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().splitlines()[-1] == small()
    assert left(mark) == []
    shutil.rmtree(env["TMPDIR"], ignore_errors=True)

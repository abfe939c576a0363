"""Time, memory and disk of one sweep of growing size: the table of docs/how-to/sweeps.md.

``python tests/benches/bench_sweep.py 5 6 7``: 10⁵ to 10⁷ samples, each in a process of its own.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ONE = """
import os, resource, sys, time
import trunnion as tn
samples, path = int(sys.argv[1]), sys.argv[2]
begin, cpu = time.monotonic(), time.process_time()
how = {"fixed": {"identify": False}, "path": path, "progress": False}
tn.sweep("calibration", samples=samples, seed=1, **how)
seconds, cpu = time.monotonic() - begin, time.process_time() - cpu
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
size = os.path.getsize(path) / 1e9
print(f"| {samples:.0e} | {seconds:.1f} | {cpu:.1f} | {memory:.2f} | {size:.3f} |")
"""


def main() -> None:
    """Print the table, and what else the machine did."""
    print(f"{os.cpu_count()} cores, load before {os.getloadavg()[0]:.1f}")
    print("| samples | seconds | seconds of CPU | memory, GB | file, GB |\n|---|---|---|---|---|")
    for power in map(int, sys.argv[1:] or ["5", "6"]):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.nc"
            words = [sys.executable, "-c", ONE, str(10**power), str(path)]
            print(subprocess.run(words, capture_output=True, text=True, check=True).stdout, end="")
            sys.stdout.flush()
    print(f"load after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()

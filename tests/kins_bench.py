"""Compiles a kinematics component without LinuxCNC, and calls it."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

Floats = npt.NDArray[np.float64]

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not here")

STUBS = """
#include <math.h>
#include <stdio.h>
typedef struct { double x, y, z; } PmCartesian;
typedef struct { PmCartesian tran; double a, b, c, u, v, w; } EmcPose;
typedef unsigned long KINEMATICS_FORWARD_FLAGS, KINEMATICS_INVERSE_FLAGS;
typedef enum { KINEMATICS_IDENTITY = 1, KINEMATICS_BOTH = 4 } KINEMATICS_TYPE;
#define EXPORT_SYMBOL(name)
#define RTAPI_MSG_ERR 1
#define rtapi_print_msg(level, ...) fprintf(stderr, __VA_ARGS__)
struct __comp_state { int unused; };
static struct __comp_state *__comp_first_inst = 0;
"""

LOOP = """
#include <time.h>
double cycle_us(const double *joint, long count) {
    struct timespec start, end;
    double joints[9], change = 0, spent;
    EmcPose pose;
    long i;
    clock_gettime(CLOCK_MONOTONIC, &start);
    for (i = 0; i < count; i++) {
        int j;
        for (j = 0; j < 5; j++) joints[j] = joint[j] + 1e-6 * (double)(i % 1000);
        kinematicsForward(joints, &pose, 0, 0);
        kinematicsInverse(&pose, joints, 0, 0);
        change += joints[0];
    }
    clock_gettime(CLOCK_MONOTONIC, &end);
    if (change != change) return -1; /* kept: what is computed is used */
    spent = 1e6 * (double)(end.tv_sec - start.tv_sec);
    spent += 1e-3 * (double)(end.tv_nsec - start.tv_nsec);
    return spent / (double)count;
}
"""
"""What a servo cycle asks for: forward and inverse kinematics once each."""

_PIN = re.compile(r"^pin in (?:float|bit) (\w+) = (\S+) ", re.MULTILINE)


class Kinematics:
    """A compiled component: positions of axes in, of joints out, and back."""

    def __init__(self, source: str, folder: Path) -> None:
        head, code = source.split("\n;;\n")
        code = re.sub(r"#include <\w+\.h>\n", "", code)
        pins = "".join(f"double {name} = {value};\n" for name, value in _PIN.findall(head))
        (folder / "kins.c").write_text(STUBS + pins + code + LOOP)
        library = folder / "kins.so"
        flags = ["-O2", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter"]
        subprocess.run(
            ["gcc", *flags, "-shared", "-fPIC", "-o", library, folder / "kins.c", "-lm"], check=True
        )
        self.library = ctypes.CDLL(str(library))
        self.library.cycle_us.restype = ctypes.c_double
        self.letters = re.findall(r"pos->([abc]) = joint", code)

    def set(self, pins: Mapping[str, float]) -> None:
        for name, value in pins.items():
            ctypes.c_double.in_dll(self.library, name.replace("-", "_")).value = value

    def switch(self, kind: int) -> int:
        return int(self.library.kinematicsSwitch(kind))

    def forward(self, joints: Floats) -> Floats:
        pose = (ctypes.c_double * 9)()
        assert self.library.kinematicsForward((ctypes.c_double * 5)(*joints), pose, None, None) == 0
        return np.array([pose[i] for i in self._places()])

    def inverse(self, position: Floats) -> Floats:
        pose, joints = (ctypes.c_double * 9)(), (ctypes.c_double * 5)()
        for i, value in zip(self._places(), position, strict=True):
            pose[i] = value
        assert self.library.kinematicsInverse(pose, joints, None, None) == 0
        return np.array(list(joints))[: len(position)]

    def cycle_us(self, joints: Floats, count: int = 200_000) -> float:
        """Mean time of forward and inverse kinematics together, µs."""
        values = (ctypes.c_double * 5)(*joints)
        return float(self.library.cycle_us(values, ctypes.c_long(count)))

    def _places(self) -> list[int]:
        return [0, 1, 2, *(3 + "abc".index(letter) for letter in self.letters)]

# SPDX-License-Identifier: BSD-2-Clause
"""The core headers as Python functions on numbers and arrays, compiled once per session."""

import ctypes
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.each import Each

HERE = Path(__file__).parent
CORE = HERE.parents[1] / "fmus/core"
SOURCE = HERE / "core_headers.c"
FLAGS = ["-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared"]
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
SHAPES = {
    "vec3": (3,),
    "quat": (4,),
    "mat3": (3, 3),
    "Motion": (3, 3),
    "mat6": (6, 6),
    "Square": (9,),
}
SCALARS = {"double": ctypes.c_double, "int": ctypes.c_int}
STRUCTS = {
    name: type(name, (ctypes.Structure,), {"_fields_": [("x", ctypes.c_double * int(np.prod(s)))]})
    for name, s in SHAPES.items()
}
TYPES = SCALARS | STRUCTS


def to_c(kind, value):
    if kind in SCALARS:
        return value
    flat = np.broadcast_to(np.asarray(value, float), SHAPES[kind]).ravel()
    return STRUCTS[kind]((ctypes.c_double * flat.size)(*flat))


def from_c(kind, value):
    return value if kind in SCALARS else np.array(value.x).reshape(SHAPES[kind])


class Core:
    """core.cross(a, b) calls cross() of vec3.h, with arrays for structs."""

    def __init__(self, library):
        self.library = library
        for result, name, parameters in re.findall(
            r"^CALL\((\w+), (\w+), \((.*?)\),\s", SOURCE.read_text(), re.MULTILINE
        ):
            setattr(self, name, self.function(result, name, re.findall(r"(\w+) \w+", parameters)))
        self.lyapunov = self.function("mat6", "lyapunov", ["mat6", "mat6"])

    def function(self, result, name, kinds):
        called = self.library[f"call_{name}"]
        called.restype, called.argtypes = TYPES[result], [TYPES[kind] for kind in kinds]

        def call(*values):
            assert len(values) == len(kinds)
            return from_c(result, called(*map(to_c, kinds, values)))

        return call

    def all_finite(self, x):
        x = np.ascontiguousarray(x, float)
        return bool(
            self.library.call_all_finite(x.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(x.size))
        )

    def satisfy_rule(self, rule, x):
        x = np.ascontiguousarray(x, float)
        values = x.ctypes.data_as(ctypes.c_void_p)
        return bool(self.library.call_satisfy_rule(rule, values, ctypes.c_size_t(x.size)))

    def mass_matrix(self, arm, m_0, J_S, q):
        """(13, 13), from the numbers of an Arm."""
        numbers, found = ctypes.c_double * 13**2, (ctypes.c_double * 13**2)()
        arrays = [(numbers)(*np.ravel(x)) for x in (arm, J_S, q)]
        call = self.library.call_mass_matrix
        call.restype = None
        call(arrays[0], ctypes.c_double(m_0), arrays[1], arrays[2], found)
        return np.array(found).reshape(13, 13)

    def solve_upper(self, A, b):
        """x of A x = b, None if A is not positive definite."""
        n = len(b)
        x, rows = (ctypes.c_double * 8)(), (ctypes.c_double * n * n)(*map(tuple, A))
        found = self.library.call_solve_upper(rows, n, (ctypes.c_double * n)(*b), x)
        return np.array(x[:n]) if found else None

    def problems_of_inertia(self, J):
        text = ctypes.create_string_buffer(8000)
        self.library.problems_of_inertia(to_c("mat3", J), text)
        return text.value.decode()

    def substeps(self, t, h, grid):
        """[(start, length), ...]"""
        return self._listed(self.library.substeps, t, h, grid)

    def samples(self, t, h, period):
        """[(instant, period), ...]"""
        return self._listed(self.library.samples, t, h, period)

    @staticmethod
    def _listed(function, *times):
        capacity = 1000
        first, second = (ctypes.c_double * capacity)(), (ctypes.c_double * capacity)()
        function.restype = ctypes.c_size_t
        n = function(*map(ctypes.c_double, times), ctypes.c_size_t(capacity), first, second)
        assert n <= capacity
        return list(zip(first[:n], second[:n], strict=True))


@pytest.fixture(scope="session")
def core(tmp_path_factory):
    library = tmp_path_factory.mktemp("core") / "core_headers.so"
    folders = [f"-I{CORE / name}" for name in ("adapter", "maths", "models", "ports", "../flight")]
    compiler = os.environ.get("CC", "cc").split()
    subprocess.run(
        [*compiler, *FLAGS, *WARNINGS, *folders, str(SOURCE), "-o", str(library), "-lm"], check=True
    )
    return Core(ctypes.CDLL(str(library)))


@pytest.fixture
def rng():
    return Each(range(20)).map(np.random.default_rng)

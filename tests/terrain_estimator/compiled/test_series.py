# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Elementary functions of many numbers give the bytes that each number gives alone."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from terrain_estimator.compiled.folder import RUNTIME

pytestmark = pytest.mark.skipif(shutil.which("c++") is None, reason="there is no C++ compiler")

FUNCTIONS = ("sin", "cos", "asin", "tanh", "exp", "expm1", "log")
SPECIAL = (0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -1e300, 2.2e-308, 1.7e308, 0.78, 709.9)
RANGES = ((-0.7, 0.7), (0.1, 3.0), (-60.0, 700.0), (-800.0, 800.0), (1e-300, 1e-299))


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("series")
    given = "(const double* x, const double* y, double* to, int64_t n)"
    functions = "\n".join(
        f"void many_{name}{given} {{ terrain::series::{name}({arguments}, to, n); }}\n"
        f"void one_{name}{given} {{ for (int64_t i = 0; i < n; ++i)"
        f" to[i] = terrain::elementary::{name}({single}); }}"
        for name, arguments, single in (
            *((name, "x", "x[i]") for name in FUNCTIONS),
            ("pow", "x, y", "x[i], y[i]"),
        )
    )
    (folder / "all.cpp").write_text(f'#include "series.hpp"\nextern "C" {{\n{functions}\n}}\n')
    flags = (RUNTIME / "compile_flags.txt").read_text().splitlines()
    command = ["c++", *(flag for flag in flags if flag.startswith("-")), "-fvisibility=default"]
    subprocess.run(
        [*command, "-fPIC", "-shared", f"-I{RUNTIME}", "all.cpp", "-o", "all.so"],
        cwd=folder,
        check=True,
    )
    return ctypes.CDLL(str(folder / "all.so"))


def answers(library: ctypes.CDLL, name: str, x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    found = []
    for kind in ("many", "one"):
        out = np.empty_like(x)
        pointers = (ctypes.c_void_p(each.ctypes.data) for each in (x, y, out))
        getattr(library, f"{kind}_{name}")(*pointers, ctypes.c_int64(x.size))
        found.append(out)
    return found


@pytest.mark.parametrize("name", [*FUNCTIONS, "pow"])
@pytest.mark.parametrize("bounds", RANGES)
@pytest.mark.parametrize("special", [False, True])
def test_many_give_the_bytes_of_one(
    library: ctypes.CDLL, name: str, bounds: tuple[float, float], *, special: bool
) -> None:
    generator = np.random.default_rng(1)
    x, y = generator.uniform(*bounds, 1001), generator.uniform(-3.0, 3.0, 1001)
    if special:
        x[: len(SPECIAL)], y[5 : 5 + len(SPECIAL)] = SPECIAL, SPECIAL
    many, one = answers(library, name, x, y)
    np.testing.assert_array_equal(many, one)
    numbers = ~np.isnan(one)
    assert many[numbers].tobytes() == one[numbers].tobytes()


@pytest.mark.parametrize("exponent", [0.0, np.nan, np.inf, -np.inf, 300.0, -300.0])
def test_powers_of_positive_numbers_with_any_exponent(
    library: ctypes.CDLL, exponent: float
) -> None:
    x = np.linspace(1e-3, 20.0, 97)
    many, one = answers(library, "pow", x, np.full_like(x, exponent))
    np.testing.assert_array_equal(many, one)


def test_in_place(library: ctypes.CDLL) -> None:
    x = np.linspace(-3.0, 3.0, 101)
    _, expected = answers(library, "expm1", x, x)
    pointer = ctypes.c_void_p(x.ctypes.data)
    library.many_expm1(pointer, pointer, pointer, ctypes.c_int64(x.size))
    assert x.tobytes() == expected.tobytes()

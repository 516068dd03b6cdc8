# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every operator that has a C++ form gives in C++ what it gives in torch."""

import ctypes
import io
import re
import shutil
import subprocess

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from terrain_estimator.compiled.fixed.forms import fixed_forms
from terrain_estimator.compiled.fixed.interpretation import Interpreter
from terrain_estimator.compiled.folder import RUNTIME
from terrain_estimator.compiled.graphs import Graphs, UntranslatableError, read_for_translation
from terrain_estimator.compiled.operators import LIBRARY, WRITERS
from terrain_estimator.compiled.source import _constants, _keys, addresses_of
from terrain_estimator.compiled.translation import Translation
from tests.terrain_estimator.compiled.operator_methods import KINDS, Operators

pytestmark = pytest.mark.skipif(shutil.which("c++") is None, reason="there is no C++ compiler")

FIXED = 1000
"""Number of the fixed form of the first method."""
GIVEN = "v[0], v[1], v[2], v[3], v[4]"
METHODS = [name for name in vars(Operators) if not name.startswith("_")]


def read(module: nn.Module) -> torch.jit.ScriptModule:
    saved = io.BytesIO()
    torch.jit.save(torch.jit.script(module), saved)
    return read_for_translation(saved.getvalue())


@pytest.fixture(scope="module")
def loaded() -> torch.jit.ScriptModule:
    return read(Operators())


@pytest.fixture(scope="module")
def library(
    loaded: torch.jit.ScriptModule, tmp_path_factory: pytest.TempPathFactory
) -> ctypes.CDLL:
    graphs = Graphs(loaded)
    translation = Translation(graphs)
    names = [translation.method(name) for name in METHODS]
    cases = [f"case {n}: y = {name}({GIVEN}); break;" for n, name in enumerate(names)]
    forms: list[str] = []
    for n, name in enumerate(names):
        head, known = translation.heads[name], [[inputs(0, special=False)]]
        fixed = fixed_forms(graphs, addresses_of(translation), name, head, known)
        forms += fixed
        cases += [f"case {n + FIXED}: if (!{name}_fixed_0({GIVEN}, y)) return -2; break;"] * len(
            fixed
        )
    source = "\n".join(
        [
            '#include "fixed.hpp"\n#include <cstdio>\nnamespace terrain {\nnamespace {',
            _keys(list(translation.keys)),
            _constants(translation.constants),
            "\n".join(translation.declarations),
            *(
                f"{translation.heads[n]} {{\n{translation.functions[n]}}}"
                for n in translation.heads
            ),
            *forms,
            "}  // namespace\n}  // namespace terrain\nusing namespace terrain;",
            'extern "C" int64_t run(int64_t which, const double* x, double* out, int64_t* kind) {',
            "  const Tensor v[] = {Tensor::of(x, {3, 4}, Kind::kReal),",
            "    Tensor::of(x + 12, {3, 4}, Kind::kReal), Tensor::of(x + 24, {4}, Kind::kReal),",
            "    Tensor::of(x + 28, {4, 4}, Kind::kReal),",
            "    Tensor::of(x + 44, {4}, Kind::kInteger)};",
            "  try { Tensor y; switch (which) {",
            *cases,
            "default: return -3;",
            "  } y = contiguous(y); std::copy(y.data(), y.data() + y.count(), out);",
            "  *kind = static_cast<int64_t>(y.kind()); return y.count();",
            "  } catch (const std::exception& e) { std::puts(e.what()); return -1; } }",
        ]
    )
    folder = tmp_path_factory.mktemp("operators")
    (folder / "all.cpp").write_text(source)
    flags = re.findall(
        "^-.*", (RUNTIME / "compile_flags.txt").read_text().replace("-O3", "-O1"), re.MULTILINE
    )
    subprocess.run(
        [
            "c++",
            *flags,
            "-Wall",
            "-fvisibility=default",
            "-fPIC",
            "-shared",
            f"-I{RUNTIME}",
            "all.cpp",
            "-o",
            "all.so",
        ],
        cwd=folder,
        check=True,
    )
    return ctypes.CDLL(str(folder / "all.so"))


def inputs(seed: int, *, special: bool) -> list[Tensor]:
    generator = torch.Generator().manual_seed(seed)
    x, y = torch.randn(2, 3, 4, generator=generator, dtype=torch.float64)
    root = torch.randn(4, 4, generator=generator, dtype=torch.float64)
    v = torch.randn(4, generator=generator, dtype=torch.float64)
    places = torch.tensor([2, 0, 1, 3])
    if special:
        x[0] = torch.tensor([torch.nan, torch.inf, -torch.inf, 0.0], dtype=torch.float64)
        x[1, :2] = y[1, 2] = 0.0
        y[0, 0] = torch.nan
        x[2] *= 300.0
    return [x, y, v, root @ root.T + torch.eye(4, dtype=torch.float64), places]


@pytest.mark.parametrize("special", ["plain", "special"])
@pytest.mark.parametrize("name", METHODS)
def test_cpp_gives_what_torch_gives(
    name: str, special: str, loaded: torch.jit.ScriptModule, library: ctypes.CDLL
) -> None:
    for seed in range(20):
        given = inputs(seed, special=special == "special")
        expected = getattr(loaded, name)(*given)
        count, out, kind = answered(library, METHODS.index(name), given)
        assert count == expected.numel()
        assert KINDS[kind] == expected.dtype
        # sums of large numbers that cancel, and tan next to its pole, are as good as their terms
        np.testing.assert_allclose(
            out[:count], expected.double().flatten().numpy(), rtol=3e-13, atol=1e-14
        )


def answered(
    library: ctypes.CDLL, which: int, given: list[Tensor]
) -> tuple[int, NDArray[np.float64], int]:
    """Return count, numbers and kind of a method's result in C++."""
    flat = np.concatenate([tensor.double().flatten().numpy() for tensor in given])
    out, kind = np.empty(4096), np.zeros(1, dtype=np.int64)
    library.run.restype = ctypes.c_int64
    count: int = library.run(
        ctypes.c_int64(which), *(ctypes.c_void_p(a.ctypes.data) for a in (flat, out, kind))
    )
    return count, out, int(kind[0])


WITHOUT_FIXED_FORM = {
    "functions", "turned", "made", "taken", "reduced", "multiplied", "factored", "kinds", "flow",
}  # fmt: skip
"""Methods with an operator that has the general form alone, or with numbers of another kind."""


@pytest.mark.parametrize("special", ["plain", "special"])
@pytest.mark.parametrize("name", METHODS)
def test_a_fixed_form_gives_the_bytes_of_the_general_one(
    name: str, special: str, library: ctypes.CDLL
) -> None:
    own = 0
    for seed in range(20):
        given = inputs(seed, special=special == "special")
        count, out, kind = answered(library, METHODS.index(name), given)
        fixed_count, fixed_out, fixed_kind = answered(library, FIXED + METHODS.index(name), given)
        if fixed_count >= 0:
            own += 1
            assert (fixed_count, fixed_kind) == (count, kind)
            np.testing.assert_array_equal(fixed_out[:count], out[:count])
            numbers = ~np.isnan(out[:count])
            assert fixed_out[:count][numbers].tobytes() == out[:count][numbers].tobytes()
    if name == "on_two_paths":
        assert 0 < own < 20, "the other path has the general form alone"
    else:
        assert own == (0 if name in WITHOUT_FIXED_FORM else 20)


def form_of(module: torch.jit.ScriptModule, method: str) -> str:
    """Return the fixed form of a method."""
    graphs = Graphs(module)
    translation = Translation(graphs)
    name, known = translation.method(method), [[inputs(0, special=False)]]
    constants = addresses_of(translation)
    (form,) = fixed_forms(graphs, constants, name, translation.heads[name], known)
    return form


def test_a_slow_function_is_not_repeated_in_a_larger_loop(loaded: torch.jit.ScriptModule) -> None:
    form = form_of(loaded, "in_loops")
    loops = [line for line in form.splitlines() if "scalar::sqrt(scalar::add(scalar::mul(" in line]
    assert len(loops) == 1
    assert "i0 < 4;" in loops[0]
    assert "i1" not in loops[0]


def test_slices_that_repeat_are_computed_once(loaded: torch.jit.ScriptModule) -> None:
    form = form_of(loaded, "in_repeats")
    counts = {
        name: [int(n) for n in re.findall(rf"series::{name}\(.*, (\d+)\);", form)]
        for name in ("exp", "pow", "cos")
    }
    # of eight moves three differ, of the others two, of both five
    assert counts == {"exp": [3 * 12], "pow": [5 * 12], "cos": [2 * 12]}


def test_what_is_stacked_to_be_summed_is_not_written_before(
    loaded: torch.jit.ScriptModule,
) -> None:
    form = form_of(loaded, "in_repeats")
    sums = [line for line in form.splitlines() if "= scalar::add(" in line]
    products = [line for line in sums if line.count("scalar::mul(") == 2]
    assert len(products) == 2, "one for each of the two that are stacked"


def test_the_interpreter_gives_what_torch_gives(loaded: torch.jit.ScriptModule) -> None:
    interpreter = Interpreter(Graphs(loaded))
    for name in METHODS:
        given = inputs(3, special=False)
        expected = getattr(loaded, name)(*given)
        found = interpreter.method("", name, given)
        np.testing.assert_array_equal(found.numpy(), expected.numpy())


def test_every_operator_that_has_a_cpp_form_is_among_them(loaded: torch.jit.ScriptModule) -> None:
    translation = Translation(Graphs(loaded))
    for name in METHODS:
        translation.method(name)
    assert translation.used == set(WRITERS)
    assert set(LIBRARY) == {"torch.nn.functional.pad"}


class Unknown(nn.Module):
    def forward(self, x: Tensor) -> Tensor:
        return torch.fft.rfft(x).abs()


def test_an_operator_without_a_cpp_form_is_refused_by_name() -> None:
    with pytest.raises(UntranslatableError, match="aten::fft_rfft has no C\\+\\+ form"):
        Translation(Graphs(read(Unknown()))).method("forward")


class Upper(nn.Module):
    def forward(self, x: Tensor) -> Tensor:
        return torch.cholesky_inverse(x, upper=True)


def test_an_argument_without_a_cpp_form_is_refused_by_name() -> None:
    with pytest.raises(UntranslatableError, match="cholesky_inverse"):
        Translation(Graphs(read(Upper()))).method("forward")

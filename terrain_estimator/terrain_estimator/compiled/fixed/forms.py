# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed forms of the functions in which a model spends its time, found by watching a drive."""

from typing import Any

import torch
from torch import Tensor

from terrain_estimator.compiled.fixed.expressions import number
from terrain_estimator.compiled.fixed.form import FixedForm
from terrain_estimator.compiled.fixed.interpretation import Interpreter
from terrain_estimator.compiled.fixed.lengths import RUNS, written
from terrain_estimator.compiled.fixed.recording import (
    KINDS,
    Record,
    UnfitError,
    flat,
    merged,
    record_call,
)
from terrain_estimator.compiled.graphs import Anything, Graphs

FUNCTIONS = (
    "motion",
    "learnt",
    "physics_usable",
    "physics_average",
    "block_gauss_newton",
    "block_solution_of",
    "innovation_misses",
    "bank_weigh",
    "hypotheses_expansion",
)
"""Functions that get a fixed form, by their C++ names; a model may lack one."""
MOST_SAMPLES = 40
"""Calls of a function that are kept, to find which of its sizes grow."""
MOST_PATHS, MOST_FORMS = 2, 4
"""Fixed forms of one function at most: for the same numbers, and in all (of each soil, say)."""


class Samples:
    """Arguments with which a drive calls the FUNCTIONS."""

    def __init__(self, graphs: Graphs, drive: Tensor) -> None:
        """Run the model on a packed drive [n, P]."""
        self._of: dict[str, dict[str, list[list[Any]]]] = {}
        interpreter = Interpreter(graphs, enter=self._enter)
        state = interpreter.method("", "initial", [])
        for packed in drive:
            state = interpreter.method("", "update", [state, packed])

    def _enter(self, name: str, arguments: list[Any]) -> None:
        if name in FUNCTIONS:
            known = self._of.setdefault(name, {}).setdefault(repr(_plain(arguments)), [])
            if len(known) < MOST_SAMPLES:
                known.append([_kept(each) for each in arguments])

    def of(self, name: str, graphs: Graphs, constants: dict[int, str]) -> list[list[list[Any]]]:
        """Return the samples of a function, those of the same numbers and path together.

        The most frequent path of the most frequent numbers comes first.
        """
        paths: list[list[list[Any]]] = []
        groups = sorted(self._of.get(name, {}).values(), key=len, reverse=True)
        for known in groups[: MOST_FORMS if self.index(name) is None else 1]:
            by_path: dict[str, list[list[Any]]] = {}
            for arguments in known:
                names = [""] * len(arguments)
                try:
                    record = record_call(graphs, constants, name, names, arguments)
                except UnfitError:
                    continue
                path = repr([s.expected for s in record.steps if s.operator == "guard"])
                by_path.setdefault(path, []).append(arguments)
            ordered = sorted(by_path.values(), key=len, reverse=True)
            paths += ordered[:MOST_PATHS]
        return paths[:MOST_FORMS]

    def index(self, name: str) -> int | None:
        """Return the place of the argument that is 0, 1 or 2; None where none does.

        It is an index, such as a soil's, and one form does for all of them.
        """
        every = [known[0] for known in self._of.get(name, {}).values()]
        for place in range(len(every[0]) if every else 0):
            values = [arguments[place] for arguments in every]
            if all(type(v) is int for v in values) and set(values) == {0, 1, 2}:
                others = {repr(_plain(a[:place] + a[place + 1 :])) for a in every}
                return place if len(others) == 1 else None
        return None


def _kept(value: Anything) -> Anything:
    """Return an argument that later changes do not reach."""
    if isinstance(value, Tensor):
        return value.clone()
    if isinstance(value, tuple):
        return tuple(map(_kept, value))
    return {k: _kept(v) for k, v in value.items()} if isinstance(value, dict) else value


def _plain(value: Anything) -> Anything:
    """Return what is no tensor in an argument."""
    if isinstance(value, Tensor):
        return str(value.dtype)
    if isinstance(value, list | tuple):
        return [*map(_plain, value)]
    return {k: _plain(v) for k, v in value.items()} if isinstance(value, dict) else value


def _sizes(value: Anything, read: list[bool]) -> list[int]:
    """Return the sizes of all tensors one behind the other, with their number of dimensions.

    A tensor that is not ``read`` has the sizes zero; pops its flags.
    """
    if isinstance(value, Tensor):
        return [value.dim(), *(value.shape if read.pop(0) else [0] * value.dim())]
    if isinstance(value, dict):
        value = list(value.values())
    if not isinstance(value, list | tuple):
        return []
    return [n for each in value for n in _sizes(each, read)]


def resized(value: Anything, growing: list[bool], count: int) -> Anything:
    """Return an argument whose growing dimensions have ``count`` elements; pops its flags."""
    if isinstance(value, Tensor):
        growing.pop(0)
        for d in range(value.dim()):
            if growing.pop(0):
                value = value.index_select(d, torch.arange(count) % value.shape[d])
        return value
    if isinstance(value, list | tuple):
        return type(value)(resized(each, growing, count) for each in value)
    if isinstance(value, dict):
        return {k: resized(each, growing, count) for k, each in value.items()}
    return value


def fixed_forms(
    graphs: Graphs,
    constants: dict[int, str],
    name: str,
    head: str,
    paths: list[list[list[Any]]],
    index: int | None = None,
) -> list[str]:
    """Return the C++ of the fixed forms of a function, whose C++ head is given.

    There is one for each of the ``paths``, which are samples of the arguments, unless it has an
    operator without a fixed form. ``index`` is the place of an argument that is 0, 1 or 2.
    ``constants`` are the model's tensors that are in the C++, by the address of their memory. A
    form returns whether the arguments are its own, and then writes the result.
    """
    result, _, rest = head.partition(f" {name}(")
    parameters = rest.removesuffix(")")
    names = [part.rsplit(" ", 1)[1] for part in parts_of(parameters)]
    forms: list[str] = []
    for known in paths:
        try:
            body = _form(graphs, constants, name, names, known, index)
        except UnfitError:
            continue  # the general form does it
        own = f"bool {name}_fixed_{len(forms)}({parameters}, {result}& result_)"
        forms.append(f"{own} {{\n{body}}}\n")
    return forms


def with_forms(name: str, head: str, body: str, forms: int) -> str:
    """Return the C++ of a function that tries its fixed forms first."""
    if not forms:
        return f"{head} {{\n{body}}}\n"
    result, _, rest = head.partition(f" {name}(")
    given = ", ".join(part.rsplit(" ", 1)[1] for part in parts_of(rest.removesuffix(")")))
    tries = "".join(
        f"  if ({result} result_{{}}; {name}_fixed_{k}({given}, result_)) return result_;\n"
        for k in range(forms)
    )
    # without them for a test: the general forms give the same bytes
    return f"{head} {{\n#ifndef TERRAIN_GENERAL\n{tries}#endif\n{body}}}\n"


def parts_of(text: str) -> list[str]:
    """Return the parameters of a C++ head."""
    parts, depth, start = [], 0, 0
    for at, sign in enumerate(text):
        depth += (sign == "<") - (sign == ">")
        if sign == "," and depth == 0:
            parts.append(text[start:at].strip())
            start = at + 1
    return [*parts, text[start:].strip()]


def _form(
    graphs: Graphs,
    constants: dict[int, str],
    name: str,
    names: list[str],
    known: list[Any],
    index: int | None,
) -> str:
    once = record_call(graphs, constants, name, names, known[-1])
    read = once.touched | {place.buffer for place in flat(once.result)}
    whether = [buffer in read for buffer in once.given]
    sizes = [_sizes(each, [*whether]) for each in known]
    if len({len(each) for each in sizes}) > 1:
        raise UnfitError("tensors differ in their dimensions")
    growing = [len(set(each)) > 1 for each in zip(*sizes, strict=True)]
    for each in sizes:
        if len({n for n, grows in zip(each, growing, strict=True) if grows}) > 1:
            raise UnfitError("two sizes grow")
    if index is not None and any(growing):
        raise UnfitError("a size grows beside an index")
    runs = []
    for count in RUNS:
        arguments = resized(known[-1], [*growing], count)
        if index is not None:
            arguments[index] = count - RUNS[0]
        runs.append(record_call(graphs, constants, name, names, arguments))
    record = merged(runs)
    form = FixedForm(record)
    body, used = form.text()
    returned = form.returned(record.result)
    guards = _guards(record, used, names, known[-1], index)
    return f"{guards}{body}  result_ = {returned};\n  return true;\n"


def _guards(
    record: Record, used: list[int], names: list[str], arguments: list[Any], index: int | None
) -> str:
    """Return the C++ that compares the arguments with the recorded ones."""
    lines = [
        f"if (!({source} == {_literal(value)})) return false;"
        for source, value in _numbers(names, arguments)
        if index is None or source != names[index]
    ]
    if index is not None:
        own = names[index]
        lines.append(f"if ({own} < 0 || {own} > {RUNS[2] - RUNS[0]}) return false;")
        lines.append(f"const int64_t H = {own} + {RUNS[0]};")
    grown = False
    for buffer in used:
        each = record.buffers[buffer]
        values = each.values
        if values is None or values.dtype not in KINDS:
            raise UnfitError("an argument of another kind")
        sizes = record.sizes[buffer]
        for d, size in enumerate(sizes):
            if size[0] != size[1] and not grown:
                grown = True
                lines.append(
                    f"if ({each.source}.dimensions() != {len(sizes)}) return false;"
                    f" const int64_t H = {each.source}.size({d});"
                )
        listed = ", ".join(map(written, sizes))
        lines.append(
            f"if (!fixed::fits({each.source}, Kind::{each.kind}, {{{listed}}})) return false;"
        )
        lines.append(f"const Tensor o{buffer} = contiguous({each.source});")
        lines.append(f"const double* const b{buffer} = o{buffer}.data();")
    return "".join(f"  {line}\n" for line in lines)


def _numbers(names: list[str], values: Anything) -> list[tuple[str, Any]]:
    found = []
    for name, value in zip(names, values, strict=True):
        if isinstance(value, tuple):
            inner = [f"std::get<{k}>({name})" for k in range(len(value))]
            found += _numbers(inner, value)
        elif isinstance(value, int | float):
            found.append((name, value))
        elif value is None:
            raise UnfitError("an argument is None")
    return found


def _literal(value: float) -> str:
    return str(value).lower() if isinstance(value, bool | int) else number(value)

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed forms of linear algebra: calls of the runtime's own loops."""

from collections.abc import Callable

from terrain_estimator.compiled.fixed.expressions import Expression, Leaf, combined
from terrain_estimator.compiled.fixed.lengths import (
    indexed,
    joined,
    nested,
    plus,
    same,
    times,
    written,
)
from terrain_estimator.compiled.fixed.recording import Number, Place, Step, UnfitError
from terrain_estimator.compiled.fixed.writer import Writer


def _matmul(form: Writer, step: Step) -> None:
    (result,), (left, right) = step.results, step.arguments[:2]
    a, b = form.pointer(left.buffer), form.pointer(right.buffer)
    form.new(result.buffer)
    row, column = len(left.sizes) == 1, len(right.sizes) == 1
    one, zero = same(1), same(0)
    if row:
        left = Place(left.buffer, left.offset, (one, *left.sizes), (zero, *left.strides))
    if column:
        right = Place(right.buffer, right.offset, (*right.sizes, one), (*right.strides, one))
    m, k, n = left.sizes[-2], left.sizes[-1], right.sizes[-1]
    batch = max(len(left.sizes), len(right.sizes)) - 2
    sizes: list[Number] = []
    strides: list[list[Number]] = [[], [], []]
    for d in range(batch):
        own = []
        for place in (left, right):
            at = d - (batch + 2 - len(place.sizes))
            absent = at < 0 or place.sizes[at] == one
            own.append((one, zero) if absent else (place.sizes[at], place.strides[at]))
        sizes.append(own[0][0] if own[0][0] != one else own[1][0])
        strides[1].append(own[0][1])
        strides[2].append(own[1][1])
    out = form.rows(result.buffer, [*sizes, m, n])
    strides[0] = list(out.strides[:-2])
    loops = joined(sizes, strides, range(batch))
    am, ak = left.strides[-2], left.strides[-1]
    bk, bn = right.strides[-2], right.strides[-1]
    height = m
    if loops and loops[-1][1] == [times(m, n), times(m, am), zero]:
        # matrices one below the other with one factor are one matrix
        height = times(m, loops.pop()[0])
    index = [[(f"i{q}", own[p]) for q, (_, own) in enumerate(loops)] for p in range(3)]
    at_b = f"{b} + {indexed(right.offset, index[2])}"
    before = ""
    if one not in (bn, n):
        count = written(times(k, n))
        name = f"t{result.buffer}"
        form.lines.append(f"const Shared<Storage> {name} = Storage::of({count});")
        before = (
            f"fixed::by_rows({at_b}, {written(bk)}, {written(bn)}, {name}->data(),"
            f" {written(k)}, {written(n)}); "
        )
        at_b, bk = f"{name}->data()", n
    call = (
        f"detail::multiply({a} + {indexed(left.offset, index[1])}, {written(am)}, {written(ak)},"
        f" {at_b}, {written(bk)}, b{result.buffer} + {indexed(same(0), index[0])},"
        f" {written(height)}, {written(k)}, {written(n)});"
    )
    form.lines.append(nested([size for size, _ in loops], "{ " + before + call + " }", ivdep=False))


def _linear(form: Writer, step: Step) -> None:
    (result,), (x, weight, bias) = step.results, step.arguments
    source = form.buffers[weight.buffer].source
    if not source.startswith("k_") or x != form.rows(x.buffer, x.sizes):
        raise UnfitError("linear takes constant weights and rows")
    pointer = form.pointer(x.buffer)
    constant = f"by_rows(constants().{source.removeprefix('k_')}).data()"
    form.new(result.buffer)
    m, (n, k) = times(*x.sizes[:-1]), weight.sizes
    form.lines.append(
        f"detail::multiply({pointer}, {written(k)}, 1, {constant}, {written(n)},"
        f" b{result.buffer}, {written(m)}, {written(k)}, {written(n)});"
    )
    if bias is not None:
        own = Expression(
            list(result.sizes), "{0}", [Leaf(result.buffer, same(0), list(result.strides))]
        )
        form.assign(result, combined("scalar::add({0}, {1})", [own, form.expression(bias)]))


def _linalg_cholesky_ex(form: Writer, step: Step) -> None:
    factor, info = step.results
    expression = form.expression(step.arguments[0])
    form.new(factor.buffer)
    form.assign(factor, expression)
    form.new(info.buffer)
    n, count = factor.sizes[-1], times(*(factor.sizes[:-2] or [same(1)]))
    form.lines.append(
        f"detail::factorise_all(b{factor.buffer}, b{info.buffer}, {written(count)}, {written(n)});"
    )


def _solved(form: Writer, step: Step, b: Expression, factor: Place, *, both: bool) -> None:
    (result,) = step.results
    batch = times(*(factor.sizes[:-2] or [same(1)]))
    of_result = times(*(result.sizes[:-2] or [same(1)]))
    inside = Place(factor.buffer, factor.offset, factor.sizes[-2:], factor.strides[-2:])
    single = batch == same(1) or all(s == same(0) for s in factor.strides[:-2])
    whole = form.rows(factor.buffer, factor.sizes)
    if factor.strides[-2:] != whole.strides[-2:] or not (
        single or (batch == of_result and factor.strides == whole.strides)
    ):
        raise UnfitError("factors are not in rows")
    pointer = form.pointer(inside.buffer)
    form.new(result.buffer)
    form.assign(result, b)
    n, m = result.sizes[-2], result.sizes[-1]
    step_of = "0" if single else written(times(n, n))
    form.lines.append(
        f"detail::solve_all({pointer} + {written(factor.offset)}, {step_of},"
        f" b{result.buffer}, {written(of_result)}, {written(n)}, {written(m)},"
        f" {'true' if both else 'false'});"
    )


def _cholesky_solve(form: Writer, step: Step) -> None:
    _solved(form, step, form.expression(step.arguments[0]), step.arguments[1], both=True)


def _linalg_solve_triangular(form: Writer, step: Step) -> None:
    _solved(form, step, form.expression(step.arguments[1]), step.arguments[0], both=False)


def _cholesky_inverse(form: Writer, step: Step) -> None:
    (result,) = step.results
    _solved(form, step, Expression([], "0.0", []), step.arguments[0], both=True)
    solve = form.lines.pop()
    *lead, row, column = result.strides
    to = Place(result.buffer, same(0), result.sizes[:-1], (*lead, plus(row, column)))
    form.assign(to, Expression([], "1.0", []))
    form.lines.append(solve)


def _softmax(form: Writer, step: Step) -> None:
    (result,), source = step.results, step.arguments[0]
    if len(source.sizes) != 1:
        raise UnfitError("softmax of a matrix")
    expression = form.expression(source)
    form.new(result.buffer)
    form.assign(result, expression)
    form.lines.append(f"fixed::softmax(b{result.buffer}, {written(result.sizes[0])});")


ALGEBRA: dict[str, Callable[[Writer, Step], None]] = {
    "matmul": _matmul,
    "dot": _matmul,
    "mv": _matmul,
    "linear": _linear,
    "linalg_cholesky_ex": _linalg_cholesky_ex,
    "cholesky_solve": _cholesky_solve,
    "linalg_solve_triangular": _linalg_solve_triangular,
    "cholesky_inverse": _cholesky_inverse,
    "softmax": _softmax,
}

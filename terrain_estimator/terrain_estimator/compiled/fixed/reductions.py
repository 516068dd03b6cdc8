# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed forms of sums and of what else makes one number of several."""

from collections.abc import Callable

from terrain_estimator.compiled.fixed.expressions import Expression, Leaf
from terrain_estimator.compiled.fixed.lengths import (
    indexed,
    joined,
    nested_named,
    same,
    times,
    written,
)
from terrain_estimator.compiled.fixed.pieces import whole
from terrain_estimator.compiled.fixed.recording import Step, UnfitError
from terrain_estimator.compiled.fixed.writer import Writer

_STARTS = {
    "sum": ("0.0", "add"), "mean": ("0.0", "add"),
    "amax": ("-elementary::kInfinity", "larger"), "amin": ("elementary::kInfinity", "smaller"),
    "any": ("0.0", "logical_or"), "all": ("1.0", "logical_and"),
}  # fmt: skip


def _reduce(form: Writer, step: Step) -> None:
    """Write a reduction: one result after the other, or several at once in memory."""
    (result,), source, name = step.results, step.arguments[0], step.name
    given = step.arguments[1] if len(step.arguments) > 2 else None
    rank = len(source.sizes)
    dims = (
        [d[0] % rank for d in given]
        if isinstance(given, list) and given
        else ([given[0] % rank] if isinstance(given, tuple) else list(range(rank)))
    )
    if form.buffers[result.buffer].kind == "kInteger" and name == "mean":
        raise UnfitError("a mean of integers")
    pieces = form.pieces(source)
    if pieces[0].at in dims:
        pieces = whole(form.stored(source))
    form.new(result.buffer)
    kept = [d for d in range(rank) if d not in dims]
    out = form.rows(result.buffer, [source.sizes[d] for d in kept])
    own = dict(zip(kept, out.strides, strict=True))
    outs = [own.get(d, same(0)) for d in range(rank)]
    for piece in pieces:
        first = same(0) if piece.at < 0 else times(same(piece.start), own[piece.at])
        _reduce_piece(form, piece.expression, name, kept, Leaf(result.buffer, first, outs))
    if name == "mean":
        total, count = times(*source.sizes), times(*(out.sizes or [same(1)]))
        divisor = f"(static_cast<double>({written(total)}) / static_cast<double>({written(count)}))"
        place = f"b{result.buffer}[i0]"
        form.lines.append(
            nested_named([("i0", count)], f"{place} = {place} / {divisor};", ivdep=True)
        )


def _reduce_piece(
    form: Writer, expression: Expression, name: str, kept: list[int], to: Leaf
) -> None:
    """Write the reduction of an expression whose dimensions ``kept`` are those of the result."""
    start, function = _STARTS[name]
    for leaf in expression.leaves:
        form.pointer(leaf.buffer)
    walked = form.walked(expression)
    strides = [to.strides, *(leaf.strides for leaf in walked.leaves)]
    outer = joined(walked.sizes, strides, kept)
    summed = [d for d in range(len(walked.sizes)) if d not in kept]
    inner = joined(walked.sizes, strides, summed)
    loops = [*outer, *inner]
    index = [[(f"i{k}", each[n]) for k, (_, each) in enumerate(loops)] for n in range(len(strides))]
    target = f"b{to.buffer}[{indexed(to.offset, index[0])}]"
    value = form.spelt(walked, index[1:])
    wide = bool(outer) and outer[-1][0][0] >= 4 and bool(inner)
    if wide:
        # several results at once, in memory; each is still summed in its own order
        last = len(outer) - 1
        row = [(f"i{last}", outer[-1][0])]
        sums = nested_named(
            [(f"i{len(outer) + k}", s) for k, (s, _) in enumerate(inner)],
            nested_named(row, f"{target} = scalar::{function}({target}, {value});", ivdep=True),
        )
        fill = nested_named(row, f"{target} = {start};", ivdep=True)
        form.lines.append(
            nested_named(
                [(f"i{k}", s) for k, (s, _) in enumerate(outer[:-1])],
                "{ " + fill + " " + sums + " }",
            )
        )
    else:
        sums = nested_named(
            [(f"i{len(outer) + k}", s) for k, (s, _) in enumerate(inner)],
            f"total = scalar::{function}(total, {value});",
        )
        form.lines.append(
            nested_named(
                [(f"i{k}", s) for k, (s, _) in enumerate(outer)],
                f"{{ double total = {start}; {sums} {target} = total; }}",
            )
        )


REDUCTIONS: dict[str, Callable[[Writer, Step], None]] = dict.fromkeys(_STARTS, _reduce)

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of a tensor that hold the same numbers by construction: a form computes them once.

Finite differences move one input at a time, so most of what they evaluate does not depend on most
of the moves. Here every element of a record gets a number that stands for how it is computed: equal
numbers, equal bytes. Where the slices of a dimension repeat, a buffer holds each of them once, and
a table tells where a slice lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.compiled.fixed.lengths import Looked, Stride, same, times
from terrain_estimator.compiled.fixed.pieces import rows_of, walk_of
from terrain_estimator.compiled.fixed.recording import Number, Place, Record, Step, flat
from terrain_estimator.compiled.graphs import Anything

MOST_KEPT = 0.75
"""[1] Share of the slices beyond which a table costs more than it saves."""
FEWEST = 64
"""Numbers of a buffer that is worth a table."""

_Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Layout:
    """A buffer [sizes] in rows that holds each slice of the dimension ``at`` once."""

    sizes: tuple[int, ...]
    at: int
    places: tuple[int, ...]  # of each slice among those that are kept

    @property
    def kept(self) -> tuple[int, ...]:
        """The first slice of each kind, in order."""
        return tuple(self.places.index(k) for k in range(max(self.places) + 1))

    @property
    def held(self) -> tuple[int, ...]:
        """The sizes of what is held."""
        return (*self.sizes[: self.at], len(self.kept), *self.sizes[self.at + 1 :])

    def walked(self, offset: int, sizes: Sequence[int], strides: Sequence[int]) -> "View | None":
        """Return how a view of the whole buffer walks through it; None where a table cannot."""
        found = walk_of(self.sizes, offset, sizes, strides)
        if found is None:
            return None
        return View(self, *found, rows_of(self.held))


@dataclass(frozen=True)
class View:
    """A view of a buffer with repeats: which of its dimensions each one of the view is."""

    layout: Layout
    start: list[int]
    dims: list[tuple[int, int] | None]  # dimension of the buffer, and step in it
    strides: tuple[int, ...]  # of what is held

    def chosen(self, sizes: Sequence[int]) -> list[list[int] | None]:
        """Return for each dimension the indices that write every kept slice once; None: all."""
        every: list[list[int] | None] = []
        for each, size in zip(self.dims, sizes, strict=True):
            if each is None or each[0] != self.layout.at:
                every.append(None)
                continue
            places = [self._place(each[1], k) for k in range(size)]
            every.append([k for k, place in enumerate(places) if place not in places[:k]])
        return every

    def physical(
        self, sizes: Sequence[int], chosen: Sequence[list[int] | None]
    ) -> tuple[Number, list[Stride]]:
        """Return offset and strides of a walk over ``chosen`` indices."""
        at, offset, strides = self.layout.at, 0, list[Stride]()
        fixed = [*self.start]
        for each, size, indices in zip(self.dims, sizes, chosen, strict=True):
            if each is None:
                strides.append(same(0))
                continue
            q, step = each
            walked = indices if indices is not None else [*range(size)]
            if q == at:
                fixed[q] = 0
                first, stride = stepped([self._place(step, k) for k in walked], self.strides[q])
            else:
                first, stride = stepped(walked, step * self.strides[q])
            offset += first
            strides.append(stride)
        if fixed[at] or all(each is None or each[0] != at for each in self.dims):
            fixed[at] = self.layout.places[fixed[at]]
        offset += sum(k * s for k, s in zip(fixed, self.strides, strict=True))
        return same(offset), strides

    def _place(self, step: int, k: int) -> int:
        return self.layout.places[self.start[self.layout.at] + k * step]


def stepped(places: Sequence[int], stride: int) -> tuple[int, Stride]:
    """Return the first place and the stride of places that rise evenly, else a table of them."""
    by = places[1] - places[0] if len(places) > 1 else 0
    if all(place == places[0] + k * by for k, place in enumerate(places)):
        return places[0] * stride, same(by * stride)
    return 0, Looked(tuple(places), stride)


class _Values:
    """A number for each element of each buffer: equal where it is computed in the same way."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._next = 0
        self._of: dict[int, _Ids] = {}
        self._known: dict[Any, int] = {}  # of numbers, and of elements that differ by the run

    def fresh(self, count: int) -> _Ids:
        self._next += count
        return np.arange(self._next - count, self._next, dtype=np.int64)

    def set(self, buffer: int, ids: _Ids) -> None:
        self._of[buffer] = ids.reshape(-1)

    def of(self, value: Anything, sizes: tuple[int, ...] | None = None) -> _Ids:
        """Return those of a place, a number or None, broadcast to ``sizes``."""
        found = self._view(value) if isinstance(value, Place) else np.array(self._same(repr(value)))
        return found if sizes is None else np.broadcast_to(found, sizes)

    def numbers(self, place: Place) -> NDArray[np.int64] | None:
        """Return the whole numbers [n] of a constant; None where they are not known."""
        each = self._record.buffers[place.buffer]
        if not each.constant or each.values is None:
            return None
        return each.values.flatten().numpy()[place.offset[0] :][: place.sizes[0][0]].astype(int)

    def combined(self, columns: Sequence[_Ids]) -> _Ids:
        """Return numbers that are equal where all ``columns`` of one shape are."""
        stacked = np.stack([each.reshape(-1) for each in columns])
        kinds, inverse = np.unique(stacked, axis=1, return_inverse=True)
        return self.fresh(kinds.shape[1])[np.reshape(inverse, columns[0].shape)]

    def _same(self, key: Anything) -> int:
        """Return the number of what a key stands for."""
        known = self._known.setdefault(key, self._next)
        self._next += known == self._next
        return known

    def _alike(self, columns: Sequence[_Ids]) -> _Ids:
        """Return the same as :meth:`combined`, with the numbers that it gave before."""
        stacked = np.stack([each.reshape(-1) for each in columns])
        kinds, inverse = np.unique(stacked, axis=1, return_inverse=True)
        numbers = np.array([self._same(tuple(kind)) for kind in kinds.T.tolist()], dtype=np.int64)
        return numbers[np.reshape(inverse, columns[0].shape)]

    def _view(self, place: Place) -> _Ids:
        whole = self._whole(place.buffer)
        sizes = tuple(size[0] for size in place.sizes)
        runs = []
        for run in range(3):
            strides = [each[run] * whole.itemsize for each in place.strides]
            start = whole[place.offset[run] :]
            runs.append(np.lib.stride_tricks.as_strided(start, sizes, strides))
        if all(np.array_equal(runs[0], each) for each in runs[1:]):
            return runs[0]
        return self._alike(runs)

    def _whole(self, buffer: int) -> _Ids:
        if buffer not in self._of:
            each = self._record.buffers[buffer]
            count = each.count[0]
            if each.constant and each.values is not None and each.values.numel() == count:
                bits = each.values.double().contiguous().numpy().view(np.int64).reshape(-1)
                self._of[buffer] = self._alike([bits])
            else:
                self._of[buffer] = self.fresh(count)
        return self._of[buffer]


def _grows(record: Record) -> bool:
    counts = [each.count for each in record.buffers]
    counts += [size for step in record.steps for p in flat(step.results) for size in p.sizes]
    counts += [size for step in record.steps for p in flat(step.arguments) for size in p.sizes]
    return any(len(set(count)) > 1 for count in counts)


def _of_copy(values: _Values, step: Step, sizes: tuple[int, ...]) -> _Ids | None:
    """Return the numbers of what a step copies; None where it does anything else."""
    name = step.name
    if name in ("reshape", "flatten", "contiguous"):
        return values.of(step.arguments[0]).reshape(sizes)
    if name in ("cat", "stack"):
        parts, dim = step.arguments[0], step.arguments[1][0] % len(sizes)
        found = [values.of(part) for part in parts if name == "stack" or part.sizes != (same(0),)]
        joined = np.stack(found, dim) if name == "stack" else np.concatenate(found, dim)
        return np.asarray(joined, dtype=np.int64)
    if name == "index_select":
        source, dim, places = step.arguments
        index = values.numbers(places)
        return None if index is None else np.take(values.of(source), index, dim[0])
    return None


def _columns(values: _Values, step: Step, sizes: tuple[int, ...]) -> list[_Ids]:
    """Return the numbers of all that an operator on elements takes."""
    return [values.of(each, sizes) for each in step.arguments if not isinstance(each, list)]


def layouts(
    record: Record, steps: Sequence[Step], on_elements: Sequence[str], by_place: Sequence[str]
) -> dict[int, Layout]:
    """Return the layouts of buffers with repeats, by their numbers.

    ``on_elements`` names the operators on elements; all others in ``steps`` that read a buffer
    with repeats must be among ``by_place``, which read what a place says.
    """
    if _grows(record):
        return {}
    values, found = _Values(record), dict[int, Layout]()
    for step in steps:
        if len(step.results) != 1 or record.buffers[step.results[0].buffer].constant:
            continue
        (result,) = step.results
        sizes = tuple(size[0] for size in result.sizes)
        ids = _of_copy(values, step, sizes)
        if ids is None and step.name in on_elements:
            ids = values.combined(_columns(values, step, sizes))
        if ids is None:
            continue
        values.set(result.buffer, np.ascontiguousarray(ids))
        layout = _layout(ids)
        if layout is not None:
            found[result.buffer] = layout
    kept = {p.buffer for p in flat(record.result)}
    for step in steps:
        readable = step.name in on_elements or step.name in by_place or step.operator == "guard"
        for place in flat(step.arguments):
            layout = found.get(place.buffer)
            if layout is not None and not (readable and _is_walked(layout, place)):
                kept.add(place.buffer)
    return {buffer: each for buffer, each in found.items() if buffer not in kept}


def _is_walked(layout: Layout, place: Place) -> bool:
    """Return whether a table serves a view."""
    numbers: list[Any] = [place.offset, *place.sizes, *place.strides]
    if any(len(set(each)) > 1 for each in numbers):
        return False
    sizes, strides = [s[0] for s in place.sizes], [s[0] for s in place.strides]
    return layout.walked(place.offset[0], sizes, strides) is not None


def _layout(ids: _Ids) -> Layout | None:
    """Return the layout in which the most slices repeat; None where too few do."""
    best: Layout | None = None
    least = MOST_KEPT
    if ids.size < FEWEST:
        return None
    for at, size in enumerate(ids.shape):
        rows = np.moveaxis(ids, at, 0).reshape(size, -1)
        known: dict[bytes, int] = {}
        places = [known.setdefault(row.tobytes(), len(known)) for row in rows]
        if len(known) <= least * size and size > 1:
            best, least = Layout(ids.shape, at, tuple(places)), len(known) / size
    return best


def held(layout: Layout) -> Number:
    """Return how many numbers a buffer with repeats holds."""
    return times(*(same(size) for size in layout.held))

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A compiled model in Python, without torch: its C functions by ctypes, its tensors as arrays."""

import ctypes
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.observation import Floats

VERSION = 1
"""Of the C interface, as terrain_version() in runtime/interface.hpp has it."""
BANK = ("mean", "covariance", "precision", "weight", "age", "kind")
"""The tensors of a bank, in the order of terrain_publish()."""
_KINDS: tuple[type[np.generic], ...] = (np.bool_, np.int64, np.float32, np.float64)
_MOST_DIMENSIONS = 8

_Pointer, _Integer = ctypes.c_void_p, ctypes.c_int64
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "version": (_Integer, []),
    "model": (ctypes.c_char_p, []),
    "error": (ctypes.c_char_p, []),
    "name": (ctypes.c_char_p, [_Integer]),
    "free": (None, [_Pointer]),
    "initial": (_Pointer, []),
    "initial_with_prior": (
        _Pointer,
        [_Pointer, _Pointer, _Pointer, _Integer, ctypes.c_double],
    ),
    "update": (_Pointer, [_Pointer, _Pointer, _Integer]),
    "discard": (_Pointer, [_Pointer]),
    "predict": (_Integer, [_Pointer, _Pointer, _Integer, _Pointer]),
    "estimate": (_Integer, [_Pointer, _Pointer]),
    "effects": (_Integer, [_Pointer, _Pointer, _Integer]),
    "read": (_Integer, [_Pointer, _Pointer, _Integer, _Pointer, _Integer]),
    "shape": (_Integer, [_Pointer, _Integer, _Pointer, _Pointer]),
    "check": (ctypes.c_double, []),
    "empty": (_Pointer, []),
    "put": (_Integer, [_Pointer, _Integer, _Pointer, _Pointer, _Integer, _Integer]),
    "publish": (_Pointer, [_Pointer, _Pointer, _Pointer]),
    "run": (
        _Pointer,
        [_Pointer, _Pointer, _Integer, _Integer, _Pointer, _Integer, _Pointer, _Integer],
    ),
}


class CoreError(Exception):
    """A compiled model is not what was asked for, or could not do what was asked."""


class CompiledState(Mapping[str, NDArray[Any]]):
    """A state of a compiled model: its tensors by name, each read as a new array."""

    __slots__ = ("_core", "pointer")

    def __init__(self, core: "CompiledModel", pointer: int) -> None:
        """Own the state at ``pointer``."""
        self._core, self.pointer = core, pointer

    def __del__(self) -> None:
        """Give the memory back."""
        self._core.free(self.pointer)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a tensor.

        Raises:
            KeyError: the state has none of this name.
        """
        return self._core.tensor(self, name)

    def __iter__(self) -> Iterator[str]:
        """Return the names of the tensors."""
        return iter(self._core.state_names(self))

    def __len__(self) -> int:
        """Return the number of tensors."""
        return len(self._core.state_names(self))


class CompiledModel:
    """The methods of the TorchScript model on arrays of doubles; see ``model.palpaca.PAlpaca``.

    Not for several threads at once.
    """

    def __init__(self, path: Path) -> None:
        """Load a shared library that was made from a model.

        Raises:
            CoreError: it cannot be loaded, or has another interface.
        """
        try:
            # PyDLL keeps Python's lock: a call takes microseconds, and runs alone
            library = ctypes.PyDLL(str(path))
            self._functions = {}
            for name, (result, arguments) in _SIGNATURES.items():
                function = getattr(library, f"terrain_{name}")
                function.restype, function.argtypes = result, arguments
                self._functions[name] = function
        except (OSError, AttributeError) as error:
            raise CoreError(f"{path}: not a compiled model: {error}") from None
        found = self._functions["version"]()
        if found != VERSION:
            raise CoreError(
                f"{path}: made for version {found} of the interface, this is {VERSION}: build it"
                " anew"
            )
        self.identity: str = self._functions["model"]().decode()
        self.names: list[str] = []
        while (name := self._functions["name"](len(self.names))) is not None:
            self.names.append(name.decode())
        self._keys = {name: key for key, name in enumerate(self.names)}
        self._update, self._read = self._functions["update"], self._functions["read"]
        self._estimate, self._moments = self._functions["estimate"], np.empty((3, 2))
        self._moments_at = self._moments.ctypes.data
        self._shape_of = self._functions["shape"]
        self._bank_keys = self.keys(BANK)
        self._sizes = np.zeros(_MOST_DIMENSIONS, dtype=np.int64)
        self._kind = np.zeros(1, dtype=np.int64)
        self._shape_at = self._sizes.ctypes.data, self._kind.ctypes.data

    def difference(self) -> float:
        """Return the largest difference to TorchScript on the drive recorded with the model.

        In posterior deviations; infinite where the core fails.
        """
        return float(self._functions["check"]())

    def free(self, pointer: int) -> None:
        """Give the memory of a state back."""
        self._functions["free"](pointer)

    def keys(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Return the keys of tensors for :meth:`read`."""
        return np.array([self._keys[name] for name in names], dtype=np.int64)

    def initial(self) -> CompiledState:
        """Return the state at the start, with the model's own prior and no drift."""
        return self._state(self._functions["initial"]())

    def initial_with_prior(
        self, mean: Floats, sd: Floats, soils: Floats, drift: float
    ) -> CompiledState:
        """Return the state before the first observation, with a user's prior."""
        mean, sd, soils = (np.ascontiguousarray(x, dtype=np.float64) for x in (mean, sd, soils))
        return self._state(
            self._functions["initial_with_prior"](
                mean.ctypes.data, sd.ctypes.data, soils.ctypes.data, soils.size, drift
            )
        )

    def update(self, state: CompiledState, packed: Floats) -> CompiledState:
        """Return the state after one packed observation [P] of doubles."""
        # bytes are handed over sooner than an array
        return self._state(self._update(state.pointer, packed.tobytes(), packed.size))

    def discard(self, state: CompiledState) -> CompiledState:
        """Return the state without the open block."""
        return self._state(self._functions["discard"](state.pointer))

    def predict(self, state: CompiledState, packed: Floats) -> Floats:
        """Return mean [m/s] and variance [2] of the velocity that an observation [P] measures."""
        out = np.empty(2)
        self._count(
            self._functions["predict"](
                state.pointer, packed.ctypes.data, packed.size, out.ctypes.data
            )
        )
        return out

    def estimate(self, state: CompiledState) -> Floats:
        """Return mean and covariance of (c [Pa], tan phi) [3, 2]."""
        self._count(self._estimate(state.pointer, self._moments_at))
        return self._moments.copy()

    def effects(self, state: CompiledState) -> Floats:
        """Return mean and variance of the size of each of J named effects [J, 2]."""
        out = np.empty((64, 2))
        count = self._count(self._functions["effects"](state.pointer, out.ctypes.data, out.size))
        return out[: count // 2]

    def publish(self, state: CompiledState, bank: Mapping[str, NDArray[Any]]) -> CompiledState:
        """Return the state with another bank, a mapping of the names in BANK."""
        holder = self.state_of(bank)
        return self._state(
            self._functions["publish"](state.pointer, holder.pointer, self._bank_keys.ctypes.data)
        )

    def read(self, state: CompiledState, keys: NDArray[np.int64], out: Floats) -> int:
        """Write the numbers of some tensors into ``out``, and return how many there are."""
        return self._count(
            self._read(state.pointer, keys.ctypes.data, keys.size, out.ctypes.data, out.size)
        )

    def reader(self, names: Sequence[str], size: int) -> Callable[[CompiledState], Floats]:
        """Return a function that reads tensors with ``size`` numbers in all.

        It gives the same array each time.
        """
        keys, out = self.keys(names), np.empty(size)
        first, start = keys.ctypes.data, out.ctypes.data

        def read(state: CompiledState) -> Floats:
            # the sizes keep both arrays, whose addresses are handed over
            self._count(self._read(state.pointer, first, keys.size, start, out.size))
            return out

        return read

    def updater(
        self, names: Sequence[str], size: int
    ) -> tuple[Callable[[CompiledState, Floats], CompiledState], Floats]:
        """Return a form of :meth:`update` that reads tensors of the new state, and their numbers.

        These are ``size`` numbers in all, in an array that every update overwrites: one call of the
        library is sooner made than two.
        """
        keys, out, run = self.keys(names), np.empty(size), self._functions["run"]
        first, start = keys.ctypes.data, out.ctypes.data

        def update(state: CompiledState, packed: Floats) -> CompiledState:
            # the sizes keep both arrays, whose addresses are handed over
            at, given = state.pointer, packed.tobytes()
            after = run(at, given, 1, packed.size, first, keys.size, start, out.size)
            return self._state(after)

        return update, out

    def run(
        self, state: CompiledState, packed: Floats, names: Sequence[str], width: int
    ) -> tuple[CompiledState, Floats]:
        """Return the state after ``n`` packed observations [n, P], and numbers after each of them.

        These are the tensors ``names`` one behind the other, ``width`` numbers in all; where they
        are fewer, NaN follows.
        """
        packed = np.ascontiguousarray(packed, dtype=np.float64)
        keys, out = self.keys(names), np.full((len(packed), width), math.nan)
        after = self._functions["run"](
            state.pointer, packed.ctypes.data, *packed.shape, keys.ctypes.data, keys.size,
            out.ctypes.data, width,
        )  # fmt: skip
        return self._state(after), out

    def length(self, state: CompiledState, name: str) -> int:
        """Return the first size of a tensor of a state."""
        self._count(self._shape_of(state.pointer, self._keys[name], *self._shape_at))
        return int(self._sizes[0])

    def state_names(self, state: CompiledState) -> list[str]:
        """Return the names of a state's tensors."""
        return [name for name in self.names if self._shape(state, name) is not None]

    def tensor(self, state: CompiledState, name: str) -> NDArray[Any]:
        """Return a tensor of a state.

        Raises:
            KeyError: the state has none of this name.
        """
        found = self._shape(state, name) if name in self._keys else None
        if found is None:
            raise KeyError(name)
        shape, kind = found
        values = np.empty(shape)
        self.read(state, self.keys([name]), values)
        return values.astype(_KINDS[kind])

    def state_of(self, arrays: Mapping[str, NDArray[Any]]) -> CompiledState:
        """Return a state of these tensors.

        Raises:
            KeyError: the model's states have no tensor of one of the names.
        """
        made = self._state(self._functions["empty"]())
        for name, value in arrays.items():
            kind = _KINDS.index(np.asarray(value).dtype.type)
            values = np.ascontiguousarray(value, dtype=np.float64)
            sizes = np.array(values.shape, dtype=np.int64)
            self._count(
                self._functions["put"](
                    made.pointer, self._keys[name], values.ctypes.data, sizes.ctypes.data,
                    np.ndim(value), kind,
                )
            )  # fmt: skip
        return made

    def _shape(self, state: CompiledState, name: str) -> tuple[tuple[int, ...], int] | None:
        count = self._shape_of(state.pointer, self._keys[name], *self._shape_at)
        return None if count < 0 else (tuple(self._sizes[:count].tolist()), int(self._kind[0]))

    def _state(self, pointer: int | None) -> CompiledState:
        if not pointer:
            raise CoreError(self._functions["error"]().decode(errors="replace"))
        return CompiledState(self, pointer)

    def _count(self, count: int) -> int:
        if count < 0:
            raise CoreError(self._functions["error"]().decode(errors="replace"))
        return count

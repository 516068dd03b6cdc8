# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Check of a TorchScript archive before torch loads it.

A TorchScript model is a program: torch runs its ``__setstate__`` methods while it loads, and its
operators can read and write files (``aten::save``, ``aten::from_file``). The check reads the zip
archive, the source and the pickles as data, without torch, and allows what models of this package
consist of:

- operators of arithmetic on tensors, lists and dictionaries, by name;
- classes and functions that the archive itself defines, without special methods;
- tensors that lie within their stored numbers.

The result is a new archive of the checked contents alone. Two readers of zip files can find
different contents in one file; torch never sees the original.
"""

import functools
import io
import math
import pickle
import pickletools
import re
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import torch

from rover_parameters.records import shortened

LARGEST_CONTENTS = 64 << 20
"""[bytes] Largest sum of the unpacked contents."""
MOST_FILES = 2000
LARGEST_CODE = 1 << 21
"""[bytes] Largest source, all files together; the shipped models have 100 kB."""
MOST_FUNCTIONS = 400
DEEPEST = 64
"""Largest number of brackets within each other, and half the largest indentation."""
LONGEST_LINE = 1500
"""Largest number of words and signs within a line, or within brackets that span several."""
MOST_OPCODES = 100_000
"""Largest number of opcodes of a pickle; the shipped models have 1200."""
LARGEST_TENSOR = 1 << 24
"""Largest number of elements of a stored tensor, also of one that repeats its numbers."""


def _words(text: str) -> list[str]:
    return text.split()


OPERATORS = frozenset(
    _words("""
    __and__ __contains__ __getitem__ __is__ __isnot__ __not__ __or__ __xor__ _set_item abs acos add
    addcmul all amax amin any append arange argmax argmin asin atan atan2 baddbmm bmm
    broadcast_tensors cat ceil cholesky_inverse cholesky_solve clamp clamp_max clamp_min clone copy
    copy_ cos cosh count cumsum device diag diag_embed diagonal dim div dot dtype einsum eq erf erfc
    exp expand expand_as expm1 extend eye flatten flip floor floordiv fmod full full_like gather ge
    gt hypot igamma index index_put index_select is_floating_point isfinite isinf isnan item keys le
    len lerp lgamma linalg_cholesky_ex linalg_solve linalg_solve_ex linalg_solve_triangular linear
    linspace list log log1p log_softmax logaddexp logical_and logical_not logical_or logsumexp lt
    masked_fill masked_select matmul max maximum mean min minimum movedim mul mv nan_to_num narrow
    ne neg new_empty new_full new_zeros nonzero norm numel numpy_T ones ones_like outer pad permute
    pop pow prod reciprocal relu remainder repeat repeat_interleave reshape round rsqrt rsub select
    select_scatter shape sigmoid sign sin sinh size slice softmax softplus sort special_erfc split
    split_with_sizes sqrt square squeeze stack std sub sum t tan tanh tensor to tolist topk
    transpose tril triu trunc unbind unflatten unsqueeze update values var view where zeros
    zeros_like
    """)
)
"""Names of operators, also as methods and attributes, that touch nothing but their arguments."""
OF_PRIM = frozenset(("abs", "device", "dtype", "max", "min", "shape"))
"""Names behind ``ops.prim``."""
_OF_TORCH = "__torch__.torch.classes"  # written in C++, and found before those of an archive
_SPECIAL = frozenset(
    ("__torch__", "__parameters__", "__buffers__", "__annotations__", "__len__", *OPERATORS)
)
_REFUSED = frozenset(
    _words("""
    CONSTANTS async awaitable awaitable_nowait awaitable_wait del fork global import
    lambda nonlocal print rpc_async rpc_remote rpc_sync try with yield
    """)
)
"""Words that may not occur: they run something at another time or place, or write to stdout."""
_TOKEN = re.compile(
    r'(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<text>"[ !#-\[\]-~]*")'
    r"|(?P<number>[0-9]+(?:\.[0-9]*)?(?:e[+-]?[0-9]+)?|\.[0-9]+(?:e[+-]?[0-9]+)?)"
    r"|(?P<sign>->|[=(){}\[\],.:<>*-])|(?P<space>[ ]+)|(?P<end>\n)"
)
_SOURCE = re.compile(r"code/(__torch__/(?:[A-Za-z_][A-Za-z0-9_]*/)*[A-Za-z_][A-Za-z0-9_]*)\.py")
_SINGLE = frozenset(("data.pkl", "constants.pkl", "version", "byteorder"))
_NUMBERS = re.compile(r"(data|constants)/[0-9]{1,6}")
_LEFT_OUT = re.compile(
    r"code/.*\.debug_pkl|\.data/serialization_id|\.storage_alignment|\.format_version"
)
_STORED_BYTES = {
    "Double": 8,
    "Long": 8,
    "Float": 4,
    "Int": 4,
    "Short": 2,
    "Char": 1,
    "Byte": 1,
    "Bool": 1,
}
_OF_LISTS = frozenset(
    ("build_intlist", "build_floatlist", "build_doublelist", "build_boollist", "build_tensorlist")
)
_OPCODES = frozenset(
    _words("""
    PROTO GLOBAL BINPUT LONG_BINPUT BINGET LONG_BINGET EMPTY_TUPLE EMPTY_LIST EMPTY_DICT MARK TUPLE
    TUPLE1 TUPLE2 TUPLE3 NEWOBJ REDUCE BUILD SETITEM SETITEMS APPEND APPENDS BINUNICODE
    SHORT_BINSTRING BININT BININT1 BININT2 LONG1 BINFLOAT BINPERSID NONE NEWTRUE NEWFALSE STOP
    """)
)


class ArchiveError(ValueError):
    """An archive has something that no model of this package has; the message names it."""


def checked_archive(content: bytes) -> bytes:
    """Check an archive; return a new one of the checked contents.

    Raises:
        ArchiveError: something in it is not allowed, or beyond a limit.
    """
    files = _unpacked(content)
    sources = {
        match[1].replace("/", "."): text
        for name, text in files.items()
        if (match := _SOURCE.fullmatch(name))
    }
    check_sources({name: _ascii(name, text) for name, text in sources.items()})
    for name in ("data", "constants"):
        _check_pickle(name, files, frozenset(sources))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, data in files.items():
            archive.writestr(f"model/{name}", data)
    return packed.getvalue()


def _unpacked(content: bytes) -> dict[str, bytes]:
    """Return the files that torch needs, by their path below the archive's single folder."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = _needed(archive.infolist())
            files = {name: archive.read(entry) for name, entry in entries.items()}
    except ArchiveError:
        raise
    except Exception as error:  # zipfile raises errors of many kinds
        raise ArchiveError(f"it is not a sound zip archive ({error})") from error
    if missing := [name for name in ("data.pkl", "constants.pkl", "version") if name not in files]:
        raise ArchiveError(f"it lacks the file {missing[0]}")
    if not re.fullmatch(rb"[0-9]{1,2}\n?", files["version"]):
        raise ArchiveError(f"its version is {files['version'][:20]!r}")
    if files.get("byteorder", b"little") != b"little":
        raise ArchiveError(f"its order of bytes is {files['byteorder'][:20]!r}, not little")
    return files


def _needed(entries: Sequence[zipfile.ZipInfo]) -> dict[str, zipfile.ZipInfo]:
    """Return the entries that torch needs, after a check of all names and sizes."""
    size = sum(entry.file_size for entry in entries)
    if len(entries) > MOST_FILES or size > LARGEST_CONTENTS:
        raise ArchiveError(
            f"it unpacks to {len(entries)} files of {size} bytes, more than {MOST_FILES} or"
            f" {LARGEST_CONTENTS}"
        )
    needed: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        folder, _, name = entry.filename.partition("/")
        if name in needed or folder != entries[0].filename.partition("/")[0]:
            raise ArchiveError(f"file {shortened(entry.filename)} is twice, or in another folder")
        if _LEFT_OUT.fullmatch(name):
            continue
        if not (_SOURCE.fullmatch(name) or _NUMBERS.fullmatch(name) or name in _SINGLE):
            raise ArchiveError(f"file {shortened(entry.filename)} is not one of a model")
        needed[name] = entry
    return needed


def _ascii(name: str, text: bytes) -> str:
    try:
        return text.decode("ascii")
    except UnicodeDecodeError as error:
        raise ArchiveError(f"source {name}: byte {error.start} is not ASCII") from error


def check_sources(sources: Mapping[str, str]) -> None:
    """Check the source of every module, by dotted name. Raises ArchiveError."""
    if sum(map(len, sources.values())) > LARGEST_CODE:
        raise ArchiveError(f"its source has more than {LARGEST_CODE} bytes")
    functions = 0
    for module, text in sources.items():
        if f"{module}.".startswith(f"{_OF_TORCH}."):
            raise ArchiveError(f"source {module} stands for classes of torch")
        tokens = list(_tokens(module, text))
        functions += sum(word == "def" for _, word in tokens)
        _check_words(module, tokens, frozenset(sources))
    if functions > MOST_FUNCTIONS:
        raise ArchiveError(f"its source has {functions} functions, more than {MOST_FUNCTIONS}")


def _tokens(module: str, text: str) -> Iterator[tuple[str, str]]:
    """Yield kind and word; ends of lines and spaces are left out, brackets and lines counted."""
    if '"""' in text:  # the one sign that begins a text for torch and ends one here
        raise ArchiveError(f"source {module}: sign of three quotation marks")
    place = depth = length = 0
    begins = True
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            raise ArchiveError(f"source {module}: sign {text[place]!r} at byte {place}")
        place, kind, word = match.end(), str(match.lastgroup), match.group()
        if kind == "end":
            length, begins = length if depth else 0, True
            continue
        if kind == "space":
            if begins and len(word) > 2 * DEEPEST:
                raise ArchiveError(f"source {module}: byte {place} is indented by {len(word)}")
            continue
        begins = False
        length += 1
        depth += (word in {"(", "[", "{"}) - (word in {")", "]", "}"})
        if length > LONGEST_LINE or not 0 <= depth <= DEEPEST:
            raise ArchiveError(f"source {module}: byte {place}: line too long or brackets too deep")
        yield kind, word


def _check_words(module: str, tokens: Sequence[tuple[str, str]], modules: frozenset[str]) -> None:
    """Check every name by what stands before and after it."""
    words = ["", *(word for _, word in tokens), *[""] * 6]
    at = 1
    while at <= len(tokens):
        kind, word = tokens[at - 1]
        if word == "(" and words[at - 1] in {")", "]", "}"}:
            raise ArchiveError(f"source {module}: the result of an expression is called")
        if word == ".":
            _check_attribute(module, words[at + 1])
        if kind == "name":
            _check_name(module, word)
            if words[at - 1] != ".":
                at += _check_root(module, words, at, modules)
        at += 1


def _check_name(module: str, name: str) -> None:
    if name in _REFUSED:
        raise ArchiveError(f"source {module}: {name} is not allowed")
    if name.startswith("__") and name.endswith("__") and name not in _SPECIAL:
        raise ArchiveError(f"source {module}: special name {name} is not allowed")


def _check_root(module: str, words: Sequence[str], at: int, modules: frozenset[str]) -> int:
    """Check what a name that begins a path leads to; return how many words of it are checked."""
    match words[at]:
        case "torch" | "ops":
            return _check_operator(module, words, at)
        case "__torch__":
            return _check_path(module, words, at, modules)
        case "getattr":
            _check_getattr(module, words[at + 1 : at + 6])
    return 0


def _check_operator(module: str, words: Sequence[str], at: int) -> int:
    """Check ``torch.NAME(`` and ``ops.prim.NAME(``; anything else of torch is refused."""
    path, end = _path(words, at)
    space, _, name = path.rpartition(".")
    allowed = OPERATORS if space == "torch" else OF_PRIM if space == "ops.prim" else frozenset()
    if name not in allowed or words[end] != "(":
        raise ArchiveError(f"source {module}: operator {path[:80]} is not allowed")
    return end - at - 1


def _check_path(module: str, words: Sequence[str], at: int, modules: frozenset[str]) -> int:
    """Check the path of a class or function, which the archive defines."""
    path, end = _path(words, at)
    if path.rpartition(".")[0] not in modules:
        raise ArchiveError(f"source {module}: {path[:80]} is not defined in it")
    return end - at - 1


def _path(words: Sequence[str], at: int) -> tuple[str, int]:
    """Return the dotted path that begins here, and where it ends."""
    end = at + 1
    while words[end] == ".":
        end += 2
    return "".join(words[at:end]), end


def _check_getattr(module: str, words: Sequence[str]) -> None:
    """Check that only numbered parts of a sequence are read by name."""
    match words:
        case ["(", name, ",", text, ")"] if name.isidentifier() and text.strip('"').isdigit():
            return
    raise ArchiveError(f"source {module}: getattr {shortened(''.join(words))} is not allowed")


def _check_attribute(module: str, name: str) -> None:
    """Check that an attribute or method is no operator of torch but an allowed one."""
    if name not in OPERATORS and _is_operator(name):
        raise ArchiveError(f"source {module}: attribute {name} is an operator that is not allowed")


@functools.cache
def _is_operator(name: str) -> bool:
    return bool(torch._C._jit_get_schemas_for_operator(f"aten::{name}"))  # noqa: SLF001 - no public way


def _check_pickle(name: str, files: Mapping[str, bytes], modules: frozenset[str]) -> None:
    """Check the tree of objects ``NAME.pkl`` without making any of its objects."""
    data = files[f"{name}.pkl"]
    try:
        opcodes = Counter(opcode.name for opcode, _, _ in pickletools.genops(data))
        strange = next((opcode for opcode in opcodes if opcode not in _OPCODES), "")
        if not strange and opcodes.total() <= MOST_OPCODES:
            _Objects(name, files, modules).load()
    except ArchiveError:
        raise
    except Exception as error:  # pickle raises errors of any kind
        raise ArchiveError(
            f"{name}.pkl is damaged ({type(error).__name__}: {shortened(str(error))})"
        ) from error
    if strange or opcodes.total() > MOST_OPCODES:
        raise ArchiveError(f"{name}.pkl: {strange or opcodes.total()} opcodes are not allowed")


class _Objects(pickle.Unpickler):  # noqa: S301 - it finds no class but those below
    """Reader of a pickle that checks the tensors in it and makes inert objects alone."""

    def __init__(self, name: str, files: Mapping[str, bytes], modules: frozenset[str]) -> None:
        super().__init__(io.BytesIO(files[f"{name}.pkl"]))
        self._name, self._files, self._modules = name, files, modules

    def find_class(self, module: str, name: str) -> object:
        """Return a stand-in for an allowed class or function."""
        if module in self._modules and name.isidentifier():
            return type(name, (), {"__setstate__": lambda *_: None})
        if module == "torch" and name.removesuffix("Storage") in _STORED_BYTES:
            return name.removesuffix("Storage")
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return self._check_tensor
        if (module, name) == ("collections", "OrderedDict"):
            return dict
        if module == "torch.jit._pickle" and name in _OF_LISTS:
            return list
        raise ArchiveError(f"{self._name}.pkl: {f'{module}.{name}'[:80]} is not allowed")

    def persistent_load(self, pid: object) -> int:
        """Check that the stored numbers are there; return how many they are."""
        match pid:
            case ("storage", str(kind), str(key), "cpu", int(count)) if kind in _STORED_BYTES:
                stored = self._files.get(f"{self._name}/{key}")
                if stored is not None and len(stored) == count * _STORED_BYTES[kind]:
                    return count
        raise ArchiveError(f"{self._name}.pkl: no such numbers: {shortened(pid)}")

    def _check_tensor(
        self, count: int, offset: int, size: Sequence[int], stride: Sequence[int], *_: object
    ) -> None:
        """Check that a tensor lies within its numbers."""
        values = [count, offset, *size, *stride]
        whole = all(type(value) is int and value >= 0 for value in values)
        if not whole or len(size) != len(stride) or math.prod(size) > LARGEST_TENSOR:
            raise ArchiveError(f"{self._name}.pkl: a tensor of size {shortened(size)}")
        steps = ((length - 1) * step for length, step in zip(size, stride, strict=True))
        if 0 not in size and offset + sum(steps) >= count:
            raise ArchiveError(
                f"{self._name}.pkl: a tensor of size {shortened(size)} is not within its {count}"
                " numbers"
            )

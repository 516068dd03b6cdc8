# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile TorchScript archives with a right checksum are refused before torch reads them."""

import io
import json
import pickle
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from terrain_estimator.model.archive import (
    OF_PRIM,
    OPERATORS,
    ArchiveError,
    check_sources,
    checked_archive,
)
from terrain_estimator.model.metadata import MODELS, ModelFileError, fingerprint, model_names
from terrain_estimator.model.model_file import load_model

MODULE = "__torch__.terrain_estimator.model.palpaca"
SHIPPED = (MODELS / f"{model_names()[0]}.pt").read_bytes()
TOUCHING = "file|save|load|print|open|path|fork|wait|rpc|classes|system|warn|record|shared|pin"


def changed(change: Callable[[str, bytes], bytes | None], *added: tuple[str, bytes]) -> bytes:
    """Return a shipped archive with changed, left out (None) and added files."""
    packed = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(SHIPPED)) as source,
        zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as target,
    ):
        for entry in source.infolist():
            data = change(entry.filename.partition("/")[2], source.read(entry))
            if data is not None:
                target.writestr(entry.filename, data)
        for name, data in added:
            folder = source.namelist()[0].partition("/")[0]
            target.writestr(f"{folder}/{name}", data)
    return packed.getvalue()


def with_code(code: str) -> bytes:
    """Return a shipped archive whose main class has another method."""
    path = f"code/{MODULE.replace('.', '/')}.py"
    marker = b"  def forward("
    return changed(
        lambda name, data: (
            data.replace(marker, f"  {code}\n".encode() + marker, 1) if name == path else data
        )
    )


def placed(folder: Path, content: bytes) -> Path:
    """Write an archive beside a description with the right size and sha256."""
    path = folder / "model.pt"
    path.write_bytes(content)
    shutil.copy(MODELS / f"{model_names()[0]}.json", path.with_suffix(".json"))
    sha256, size = fingerprint(path)
    content_of = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps(content_of | {"sha256": sha256, "size": size}))
    return path


def method(body: str, name: str = "extra", given: str = "x: Tensor", result: str = "Tensor") -> str:
    return f"def {name}(self: {MODULE}.PAlpaca,\n    {given}) -> {result}:\n    {body}"


HOSTILE = {
    "save": (method('torch.save(x, "/tmp/x")\n    return x'), "operator torch.save"),
    "from_file": (method('return torch.from_file("/etc/passwd")'), "operator torch.from_file"),
    "method": (method('(x).save("/tmp/x")\n    return x'), "attribute save"),
    "of a text": (method('return ("a").save(x)'), "attribute save"),
    "of a text alone": (method('return "a".save(x)'), "attribute save"),
    "own name": (method("return x", "save") + "\n  " + method("return x.save()"), "attribute save"),
    "kept": (method('f = x.save\n    f("/tmp/x")\n    return x'), "attribute save"),
    "by name": (method('getattr(x, "save")("f")\n    return x'), "getattr"),
    "alias": (method("f = torch.save\n    return x"), "operator torch.save"),
    "alias of torch": (method("t = torch\n    return x"), "operator torch"),
    "alias of add": (method("f = torch.add\n    return x"), "operator torch.add"),
    "namespace": (method("return ops.aten.save(x)"), "operator ops.aten.save"),
    "prim": (method("return ops.prim.Print(x)"), "operator ops.prim.Print"),
    "library": (method("return ops.quantized.add(x, x)"), "operator ops.quantized"),
    "C++ class": (method("return __torch__.torch.classes.a.B()"), "is not defined in it"),
    "print": (method("print(x)\n    return x"), "print is not allowed"),
    "fork": (method("return fork(x)"), "fork is not allowed"),
    "with": (method("with x:\n      pass\n    return x"), "with is not allowed"),
    "constants": (method("return CONSTANTS.c0"), "CONSTANTS is not allowed"),
    "setstate": (method("return x", "__setstate__"), "special name __setstate__"),
    "getstate": (method("return x", "__getstate__"), "special name __getstate__"),
    "comment": (method("return x # type: a"), "sign '#'"),
    "escape": (method(r'return "\\x41"'), "sign"),
    "quotes": (method('return [""" " """, torch.save(x), """ " """]'), "sign"),
    "call of a call": (method("return (x)(x)"), "result of an expression is called"),
    "brackets": (method(f"return {'(' * 100}x{')' * 100}"), "brackets too deep"),
    "long": (method(f"return [{'x, ' * 5000}]"), "line too long"),
    "long chain": (method(f"return x{'.t' * 5000}"), "line too long"),
    "indentation": (method(" " * 500 + "return x"), "indented by"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_source_that_does_more_than_arithmetic_is_refused(name: str) -> None:
    code, words = HOSTILE[name]
    with pytest.raises(ArchiveError, match=words):
        checked_archive(with_code(code))


def test_no_allowed_operator_touches_files_or_other_processes() -> None:
    schemas = [
        str(schema)
        for name in OPERATORS
        for schema in torch._C._jit_get_schemas_for_operator(f"aten::{name}")
    ]
    assert len(schemas) > 500
    assert [each for each in schemas if "filename" in each] == []
    every = {schema.name for schema in torch._C._jit_get_all_schemas()}
    named = {name for name in every if any(word in name for word in TOUCHING.split("|"))}
    assert {"aten::save", "aten::from_file", "prim::Print"} <= named | {"prim::Print"}
    assert not named & ({f"aten::{name}" for name in OPERATORS} | {f"prim::{n}" for n in OF_PRIM})


class Writing(torch.nn.Module):
    """A module that writes a file while torch loads it."""

    def __init__(self) -> None:
        super().__init__()
        self.training = False

    @torch.jit.export
    def __getstate__(self) -> tuple[torch.Tensor, bool]:
        return torch.zeros(1), self.training

    @torch.jit.export
    def __setstate__(self, state: tuple[torch.Tensor, bool]) -> None:
        self.training = state[1]
        torch.ops.aten.save(state[0], "written")

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x


def test_a_model_that_writes_while_it_is_loaded_is_refused_before_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = io.BytesIO()
    torch.jit.save(torch.jit.script(Writing()), packed)
    monkeypatch.chdir(tmp_path)
    torch.jit.load(io.BytesIO(packed.getvalue()))  # type: ignore[no-untyped-call]
    (tmp_path / "written").unlink()  # torch itself lets it write
    with pytest.raises(ModelFileError, match=r"model\.pt: not a model of this package: source"):
        load_model(str(placed(tmp_path, packed.getvalue())))
    assert not (tmp_path / "written").exists()


ENDLESS = """
import sys
from terrain_estimator.model import model_file
model_file.LOADING_S = 2.0
model_file.load_model(sys.argv[1])
print("loaded")
"""


def test_a_model_that_does_not_end_ends_its_process_with_one_line_and_code_2(
    tmp_path: Path,
) -> None:
    path = f"code/{MODULE.replace('.', '/')}.py"
    endless = changed(
        lambda name, data: (
            data.replace(
                b"    known_soils = self.known_soils\n    known_soils0",
                b"    run = True\n    while run:\n      run = torch.__isnot__(run, None)\n"
                b"    known_soils = self.known_soils\n    known_soils0",
                1,
            )
            if name == path
            else data
        )
    )
    assert len(endless) != len(SHIPPED)
    done = subprocess.run(
        [sys.executable, "-c", ENDLESS, str(placed(tmp_path, endless))],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert done.stderr.strip().splitlines()[-1].endswith("loading took more than 2 s: not a model")


def pickled(*globals_: str) -> bytes:
    """Return a pickle of calls of these functions."""
    return (
        b"\x80\x02"
        + b"".join(f"c{name.replace(' ', chr(10))}\n)R".encode() for name in globals_)
        + b"."
    )


def test_pickles_name_no_other_function_and_tensors_lie_within_their_numbers() -> None:
    def with_pickle(data: bytes, *added: tuple[str, bytes]) -> bytes:
        return changed(lambda name, old: data if name == "constants.pkl" else old, *added)

    checked_archive(with_pickle(pickle.dumps((), 2)))
    for data, words in (
        (pickled("os system"), "constants.pkl: os.system is not allowed"),
        (pickled("builtins eval"), "builtins.eval is not allowed"),
        (pickle.dumps({1}, 4), "FRAME|EMPTY_SET|MEMOIZE|ADDITEMS opcodes"),
        (b"\x80\x02" + b"(" * 200_000 + b".", "opcodes are not allowed"),
        (b"\x80\x02N", "is damaged"),
    ):
        with pytest.raises(ArchiveError, match=words):
            checked_archive(with_pickle(data))
    for count, size, stride, words in (
        (4, (2,), (1,), "no such numbers"),
        (1, (10**6, 10**6), (0, 0), "a tensor of size"),
        (1, (2,), (1,), "not within its 1 numbers"),
        (1, (-1,), (1,), "a tensor of size"),
    ):
        with pytest.raises(ArchiveError, match=words):
            checked_archive(with_pickle(_tensor(count, size, stride), ("constants/0", bytes(8))))


def _tensor(count: int, size: tuple[int, ...], stride: tuple[int, ...]) -> bytes:
    """Return a tuple of one tensor as torch pickles it."""
    pid = b"(X\x07\0\0\0storagectorch\nDoubleStorage\nX\x01\0\0\0" + b"0X\x03\0\0\0cpu"
    numbers = [b"J" + value.to_bytes(4, "little", signed=True) for value in (count, *size, *stride)]
    sizes, strides = numbers[1 : 1 + len(size)], numbers[1 + len(size) :]
    return (
        b"\x80\x02(ctorch._utils\n_rebuild_tensor_v2\n("
        + pid
        + numbers[0]
        + b"tQK\0("
        + b"".join(sizes)
        + b"t("
        + b"".join(strides)
        + b"t\x89ccollections\nOrderedDict\n)RtRt."
    )


def test_zip_files_are_read_within_limits() -> None:
    def keep(_: str, data: bytes) -> bytes:
        return data

    for content, words in (
        (b"PK", "not a sound zip archive"),
        (changed(lambda name, data: None if name == "version" else data), "lacks the file version"),
        (changed(keep, ("extra/x", b"")), "is not one of a model"),
        (changed(keep, ("code/../x.py", b"")), "is not one of a model"),
        (changed(keep, ("data/900", bytes(65 << 20))), "unpacks to"),
        (changed(keep, *((f"data/{n}", b"") for n in range(1000, 4000))), "unpacks to"),
        (changed(lambda name, data: b"big" if name == "byteorder" else data), "order of bytes"),
    ):
        started = time.process_time()
        with pytest.raises(ArchiveError, match=words):
            checked_archive(content)
        assert time.process_time() - started < 5.0
    many = {f"{MODULE}_{n}": "def f(x: Tensor) -> Tensor:\n  return x\n" for n in range(500)}
    with pytest.raises(ArchiveError, match="500 functions, more than 400"):
        check_sources(many)
    with pytest.raises(ArchiveError, match="stands for classes of torch"):
        check_sources({"__torch__.torch.classes.a": ""})


@pytest.mark.parametrize("name", model_names())
def test_a_checked_archive_of_a_shipped_model_gives_the_same_numbers(name: str) -> None:
    content = (MODELS / f"{name}.pt").read_bytes()
    plain = torch.jit.load(io.BytesIO(content))  # type: ignore[no-untyped-call]
    state, again = plain.initial(), load_model(name).module.initial()
    assert state.keys() == again.keys()
    assert all(torch.equal(state[key], again[key]) or state[key].isnan().any() for key in state)

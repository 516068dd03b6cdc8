# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A folder with a model's C++ that builds without this package, and a library built from it."""

import os
import platform
import shutil
import subprocess
from pathlib import Path

from terrain_estimator.compiled.finding import PLAIN, WIDE
from terrain_estimator.compiled.readme import readme
from terrain_estimator.compiled.source import cpp_of
from terrain_estimator.model.metadata import read_metadata

RUNTIME = Path(__file__).parent / "runtime"
MODEL, README = "model.cpp", "README.md"
LIMIT_S = 600.0
"""[s] Time that a compiler may take, which takes 20 s otherwise."""


class BuildError(Exception):
    """A core could not be built; the text says why."""


def write_core(model: Path, folder: Path) -> None:
    """Write the C++ of the model at ``model`` with all that it needs into an empty ``folder``.

    Raises:
        ModelFileError: the file is not a model of this package.
        UntranslatableError: the model has no C++ form.
        OSError: the folder cannot be written.
    """
    text = cpp_of(model)
    folder.mkdir(parents=True, exist_ok=True)
    for part in sorted(RUNTIME.iterdir()):
        shutil.copyfile(part, folder / part.name)
    (folder / MODEL).write_text(text, encoding="utf-8")
    metadata = read_metadata(model.with_suffix(".json"))
    (folder / README).write_text(readme(metadata), encoding="utf-8")


def build_core(folder: Path, library: Path, *extra: str) -> None:
    """Compile the C++ in ``folder`` into a shared ``library``.

    The compiler is $CXX, or c++; ``extra`` are more of its flags.

    Raises:
        BuildError: there is no compiler, or it fails.
    """
    compiler = shutil.which(os.environ.get("CXX", "c++"))
    if compiler is None:
        raise BuildError("there is no C++ compiler: install g++, or name one in $CXX")
    lines = (folder / "compile_flags.txt").read_text(encoding="utf-8").splitlines()
    flags = [line for line in lines if line.startswith("-")]
    made = library.with_name(f".{library.name}.part")
    command = [
        compiler, *flags, *extra, "-fPIC", "-shared", f"-I{folder}", "-o", str(made),
        str(folder / MODEL),
    ]  # fmt: skip
    try:
        done = subprocess.run(  # noqa: S603 (the user's own compiler)
            command, capture_output=True, text=True, check=False, timeout=LIMIT_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BuildError(f"{compiler}: {error}") from error
    if done.returncode != 0:
        first = next((line for line in done.stderr.splitlines() if "error" in line), "no message")
        raise BuildError(f"{compiler} fails on {folder / MODEL}: {first}")
    made.replace(library)


def flags_by_end() -> dict[str, tuple[str, ...]]:
    """Return more flags for each library of this kind of processor, by how its name ends.

    All of them give the same bytes, in registers of another width.
    """
    if platform.machine() != "x86_64":
        return {PLAIN: ()}
    # compilers take half of the widest registers, unless they are told to take all; loops that they
    # write out number by number fill the cache of instructions
    more = ("-mprefer-vector-width=512", "--param=max-completely-peeled-insns=48")
    wide = {end: (*(f"-m{each}" for each in needed), *more) for end, needed in WIDE.items()}
    return {PLAIN: (), **wide}

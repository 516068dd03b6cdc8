# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write results to a folder: over nothing that is not ours, and whole before old ones go."""

import fcntl
import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from terrain_estimator.files.atomic import (
    UNFINISHED,
    OutputError,
    cannot_write,
    discard,
    is_refusal_of,
    sync_entries,
    unforeseeable,
    write_file,
)

MANIFEST = "manifest.json"
"""Name of the file that lists what this suite wrote to a folder."""
_FORMAT = "terrain_estimator results 1"
_LARGEST_MANIFEST = 16 << 20  # bytes
_ELSEWHERE = "move it away, or give another folder"
Sums = dict[str, list[str]]
"""SHA-256 of files, by path in the folder: the one in force last, after that of its predecessor.

A kill between the writing of the list and of the results thus leaves files that are both ours.
"""


class ResultFolder:
    """A folder that is new, empty, or has a list of what this suite wrote to it.

    What the list does not have, or what has changed since, is never replaced nor removed. Symbolic
    links are not followed, neither in the place of the folder nor inside.
    """

    def __init__(self, path: Path) -> None:
        """Check the folder, and leave it as it is; raises OutputError."""
        self.path = path
        self._sums()

    def check(self, *names: str) -> None:
        """Raise OutputError where a result of one of these names could not be replaced."""
        self._check(names, self._sums())

    @contextmanager
    def renewing(self, *names: str, despite: type[Exception] | tuple[()] = ()) -> Iterator[Path]:
        """Yield an empty folder, whose files and folders take the place of ``names`` at the end.

        An old result of which there is no new one is removed. After an exception other than
        ``despite`` all old results stay as they were, and nothing is left of the new ones.

        Raises:
            OutputError: something is in the way that is not ours; this is found before the block
                begins. Or the disk is full or broken.
        """
        made, new = [], self.path / unforeseeable("results")
        try:
            made = _make_folders(self.path)
            self._check(names, self._sums())
            new.mkdir()
            try:
                yield new
            except despite:
                self._take_over(new, names)
                raise
            self._take_over(new, names)
        except OSError as error:
            if is_refusal_of(error, new):
                raise cannot_write(self.path, error) from error
            raise
        finally:
            discard(new)
            _remove_empty(made)

    def _take_over(self, new: Path, names: tuple[str, ...]) -> None:
        """List the new results, put them in their places, then remove the old ones."""
        with _locked(self.path):
            sums = self._sums()
            old = self._check(names, sums)
            present = {name: sums[name] for name in sums if os.path.lexists(self.path / name)}
            for name in _files(new):
                present[name] = [*present.get(name, [])[-1:], _sha256(new / name)]
            content = {"format": _FORMAT, "files": dict(sorted(present.items()))}
            write_file(self.path / MANIFEST, json.dumps(content, indent=1) + "\n")
            aside = self.path / unforeseeable("replaced")
            aside.mkdir()
            try:
                _exchange(names, new, self.path, aside)
            except BaseException:
                _remove_empty([aside])
                raise
            _remove(aside, old)

    def _check(self, names: tuple[str, ...], sums: Mapping[str, list[str]]) -> list[str]:
        """Return the files of old results; OutputError for one that is not as we wrote it."""
        if MANIFEST in names:
            raise OutputError(f"{self.path / MANIFEST}: is the list of results: use another name")
        old = [file for name in names for file in _files(self.path, name)]
        for file in old:
            if file not in sums:
                raise OutputError(
                    f"{self.path / file}: was not written by this suite and is left alone:"
                    f" {_ELSEWHERE}"
                )
            if (found := _sha256(self.path / file)) not in sums[file] or not found:
                raise OutputError(
                    f"{self.path / file}: has changed since it was written and is left alone:"
                    f" {_ELSEWHERE}"
                )
        return old

    def _sums(self) -> Sums:
        """Return the list of our files, empty for a new or empty folder; raises OutputError."""
        try:
            mode = self.path.lstat().st_mode
        except FileNotFoundError:
            return {}
        except OSError as error:
            raise cannot_write(self.path, error) from error
        if not stat.S_ISDIR(mode):
            kind = "a symbolic link" if stat.S_ISLNK(mode) else "a file"
            raise OutputError(f"{self.path}: is {kind}, not a folder: give the folder itself")
        try:
            found = sorted(each.name for each in self.path.iterdir())
        except OSError as error:
            raise cannot_write(self.path, error) from error
        if MANIFEST in found:
            return _read(self.path / MANIFEST)
        if foreign := [name for name in found if not name.endswith(UNFINISHED)]:
            raise OutputError(
                f"{self.path}: holds {foreign[0]} and no {MANIFEST} of this suite, so its files are"
                " left alone: give a new or empty folder"
            )
        return {}


@contextmanager
def adding(folder: Path, *names: str) -> Iterator[Path]:
    """Yield an empty folder, whose files and folders ``names`` move to ``folder`` at the end.

    ``folder`` may hold anything else, and is made where it is missing. After an exception nothing
    is left.

    Raises:
        OutputError: there is something of such a name already, which is found before the block
            begins, or the disk is full or broken.
    """
    for name in names:
        check_new(folder / name)
    made, new, moved = [], folder / unforeseeable("results"), []
    try:
        made = _make_folders(folder)
        new.mkdir()
        yield new
        for name in (each for each in names if os.path.lexists(new / each)):
            check_new(folder / name)
            (new / name).rename(folder / name)  # a folder takes the place of none but an empty one
            moved.append(name)
        sync_entries(folder)
    except BaseException as error:
        for name in moved:
            (folder / name).rename(new / name)
        if isinstance(error, OSError) and is_refusal_of(error, new):
            raise cannot_write(Path(folder, *names[:1]), error) from error
        raise
    finally:
        discard(new)
        _remove_empty(made)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a place for a folder, which becomes ``path`` at the end, by :func:`adding`."""
    path = path if path.name not in {"", ".."} else path.resolve()
    with adding(path.parent, path.name) as new:
        yield new / path.name


def write_new(path: Path, content: bytes | str) -> None:
    """Write a file where none is yet, by :func:`adding`."""
    with adding(path.parent, path.name) as new:
        write_file(new / path.name, content)


def check_new(path: Path) -> None:
    """Raise OutputError where something is at ``path`` already, also a symbolic link to nothing."""
    if os.path.lexists(path):
        raise OutputError(f"{path} exists already: choose another name, it is never overwritten")


def _make_folders(path: Path) -> list[Path]:
    """Make a folder and those above it; return the new ones, outermost first.

    Raises OutputError.
    """
    new = [each for each in (path, *path.parents) if not os.path.lexists(each)]
    made: list[Path] = []
    try:
        for folder in reversed(new):
            folder.mkdir(exist_ok=True)
            made.append(folder)
            sync_entries(folder.parent)
    except OSError as error:
        _remove_empty(made)
        raise cannot_write(path, error) from error
    return made


def _remove_empty(folders: list[Path]) -> None:
    """Remove those of our new folders, outermost first, in which nothing is."""
    with suppress(OSError):
        for folder in reversed(folders):
            folder.rmdir()


def _files(folder: Path, name: str = ".") -> list[str]:
    """Return what is at ``name`` in a folder, by path in it: a file, or all files of a folder.

    A symbolic link counts as a file.
    """
    found, waiting = [], [name] if os.path.lexists(folder / name) else []
    while waiting:
        place = folder / (each := waiting.pop())
        if place.is_symlink() or not place.is_dir():
            found.append(each)
        else:
            waiting += [str(Path(each, inner.name)) for inner in place.iterdir()]
    return sorted(found)


def _sha256(path: Path) -> str:
    """Return the SHA-256 of a file, empty for a symbolic link or what is no file."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return ""
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            return ""
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read(path: Path) -> Sums:
    """Read a list of files; OutputError where it is not ours."""
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            content = json.loads(file.read(_LARGEST_MANIFEST))
        sums = {str(name): [*map(str, each)] for name, each in content["files"].items()}
        ours = content["format"] == _FORMAT
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        sums, ours = {}, False
    if not ours:
        raise OutputError(
            f"{path}: is no list of results of this suite, or is damaged: {_ELSEWHERE}"
        )
    return sums


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other commands from changing the results at the same time, where the disk has locks."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _exchange(names: tuple[str, ...], new: Path, place: Path, aside: Path) -> None:
    """Put new results in their places and old ones aside; undo all where one move fails."""
    brought = [name for name in names if os.path.lexists(new / name)]
    try:
        for name in names:
            if os.path.lexists(place / name):
                _put_aside(place / name, aside / name, stays=(new / name).is_file())
            if name in brought:
                (new / name).rename(place / name)
        sync_entries(place)
    except BaseException:
        for name in names:
            if name in brought and not os.path.lexists(new / name):
                (place / name).rename(new / name)
            if os.path.lexists(place / name) and os.path.lexists(aside / name):
                (aside / name).unlink()  # the second name of a file that stayed
            elif os.path.lexists(aside / name):
                (aside / name).rename(place / name)
        raise


def _put_aside(old: Path, aside: Path, *, stays: bool) -> None:
    """Move an old result; a file ``stays`` in its place, too, until its successor replaces it."""
    if stays and old.is_file():
        with suppress(OSError):  # a file system without hard links
            os.link(old, aside, follow_symlinks=False)
            return
    old.rename(aside)


def _remove(folder: Path, files: list[str]) -> None:
    """Remove these files and the folders that are then empty; what came meanwhile stays."""
    with suppress(OSError):
        for file in files:
            (folder / file).unlink()
        for inner, _, _ in os.walk(folder, topdown=False):
            Path(inner).rmdir()

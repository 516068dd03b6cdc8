# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write one file whole or not at all."""

import io
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EINTR, EINVAL, ENOTSUP
from pathlib import Path
from typing import BinaryIO

UNFINISHED = ".unfinished"
"""Ending of a file or folder that is being written; a kill leaves it behind."""
_NEW = os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
_LONGEST_NAME = 255  # bytes, on the usual file systems


class OutputError(OSError):
    """A result cannot be written; the message names the file, the reason and the remedy.

    ``errno`` is that of the system call, if one failed.
    """

    def __init__(self, message: str, errno: int | None = None) -> None:
        """Keep the message as the only argument."""
        super().__init__(message)
        self.errno, self.strerror = errno, message

    def __str__(self) -> str:
        """Return the message alone, which OSError would put behind the number."""
        return str(self.strerror)


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a file that takes the place of ``path`` when the block ends, and is then on the disk.

    After an exception, ``path`` is as it was before, and nothing else is left. The file is written
    beside ``path`` under a name that nobody can foresee. A file that is replaced hands on its
    permissions.

    Raises:
        OutputError: ``path`` is a symbolic link, a folder or a device, or the disk is full or
            broken. An error that names another file is raised as it is.
    """
    try:
        folder = os.open(path.parent, _FOLDER)
    except OSError as error:
        raise cannot_write(path, error) from error
    try:
        mode = _mode(path, folder)
        name = unforeseeable(path.name)
        try:
            yield from _written(name, mode, folder)
            os.rename(name, path.name, src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException as error:
            with suppress(OSError):
                os.unlink(name, dir_fd=folder)
            if isinstance(error, OSError) and is_refusal_of(error, Path(name)):
                raise cannot_write(path, error) from error
            raise
        try:
            sync_entries(folder)
        except OSError as error:
            raise OutputError(
                f"{path}: is written, but a power cut may undo it ({error.strerror})", error.errno
            ) from error
    finally:
        _close(folder)


def write_file(path: Path, content: bytes | str) -> None:
    """Write a whole file, text in UTF-8, as :func:`replacing` does; raises OutputError."""
    with replacing(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def unforeseeable(name: str) -> str:
    """Return a hidden, random name for something unfinished that will be called ``name``."""
    ending = f".{secrets.token_hex(8)}{UNFINISHED}"
    start = name.encode()[: _LONGEST_NAME - len(ending) - 1].decode(errors="ignore")
    return f".{start}{ending}"


def discard(folder: Path) -> None:
    """Remove a folder that this process made, with all in it, as far as the disk lets it.

    Where closing a folder fails, shutil closes it again and stops; the second try removes the rest.
    """
    for _ in range(2):
        with suppress(OSError):
            shutil.rmtree(folder, ignore_errors=True)
        if not os.path.lexists(folder):
            return


def is_refusal_of(error: OSError, path: Path) -> bool:
    """Return whether the disk refused ``path``, or a file in it; a write's error has no name."""
    return (
        not isinstance(error, OutputError)
        and error.errno is not None
        and (error.filename is None or Path(error.filename).is_relative_to(path))
    )


def _mode(path: Path, folder: int) -> int:
    """Return the permissions of the file at ``path``, or those of a new one."""
    try:
        found = os.stat(path.name, dir_fd=folder, follow_symlinks=False).st_mode
    except FileNotFoundError:
        return 0
    except OSError as error:
        raise cannot_write(path, error) from error
    if not stat.S_ISREG(found):
        kind = "a symbolic link" if stat.S_ISLNK(found) else "a folder or a device"
        raise OutputError(f"{path}: is {kind}, not a file: it is left alone; give another name")
    return stat.S_IMODE(found)


def _written(name: str, mode: int, folder: int) -> Iterator[BinaryIO]:
    descriptor = os.open(name, _NEW | os.O_WRONLY, 0o666, dir_fd=folder)
    try:
        if mode:
            os.fchmod(descriptor, mode)
        file = io.BufferedWriter(raw := io.FileIO(descriptor, "wb", closefd=False))
        try:
            yield file
            file.flush()
            os.fsync(descriptor)
        finally:
            raw.close()  # without a last flush, whose error would hide that of the block
    except BaseException:
        with suppress(OSError):
            os.close(descriptor)
        raise
    _close(descriptor)  # a network file system may report a full disk only here


def sync_entries(folder: Path | int) -> None:
    """Make new names in a folder, or in one that is open, durable where the file system can.

    Raises OSError.
    """
    try:
        descriptor = folder if isinstance(folder, int) else os.open(folder, _FOLDER)
    except PermissionError:  # a folder that may be written but not read
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in {EINVAL, ENOTSUP}:
            raise
    finally:
        if descriptor != folder:
            os.close(descriptor)


def _close(descriptor: int) -> None:
    """Close; Linux has closed the file also where a signal interrupts the call."""
    try:
        os.close(descriptor)
    except OSError as error:
        if error.errno != EINTR:
            raise


def cannot_write(path: Path, error: OSError) -> OutputError:
    """Return the error for a result that the disk refused."""
    return OutputError(
        f"{path}: cannot be written ({error.strerror}), and nothing there has changed: make room,"
        " or give another place that you may write",
        error.errno,
    )

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Turn a finished unchunked recording into zstd chunks.

The data is on the disk at every moment.
"""

import os
from collections.abc import Callable
from pathlib import Path

from mcap.stream_reader import StreamReader

from terrain_estimator.bags.writing.copying import Copier
from terrain_estimator.bags.writing.syncing import sync_folder

TEMPORARY_SUFFIX = ".compacting"


def compact(path: Path, moved: Callable[[], None] = lambda: None) -> None:
    """Replace a finished file by one with the same records in compressed chunks.

    A crash leaves the old file or the new one, and at most a temporary file next to it. ``moved``
    is called at every step.

    Raises:
        OSError: no space or no permission; the old file is then untouched.
    """
    temporary = path.with_name(path.name + TEMPORARY_SUFFIX)
    try:
        with path.open("rb") as source, temporary.open("wb") as target:
            copier = Copier(target)
            for record in StreamReader(source).records:
                copier.take(record)
                moved()
            copier.finish()
            target.flush()
            os.fsync(target.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)

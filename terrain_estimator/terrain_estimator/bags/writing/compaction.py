# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Turn a finished unchunked recording into zstd chunks.

The data is on the disk at every moment.
"""

from collections.abc import Callable
from pathlib import Path

from mcap.stream_reader import StreamReader

from terrain_estimator.bags.writing.copying import Copier
from terrain_estimator.files.atomic import replacing


def compact(path: Path, moved: Callable[[], None] = lambda: None) -> None:
    """Replace a finished file by one with the same records in compressed chunks.

    A crash leaves the old file or the new one, and at most a temporary file next to it. ``moved``
    is called at every step.

    Raises:
        OSError: no space or no permission; the old file is then untouched.
    """
    with path.open("rb") as source, replacing(path) as target:
        copier = Copier(target)
        for record in StreamReader(source).records:
            copier.take(record)
            moved()
        copier.finish()

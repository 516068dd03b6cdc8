# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The thread that keeps the state on the disk outlives what goes wrong there."""

from pathlib import Path

import pytest

from terrain_estimator.nodes import keeping
from tests.system.waiting import wait_until


def test_whatever_a_write_raises_is_said_once_and_the_next_state_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    errors = [OSError(28, "No space left on device"), ValueError("embedded null byte"), None]
    written: list[bytes] = []
    said: list[str] = []

    def write(_: Path, content: bytes) -> None:
        if error := errors.pop(0):
            raise error
        written.append(content)

    monkeypatch.setattr(keeping, "write_state", write)
    keeper = keeping.StateKeeper(tmp_path / "state", said.append)
    for failures in (1, 2, 0):
        left = len(errors) - 1
        keeper.give(b"state")
        wait_until(lambda left=left, failures=failures: (len(errors), keeper.failures) == (left, failures), "the next write was tried")  # type: ignore[misc]
    keeper.end()
    assert written == [b"state"]
    assert len(said) == 1
    assert "No space left on device; trying on" in said[0]

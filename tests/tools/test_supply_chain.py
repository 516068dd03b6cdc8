# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The audit tells a package without known flaws from one that it could not look up."""

import re
from typing import Any

import pytest

from tools.supply_chain import LISTS, verdict

GOOD: dict[str, Any] = {"name": "a", "version": "1", "vulns": []}
BAD = {"name": "b", "version": "2", "vulns": [{"id": "CVE-1", "fix_versions": ["3"]}]}
UNKNOWN = {"name": "c", "skip_reason": "Dependency not found on PyPI"}


@pytest.mark.parametrize(
    ("found", "code", "words"),
    [
        ([GOOD], 0, "1 packages checked, 0 known"),
        ([GOOD, BAD], 1, "b 2: CVE-1, mended in 3"),
        ([GOOD, UNKNOWN], 2, "1 of 2 packages were NOT checked"),
        ([BAD, UNKNOWN], 1, "1 of 2 packages were NOT checked"),
    ],
)
def test_what_was_not_checked_is_not_called_good(
    found: list[dict[str, Any]], code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verdict(found) == code
    said = capsys.readouterr()
    assert words in said.out + said.err


def test_every_list_has_the_hashes_that_both_tools_need() -> None:
    for path in LISTS:
        lines = path.read_text(encoding="utf-8").splitlines()
        pins = [line for line in lines if not line.startswith("#")]
        assert all(re.search(r"==.* --hash=sha256:[0-9a-f]{64}( |$)", pin) for pin in pins), path

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Generated pages are up to date with the code."""

import pytest

from docs.pages import FOLDER, PAGES


@pytest.mark.parametrize("name", PAGES)
def test_a_written_page_is_the_one_that_the_code_writes(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == PAGES[name](), "run make pages"

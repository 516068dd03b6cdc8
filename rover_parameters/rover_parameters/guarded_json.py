# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""JSON from elsewhere, within limits of size and depth."""

import json
import re

from rover_parameters.records import ConfigError, shortened

DEEPEST = 64
"""Largest number of lists and objects within each other; Python's reader ends at about 1000."""
# a text that is not closed reaches to the end, so that it is searched once
_STRUCTURE = re.compile(r'"(?:[^"\\]++|\\.)*+\\?+(?:"|\Z)|[\[\]{}]', re.DOTALL)


def parse_json(text: str | bytes) -> object:
    """Parse a JSON text. Raises ConfigError for all that is not valid, and for greater depth."""
    try:
        read = text if isinstance(text, str) else text.decode("utf-8")
        _check_depth(read)
        return json.loads(read)
    except ConfigError:
        raise
    except ValueError as error:  # also of bytes that are not UTF-8, and of 5000-digit numbers
        raise ConfigError(shortened(str(error))) from error


def _check_depth(text: str) -> None:
    depth = 0
    for match in _STRUCTURE.finditer(text):
        depth += (match[0] in "[{") - (match[0] in "]}")
        if depth > DEEPEST:
            raise ConfigError(f"more than {DEEPEST} lists and objects within each other")

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Make docstrings Markdown: units in brackets are no links, :func:`name` is code."""

import re
from typing import Any

from griffe import Extension, Object

_CODE_OR_BRACKET = re.compile(r"``.*?``|`.*?`|^ {4}.*$|\[", re.DOTALL | re.MULTILINE)
_ROLE = re.compile(r":(?:func|class|meth|mod|attr):(?=`)")


class Prose(Extension):
    """Prepare every docstring that the API reference shows."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Escape brackets outside code, and drop the roles of reStructuredText."""
        if obj.docstring:
            obj.docstring.value = prose(obj.docstring.value)


def prose(text: str) -> str:
    """Return a docstring as Markdown."""
    text = _ROLE.sub("", text)
    return _CODE_OR_BRACKET.sub(lambda match: r"\[" if match[0] == "[" else match[0], text)

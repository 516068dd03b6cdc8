# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pages for people: one look, and the few functions that every page is built from.

    from terrain_estimator.pages import page
    from terrain_estimator.pages.pictures import bars

    picture = bars("gains", "What each effect gains", ("drive_drag", "payload"), (41.0, 3.0), "log evidence [nat]")
    text = page("my_page.html", title="A page", picture=picture)

- ``page``: fills a template of ``templates/``; everything is escaped, and the result is one file
  that asks for no other.
- ``numbers``: numbers as people read them, each in a ``<data>`` element that holds the whole value.
- ``pictures``: inline SVG in the colours of ``style.css``, each with its words and its table.
- ``courses``: pictures over time: a value in its bands, curves, what happened when.
- ``finding``: the report of find_missing_effect; ``run``: that of replay.

A template extends ``page.html``, which brings the style, and imports ``parts.html``. Colours are
close to those of Okabe and Ito (2008), which colour-blind readers tell apart; nothing is said by
colour alone. No files are written, and there is no clock: a page is a pure function of its values.
"""

from terrain_estimator.pages.page import page

__all__ = ["page"]

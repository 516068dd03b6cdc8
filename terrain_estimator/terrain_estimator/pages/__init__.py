# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pages for people: one style, and the few functions that build every page.

    from terrain_estimator.pages import page
    from terrain_estimator.pages.pictures import bars

    gains = (41.0, 3.0)
    picture = bars("gains", "Gain of each effect", ("drive_drag", "payload"), gains, "nat")
    text = page("my_page.html", title="A page", picture=picture)

- ``page``: fills a template of ``templates/``; everything is escaped, and the result is one file
  that needs no other.
- ``number_format``: formatted numbers, each in a ``<data>`` element that holds the whole value.
- ``pictures``: inline SVG in the colours of ``style.css``, each with its description and table.
- ``time_pictures``: pictures over time: a value in its bands, curves, and occurrences.
- ``finding``: the report of find_missing_effect; ``run``: that of replay.

A template extends ``page.html``, which has the style, and imports ``parts.html``. Colours are close
to those of Okabe and Ito (2008), which colour-blind readers can distinguish; colour never carries
information alone. No files are written, and there is no clock: a page is a pure function of its
values.
"""

from terrain_estimator.pages.page import page

__all__ = ["page"]

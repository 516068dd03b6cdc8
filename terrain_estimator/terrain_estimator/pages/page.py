# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Templates of pages, filled in."""

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined

from terrain_estimator.pages.number_format import chance, interval, number, probability, words


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("terrain_estimator.pages", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "interval": interval,
        "probability": probability,
        "chance": chance,
        "words": words,
    }
    return environment


def page(template: str, **values: object) -> str:
    """Return the HTML page of ``template`` with ``values``; a missing value is an error."""
    return _environment().get_template(template).render(values)

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Reports in a real browser: no console output, no requests, and the values of their source."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from tests.browser import chromium, needs_chromium, opened
from tests.samples import sampled
from tests.terrain_estimator.pages import runs
from tests.terrain_estimator.pages.findings import finding, report

pytestmark = needs_chromium
PHONE, DESK = 360, 1200


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    def write(what: str) -> Path:
        path = tmp_path / f"{what}.html"
        path.write_text(runs.report() if what == "runs" else report(what), encoding="utf-8")
        return path

    return write


def values(page: Page, selector: str) -> list[float]:
    """Return the whole numbers behind those on the page."""
    return [
        float(each)
        for each in page.locator(f"{selector} data").evaluate_all(
            "all => all.map(each => each.value)"
        )
    ]


@pytest.mark.parametrize(
    ("what", "width", "scheme"),
    sampled(
        [("named", PHONE, "dark"), ("confusable", PHONE, "light"), ("runs", PHONE, "dark")],
        [
            ("named", PHONE, "dark"),
            ("named", DESK, "light"),
            ("confusable", PHONE, "light"),
            ("unknown", DESK, "dark"),
            ("none", PHONE, "light"),
            ("runs", PHONE, "dark"),
        ],
    ),
)
def test_the_report_opens_quietly_fits_and_is_usable_by_everyone(
    browser: Browser, written: Callable[[str], Path], what: str, width: int, scheme: str
) -> None:
    path = written(what)
    with opened(browser, path, width, scheme) as it:
        page = it.page
        assert it.said == []
        assert it.asked_for == [path.as_uri()]
        page.locator("details").evaluate_all("all => all.forEach(each => each.open = true)")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        violations = Axe().run(page)
        assert violations.violations_count == 0, violations.generate_report()
        assert page.locator("h1").count() == 1
        assert (
            page.locator("figure").count()
            == page.locator("figure [role=img][aria-label]").count()
            == page.locator("figure table").count()
        )
        identifiers = page.locator("[id]").evaluate_all("all => all.map(each => each.id)")
        assert len(identifiers) == len(set(identifiers))


def test_what_is_shown_is_what_the_finding_holds(
    browser: Browser, written: Callable[[str], Path]
) -> None:
    given = finding("named")
    with opened(browser, written("named"), DESK) as it:
        page = it.page
        for name in ("drive_drag", "coulomb_drag"):
            assert values(page, f"#candidate-{name}") == [given["probabilities"][name]]
        assert "99.1\u00a0%" in page.locator("#candidate-drive_drag").inner_text()
        assert "0.2005 ± 0.0032 N m s/rad (95 % interval 0.1943 to 0.2067)" in page.locator(
            ".verdict"
        ).inner_text().replace("\u00a0", " ")
        gap = given["gap"]
        proof = page.locator("#proof + p")
        assert (
            "Proof: drive_drag is added: rollouts miss by 1.08 instead of 1.93."
            in proof.inner_text()
        )
        assert values(page, "#proof + p") == [gap["closed"], *gap["closed_95"]]
        assert values(page, "#gap") == [
            gap["before"],
            gap["after"],
            gap["noise_floor"],
            gap["closed"],
            *gap["closed_95"],
        ]
        before, after = given["parameters"]["before"], given["parameters"]["after"]
        assert values(page, "#cohesion_pa tbody tr:first-child") == pytest.approx([3.6991, 3.1])
        assert values(page, "#held-out-cohesion_pa tbody tr:first-child") == pytest.approx(
            [3.6, 1.96 * 0.21, 3.05, 1.96 * 0.18], rel=1e-4
        )
        assert values(page, "#rollout-velocity tbody tr:last-child") == [0.12, 0.16, 0.125]
        assert (
            len(before["tan_phi"])
            == len(after["tan_phi"])
            == page.locator("#tan_phi tbody tr").count()
        )
        assert values(page, ".matrix") == [810.0, 12.5, 450.0, 1.25]
        assert page.locator(".matrix .alike").count() == 1
        shown = page.locator("#content").inner_text()
        for text in (
            "torque_1 row, speed, above 0.12 m/s",
            "lateral_bulldozing",
            "ab" * 32,
            "cd" * 32,
            "dune_3",
        ):
            assert text in shown


def test_bars_are_as_long_as_the_probabilities_are_large(
    browser: Browser, written: Callable[[str], Path]
) -> None:
    with opened(browser, written("confusable"), DESK) as it:
        lengths = it.page.locator(".bar").evaluate_all(
            "all => all.slice(0, 2).map(each => each.getBoundingClientRect().width)"
        )
        assert lengths[0] / lengths[1] == pytest.approx(0.55 / 0.44, rel=0.01)


def test_pictures_are_drawn_in_the_colours_of_light_and_dark(
    browser: Browser, written: Callable[[str], Path]
) -> None:
    path = written("named")
    colours = []
    for scheme in ("light", "dark"):
        with opened(browser, path, DESK, scheme) as it:
            colours.append(
                it.page.locator("figure svg text").first.evaluate(
                    "each => getComputedStyle(each).fill"
                )
            )
            assert (
                it.page.locator("figure svg").first.evaluate(
                    "each => each.getBoundingClientRect().width"
                )
                > 200
            )
    assert colours == ["rgb(22, 25, 29)", "rgb(233, 235, 236)"]


def test_the_keyboard_reaches_the_content_and_opens_a_table(
    browser: Browser, written: Callable[[str], Path]
) -> None:
    with opened(browser, written("named"), PHONE) as it:
        page = it.page
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
        page.locator("figure summary").first.focus()
        page.keyboard.press("Enter")
        assert page.locator("figure table").first.is_visible()


def test_a_band_of_a_run_is_drawn_where_its_numbers_say(
    browser: Browser, written: Callable[[str], Path]
) -> None:
    with opened(browser, written("runs"), DESK) as it:
        page = it.page
        rows = page.locator("#run-1-cohesion tbody tr").evaluate_all(
            "all => all.map(row => [...row.querySelectorAll('data')].map(each =>"
            " Number(each.value)))"
        )
        assert all(
            low_95 <= low <= mean <= high <= high_95 for mean, low, high, low_95, high_95, _ in rows
        )
        truth = [row[-1] for row in rows]
        assert truth == sorted(truth)
        assert {round(each, 9) for each in truth} == {0.83, 1.8}
        assert page.locator("#run-1-change text", has_text="true change").is_visible()
        page.get_by_role("link", name="rock").click()
        assert page.evaluate("location.hash") == "#run-2"

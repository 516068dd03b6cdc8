# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The live page as a process of its own, in a real browser, also after a restart."""

import re
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from terrain_estimator.dashboard.values import TOPICS
from terrain_estimator.nodes.common.message_types import make, message_class
from terrain_estimator.topics import TRUTH
from tests.browser import chromium, needs_chromium, opened
from tests.system.listening import LATCHED, RELIABLE, Listener
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until
from tests.terrain_estimator.dashboard.messages import advice, estimate, health, instant, truth

pytestmark = needs_chromium
PHONE, DESK = 360, 1280
STEPS = 40


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


class Rover:
    """Says on every topic that is shown what a rover would say."""

    def __init__(self, listener: Listener, namespace: str = "") -> None:
        self._listener = listener
        quality = {
            topic: LATCHED if kind == TRUTH else RELIABLE for topic, (kind, _) in TOPICS.items()
        }
        self._outputs = {
            topic: listener.publisher(
                message_class(kind), f"{namespace}/{topic}" if namespace else topic, quality[topic]
            )
            for topic, (kind, _) in TOPICS.items()
        }

    def say(self, topic: str, message: Any) -> None:
        self._outputs[topic].publish(message)

    def drive(self, steps: range) -> None:
        for step in steps:
            for topic, message in instant(make, step):
                self.say(topic, message)
            self._listener.spin_until(lambda: True, "what was said has left")


def url_of(process: Process) -> str:
    return process.wait_for_output(r"ready: (\S+)", timeout=60.0)[1]


def number(page: Page, selector: str) -> float | None:
    value = page.locator(selector).first.get_attribute("value")
    return None if value is None else float(value)


def shown(page: Page, selector: str) -> list[float]:
    return [
        float(value)
        for value in page.locator(selector).evaluate_all("all => all.map(each => each.value)")
    ]


def awaits(page: Page, selector: str, value: float) -> None:
    wait_until(
        lambda: number(page, selector) == value,
        f"{selector} shows {value}",
        seen=lambda: number(page, selector),
    )


def values_now(step: int) -> dict[str, list[float]]:
    """Return the texts to be shown, by selector."""
    said = dict(instant(make, step))
    ground, place, state = (
        said["terrain_estimate"],
        said["odom"].pose.pose.position,
        health(make, step),
    )
    named = (
        "cohesion",
        "cohesion_stddev",
        "cohesion_lower_95",
        "tan_phi",
        "tan_phi_stddev",
        "tan_phi_upper_95",
        "change_probability",
    )
    effects = [
        number
        for pair in zip(ground.effect_value, ground.effect_stddev, strict=True)
        for number in pair
    ]
    return {
        **{
            f'[data-path="terrain_estimate/{name}"] >> nth=0': [getattr(ground, name)]
            for name in named
        },
        **{f'[data-path="odom/{axis}"]': [getattr(place, axis)] for axis in ("x", "y", "z")},
        '[data-path="odom/velocity"]': [said["odom"].twist.twist.linear.x],
        "#wheel-table td:nth-child(2) data": list(said["wheel_slip"].slip),
        "#wheel-table td:nth-child(4) data": list(reversed(said["wheel_sinkage"].sinkage)),
        "#effect-table data": effects,
        "#inputs data": [
            state.input_received[0],
            state.input_unpaired[0],
            state.input_lost[0],
            state.input_age[0],
        ],
        "#counts data": [step // 10, 0, step, 7, 1.07, 0.00125, 0],
    }


@pytest.mark.parametrize(("width", "scheme"), [(PHONE, "dark"), (DESK, "light")])
def test_the_page_shows_what_the_topics_say_to_everybody_and_asks_nobody_else(
    start: Starter, listener: Listener, browser: Browser, width: int, scheme: str
) -> None:
    process = start(
        "terrain_estimator", "dashboard", "--ros-args", "-p", "port:=0", "-p", "rate:=20.0"
    )
    url, rover, last = url_of(process), Rover(listener), STEPS - 1
    rover.say("ground_truth/terrain", truth(make))
    with opened(browser, url, width, scheme) as it:
        page = it.page
        rover.drive(range(STEPS))
        rover.say("estimator_health", health(make, last))
        rover.say("traction_advice", advice(make, last, stop=True))
        awaits(page, "#counts data", last // 10)
        awaits(page, '[data-path="terrain_estimate/cohesion"]', 1500.0 + last)
        page.locator("#stopped").wait_for()  # the advice came last
        expected = values_now(last)
        assert sum(len(values) for values in expected.values()) >= 20

        def all_shown() -> dict[str, list[float]]:
            return {selector: shown(page, selector) for selector in expected}

        # topics keep no order among one another
        wait_until(lambda: all_shown() == expected, f"the page shows {expected}", seen=all_shown)
        expect(page.locator("#stop")).to_have_text("Stop: the wheels slip")
        history_equals_the_topics(page)
        expect(page.locator("#cohesion canvas")).to_have_attribute(
            "aria-label",
            re.compile(r"^Cohesion c: (now|last) 1.54, 95 percent between 1.34 and 1.74 kPa$"),
        )
        depths = "front left 15.4, front right 16.4, rear left 17.4, rear right 18.4 mm"
        expect(page.locator("#sinkage canvas")).to_have_attribute(
            "aria-label", re.compile(f"^Sinkage (now|last): {depths}$")
        )
        usable_by_everybody(page)
        assert it.said == []
        assert {urlsplit(address).netloc for address in it.asked_for} == {urlsplit(url).netloc}
        assert any(address.startswith("ws:") for address in it.asked_for)
    assert process.interrupt(60.0) == 0
    assert "Traceback" not in process.output


def history_equals_the_topics(page: Page) -> None:
    """Compare the history with the messages; the newest rows are not complete yet."""
    steps = range(STEPS - 3, 0, -2)
    cohesion = [estimate(make, step).cohesion for step in steps]
    slip = [dict(instant(make, step))["wheel_slip"].slip[1] for step in steps]
    for name, column, said in (("cohesion", 2, cohesion), ("slip", 3, slip)):
        page.locator(f"#{name} summary").click()
        awaits_all(page, f"#{name} tbody tr td:nth-child({column}) data", said)


def awaits_all(page: Page, cells: str, said: list[float]) -> None:
    def equal() -> bool:
        values = shown(page, cells)
        return len(values) > 10 and values == pytest.approx(said[: len(values)], rel=1e-6)

    wait_until(equal, f"{cells} shows {said}", seen=lambda: shown(page, cells))


def usable_by_everybody(page: Page) -> None:
    """Check with axe, for width, and by keyboard."""
    found = Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    page.locator("#recent").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.locator("#whole")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Tab")
    page.keyboard.press("Space")
    expect(page.locator("#connection")).to_have_text("paused")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_what_has_ended_is_old_and_not_identified_and_a_stop_stays_with_its_way_out(
    start: Starter, listener: Listener, browser: Browser, scheme: str
) -> None:
    process = start(
        "terrain_estimator", "dashboard", "--ros-args", "-p", "port:=0", "-r", "__ns:=/rover1"
    )
    url, rover = url_of(process), Rover(listener, "/rover1")
    with opened(browser, url, DESK, scheme) as it:
        page = it.page
        rover.drive(range(STEPS))
        rover.say("traction_advice", advice(make, STEPS, stop=True))
        page.locator("#stopped").wait_for()
        expect(page.locator("#resume")).to_have_text(
            "ros2 service call /rover1/planner/resume std_srvs/srv/Trigger"
        )
        expect(page.locator("#stopped")).to_have_css("background-color", "rgb(179, 38, 30)")
        page.locator("#verdict[data-level=old]").wait_for()
        # every topic ages by itself
        expect(page.locator("#now > *")).not_to_have_count(0)
        expect(page.locator("#now > :not(.stale)")).to_have_count(0)
        header = page.locator("header").inner_text()
        assert re.search(r"no current estimate\s+The last estimate is \d+ s old", header)
        for text in (header, page.locator("#now").inner_text()):
            assert "identified" not in text
        expect(page.locator("#stop")).to_have_text("Stop: the wheels slip")
        drawn_when_scrolled_to(page)
        found = Axe().run(page)
        assert found.violations_count == 0, found.generate_report()
        words = page.evaluate(
            "async () => { const {clock, number, duration} = await import('/words.js');"
            " return [clock(-0.4), number(-1e-4, 0.1), duration(61), duration(7261)]; }"
        )
        assert words == ["0:00", "0.00", "1 min 1 s", "2 h 1 min"]
        assert it.said == []


def drawn_when_scrolled_to(page: Page) -> None:
    """Check that a chart below the fold gets its lines though no data arrives any more."""
    drawn = (
        "([name, line]) => Chart.getChart(document.querySelector(`#${name} canvas`))"
        ".getDatasetMeta(line).data.length"
    )
    for name, line in (("change", 0), ("track", 1), ("height", 1)):
        page.locator(f"#{name}").scroll_into_view_if_needed()
        chart = [name, line]
        wait_until(
            lambda chart=chart: page.evaluate(drawn, chart) > STEPS // 4,  # type: ignore[misc]
            f"{name} is drawn",
        )


def test_it_comes_back_by_itself_after_a_restart_and_says_when_its_port_is_taken(
    start: Starter, listener: Listener, browser: Browser
) -> None:
    arguments = ("--ros-args", "-p", "address:=127.0.0.2", "-p", "rate:=20.0")
    first = start("terrain_estimator", "dashboard", *arguments, "-p", "port:=0")
    url = url_of(first)
    assert url.startswith("http://127.0.0.2:")
    port = url.rstrip("/").rpartition(":")[2]
    second = start("terrain_estimator", "dashboard", *arguments, "-p", f"port:={port}")
    assert second.wait(60.0) == 2
    assert f"port {port} of 127.0.0.2 is taken" in second.output
    assert "Traceback" not in second.output
    rover = Rover(listener)
    with opened(browser, url, DESK) as it:
        rover.drive(range(STEPS))
        rover.say("traction_advice", advice(make, STEPS, stop=False))
        planner = it.page.locator("#advice")
        wait_until(
            lambda: planner.inner_text() == "planner: at most 0.0815 m/s",
            "the planner's limit is shown",
            seen=planner.inner_text,
        )
        awaits(it.page, '[data-path="odom/x"]', 0.01 * (STEPS - 1))
        assert it.said == []
        assert first.interrupt(60.0) == 0
        connection = it.page.locator("#connection")
        wait_until(
            lambda: connection.get_attribute("data-state") == "lost",
            "the page says that the connection is lost",
        )
        silent = re.compile(r"planner: no advice for \d+ s")
        wait_until(
            lambda: silent.fullmatch(planner.inner_text()),
            "a limit that is not repeated is none",
            seen=planner.inner_text,
        )
        again = start("terrain_estimator", "dashboard", *arguments, "-p", f"port:={port}")
        assert url_of(again) == url
        step = STEPS + 3

        def returned() -> bool:
            rover.say("terrain_estimate", estimate(make, step))
            listener.spin_until(lambda: True, "it has left")
            return number(it.page, '[data-path="terrain_estimate/cohesion"]') == 1500.0 + step

        wait_until(returned, "the page shows what is said after the restart")
        expect(connection).to_have_attribute("data-state", "live")
        assert all("ERR_CONNECTION_REFUSED" in text for text in it.said), it.said
    again.wait_for_output(
        "no data on wheel_slip since the start: /wheel_slip has a publisher, which says nothing:"
        " check it; likewise wheel_sinkage, odom"
    )
    assert "no data on terrain_estimate since the start" not in again.output
    assert again.terminate(60.0) == 0

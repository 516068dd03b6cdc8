# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording says of its estimators: which runtime, in words, whatever comes first."""

import pytest

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import COMPILED, TORCHSCRIPT
from terrain_estimator.messaging.diagnostics import LATENCY, CheckResult, Level, judge_runtime
from terrain_estimator.messaging.identities import (
    IDENTITY_BYTES,
    MOST_RUNTIMES,
    Identities,
    TooLongError,
)
from terrain_estimator.topics import DIAGNOSTICS, HEALTH, Message

TYPES = Types()
TOPIC = "/rover1/estimator_health"
WHY = "mine.pt has no compiled core"


def health(configuration: str, model: str = "mine-1") -> Message:
    return TYPES.make(HEALTH, model_id=model, model_sha256="ab", configuration_sha256=configuration)


def diagnostics(*results: CheckResult, node: str = "/rover1/estimator") -> Message:
    """Return a message with these results, as the nodes publish them."""
    status = [
        TYPES.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            name=f"{node}: {result.name}",
            message=result.message,
            values=[
                TYPES.make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
                for key, value in (("value", f"{result.value:g}"), *result.details)
            ],
        )
        for result in results
    ]
    return TYPES.make(DIAGNOSTICS, status=status)


@pytest.mark.parametrize(
    ("runtime", "why", "level", "words"),
    [
        (COMPILED, "", Level.OK, "the model runs by compiled"),
        (TORCHSCRIPT, "", Level.OK, "by torchscript: the parameter runtime asks for it"),
        (TORCHSCRIPT, WHY, Level.WARN, f"by torchscript: {WHY} (updates take several times"),
    ],
)
def test_a_runtime_is_a_fault_only_where_the_core_was_looked_for(
    runtime: str, why: str, level: Level, words: str
) -> None:
    found = judge_runtime(runtime, why, "c1")
    assert found.level is level
    assert words in found.message
    assert dict(found.details)["runtime"] == runtime


def test_an_identity_has_the_runtime_of_its_configuration_and_is_told_once() -> None:
    identities = Identities()
    identities.hear(diagnostics(LATENCY.judge(0.1), judge_runtime(TORCHSCRIPT, WHY, "c1")))
    identities.hear(diagnostics(judge_runtime(COMPILED, "", "c2"), node="/rover2/estimator"))
    assert identities.new(TOPIC, health("c1")) == {
        "topic": TOPIC,
        "model_id": "mine-1",
        "model_sha256": "ab",
        "configuration_sha256": "c1",
        "runtime": "torchscript",
        "runtime_reason": WHY,
    }
    assert identities.new(TOPIC, health("c1")) is None
    other = identities.new(TOPIC, health("c2"))
    assert other
    assert (other["runtime"], other["runtime_reason"]) == ("compiled", "")


def test_an_identity_that_comes_before_its_runtime_is_told_at_once_and_once_more() -> None:
    identities = Identities()
    told = [identities.new(TOPIC, health("c1")) for _ in range(2)]
    identities.hear(diagnostics(judge_runtime(COMPILED, "", "c1")))
    told += [identities.new(TOPIC, health("c1")) for _ in range(2)]
    assert [each and each["runtime"] for each in told] == ["", None, "compiled", None]


def test_a_status_of_that_name_without_its_values_says_nothing() -> None:
    identities = Identities()
    identities.hear(
        diagnostics(CheckResult(judge_runtime("x", "", "").check, "", 0.0, Level.OK, ""))
    )
    told = identities.new(TOPIC, health(""))
    assert told
    assert told["runtime"] == ""


def test_what_is_remembered_and_told_is_bounded() -> None:
    identities = Identities()
    for number in range(3 * MOST_RUNTIMES):
        identities.hear(diagnostics(judge_runtime(COMPILED, "", f"c{number}")))
    identities.hear(diagnostics(judge_runtime("x" * IDENTITY_BYTES, "", "long")))
    assert len(identities._runtimes) == MOST_RUNTIMES
    first, last = (identities.new(TOPIC, health(name)) for name in ("c0", f"c{number}"))
    assert first
    assert last
    assert (first["runtime"], last["runtime"]) == ("", "compiled")
    with pytest.raises(TooLongError, match=f"^{TOPIC}: .* longer than {IDENTITY_BYTES} bytes"):
        identities.new(TOPIC, health("c1", model="x" * IDENTITY_BYTES))
    assert identities.new(TOPIC, health("c2")) is not None, "a short one still has room"

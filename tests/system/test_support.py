# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The support of the system tests itself: it has to fail where something is wrong."""

import itertools
import signal
import sys
from pathlib import Path

import pytest
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tests.system.domains import DOMAINS, candidates, own_domain
from tests.system.listening import LATCHED, Listener
from tests.system.processes import Starter
from tests.system.waiting import TimeOutError, wait_until


def test_waiting_in_vain_says_for_what_and_what_was_seen() -> None:
    with pytest.raises(TimeOutError, match=r"0\.01 s in vain until pigs fly\. none seen"):
        wait_until(lambda: False, "pigs fly", 0.01, lambda: "none seen")


def test_two_nodes_in_the_same_domain_hear_each_other_and_the_latched_past(
    domain_id: int, listener: Listener
) -> None:
    listener.node.create_publisher(String, "state", LATCHED).publish(
        String(data="said before anybody listened")
    )
    with Listener(domain_id) as other:
        past = other.collect(String, "state", LATCHED)
        other.wait_for_messages(past, 1)
        assert past[0].data == "said before anybody listened"

        heard = other.collect(String, "chatter")
        listener.publisher(String, "chatter").publish(String(data="hello"))
        other.wait_for_messages(heard, 1)
        assert heard[0].data == "hello"


def test_a_node_in_another_domain_hears_nothing(listener: Listener) -> None:
    with own_domain() as elsewhere, Listener(elsewhere) as other:
        other.collect(String, "chatter")
        with pytest.raises(TimeOutError, match="readers of chatter"):
            listener.publisher(String, "chatter", timeout=0.5)


def test_no_two_workers_share_a_domain_and_neighbours_differ() -> None:
    for workers in range(1, 9):
        seen = [list(candidates(iter(range(250)), worker, workers)) for worker in range(workers)]
        for own in seen:
            assert all(a != b for a, b in itertools.pairwise(own))
        domains = [set(own) for own in seen]
        assert set.union(*domains) <= set(range(1, DOMAINS + 1))
        assert sum(len(own) for own in domains) == len(set.union(*domains))


def test_a_missing_service_is_a_failure(listener: Listener) -> None:
    with pytest.raises(TimeOutError, match="the service nowhere is there"):
        listener.call(Trigger, "nowhere", Trigger.Request(), timeout=0.2)


def test_a_process_that_dies_early_fails_the_wait_with_its_output(start: Starter) -> None:
    process = start.command(
        sys.executable, "-c", "print('last words', flush=True); raise SystemExit(3)"
    )
    with pytest.raises(AssertionError, match=r"(?s)ended with 3.*last words"):
        process.wait_for_output("ready")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 7), (signal.SIGTERM, 8)])
def test_signals_reach_the_process_and_its_exit_code_comes_back(
    number: signal.Signals, code: int, start: Starter
) -> None:
    handlers = (
        "[signal.signal(s, lambda *_, c=c: sys.exit(c)) for s, c in ((signal.SIGINT, 7),"
        " (signal.SIGTERM, 8))]"
    )
    process = start.command(
        sys.executable,
        "-c",
        f"import signal, sys; {handlers}; print('ready', flush=True); signal.pause()",
    )
    process.wait_for_output("^ready$")
    assert (process.interrupt() if number is signal.SIGINT else process.terminate()) == code


def test_what_a_test_leaves_running_is_killed_with_its_children(
    tmp_path: Path, domain_id: int
) -> None:
    with Starter(tmp_path, domain_id) as starter:
        process = starter.command(
            sys.executable, "-c", "import os, signal; print(os.fork(), flush=True); signal.pause()"
        )
        child = int(process.wait_for_output(r"^([1-9]\d*)$").group(1))
    assert not process.running

    def dead() -> bool:
        try:
            return "Z" in Path(f"/proc/{child}/stat").read_text().split()[2]
        except (FileNotFoundError, ProcessLookupError):  # it may vanish at any moment
            return True

    wait_until(dead, "the child is dead")

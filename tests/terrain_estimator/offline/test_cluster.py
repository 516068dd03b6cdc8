# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Work on a cluster: the same results with one worker, with two, and with one that is killed."""

import dataclasses
import os
import signal
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch

from terrain_estimator.cli.train import main
from terrain_estimator.learning.generation import Chunk, Order, draw_chunk, generate
from terrain_estimator.learning.regression import Regression
from terrain_estimator.offline.cluster import ClusterError, cluster
from terramechanics.presets import load_rover, load_soil
from tests.samples import sampled
from tests.terrain_estimator.fleet.fleets import Processes, free_port, kill, wait_for

ORDER = Order(
    load_rover("mars_rover"), load_soil("loose_sand"), drives=45, seed=11, duration_s=3.0, share=0.4
)


def die_once(chunk: Chunk, marker: Path) -> Regression:
    """Kill the worker that draws chunk 1, the first time."""
    if chunk.number == 1 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return draw_chunk(chunk)


def assert_same(first: Regression, second: Regression) -> None:
    for field in dataclasses.fields(Regression):
        assert torch.equal(getattr(first, field.name), getattr(second, field.name)), field.name


def test_any_number_of_workers_gives_the_same_data_even_if_one_is_killed(tmp_path: Path) -> None:
    alone = generate(ORDER)
    for workers in sampled((), (1,)):
        with cluster("", workers=workers) as spread:
            assert_same(generate(ORDER, spread), alone)
    with cluster("", workers=2) as spread:
        marker = tmp_path / "killed"

        def fatal(function: object, chunks: Sequence[Chunk]) -> list[Regression]:
            assert function is draw_chunk
            return list(spread(lambda chunk: die_once(chunk, marker), chunks))

        assert_same(generate(ORDER, fatal), alone)
        assert marker.exists()


def test_a_scheduler_that_does_not_answer_is_an_error_that_names_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("terrain_estimator.offline.cluster.PATIENCE_S", 1.0)
    with pytest.raises(ClusterError, match=r"127\.0\.0\.1:9"), cluster("tcp://127.0.0.1:9"):
        pass
    options = ["--rover", "mars_rover", "--columns", "2", "--scheduler", "tcp://127.0.0.1:9"]
    assert main(options) == 2
    assert "127.0.0.1:9" in capsys.readouterr().err


def refuse(item: int) -> int:
    raise FileNotFoundError(item)


def test_what_a_function_raises_is_raised_and_is_not_a_lost_scheduler() -> None:
    with cluster("", workers=1) as spread, pytest.raises(FileNotFoundError):
        list(spread(refuse, [1]))


def test_a_result_that_stayed_with_a_lost_scheduler_is_an_error_that_says_so() -> None:
    with Processes() as processes:
        port = str(free_port())
        address = f"127.0.0.1:{port}"
        scheduler = processes.start("dask", "scheduler", "--port", port, "--no-dashboard")
        processes.start("dask", "worker", address, "--no-nanny", "--no-dashboard")
        with cluster(address) as spread:
            future = spread.start(abs, -1)
            wait_for(future.done, "an item")
            kill(scheduler)
            with pytest.raises(ClusterError, match="the scheduler was lost"):
                spread.result(future)

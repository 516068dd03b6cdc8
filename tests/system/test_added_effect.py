# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator's process with a model to which an effect was added, from a file."""

from pathlib import Path

from msg_defs.msg import TerrainEstimate
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.model.model_file import load_model
from terrain_estimator.nodes.common import message_types
from terrain_estimator.topics import INPUT_TYPES
from tests.drives import drive_messages
from tests.system.listening import Listener
from tests.system.processes import Starter

PRIOR = 0.05  # [rad] standard deviation


def test_the_estimator_takes_the_file_as_it_is_and_publishes_the_effect(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    path = tmp_path / "model.pt"
    metadata = add_effects(load_model(), [Sized("slope_bias", 0.0, PRIOR)], path)
    estimates = listener.collect(TerrainEstimate, "terrain_estimate")
    estimator = start("terrain_estimator", "estimator", "--ros-args", "-p", f"model:={path}")
    estimator.wait_for_output("ready", timeout=60.0)
    publishers = {
        topic: listener.publisher(message_types.message_class(name), topic)
        for topic, name in INPUT_TYPES.items()
    }
    estimator.wait_for_output("matched all inputs")
    for topic, _, message in drive_messages(message_types.make, 3.0):
        publishers[topic].publish(message)
    listener.wait_for_messages(estimates, 30, timeout=60.0)  # the first calls of a model compile it
    first, last = estimates[0], estimates[-1]
    assert last.model_id == metadata.model_id
    assert last.model_sha256 == metadata.sha256
    assert (list(last.effect), list(last.effect_unit)) == (["slope_bias"], ["rad"])
    assert abs(first.effect_stddev[0] - PRIOR) < 1e-3
    assert last.effect_stddev[0] < 0.5 * PRIOR
    assert abs(last.effect_value[0]) < 4.0 * last.effect_stddev[0]
    assert estimator.interrupt() == 0

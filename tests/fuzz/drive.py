# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run one target under libFuzzer: drive.py TARGET [libFuzzer's arguments]."""

import sys

import atheris

with atheris.instrument_imports(
    include=["rover_parameters", "terrain_estimator", "terramechanics", "mcap", "rosbags", "yaml"]
):
    from tests.fuzz.targets import TARGETS

if __name__ == "__main__":
    target = TARGETS[sys.argv.pop(1)]
    atheris.Setup(sys.argv, target)
    atheris.Fuzz()

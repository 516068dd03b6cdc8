#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
#
# Drives into a patch of soft sand: "soft_patch.sh true" obeys the planner, "soft_patch.sh false" does not.
# Then the place of the patch [m], the duration [s], and how much faster than real time.
set -euo pipefail

obey=${1:-true}
examples=$(cd "$(dirname "$0")" && pwd)
trap 'kill $(jobs -p) 2>/dev/null; wait' EXIT

ros2 run terrain_estimator estimator &
ros2 run terrain_estimator planner &
python3 "$examples/follow_advice.py" --ros-args -p obey:="$obey" &
ros2 run rover_sim_node simulator --ros-args -p schedule:=cmd_vel -p profile:=ramp -p ramp_grade:=0.07 \
    -p soil:=loose_sand -p soil_overrides.cohesion:=2500.0 -p soil_overrides.tan_phi:=0.75 \
    -p change.soil:="$examples/soft_patch.yaml" -p change.position:="${2:-6.0}" -p change.transition:=0.3 \
    -p seed:=1 -p duration:="${3:-80.0}" -p real_time_factor:="${4:-4.0}" -p wait_for_subscribers:=2 -p wait_timeout:=90.0

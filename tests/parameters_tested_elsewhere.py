# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Where a parameter is tested that test_parameters_change_behaviour does not test itself."""

EVERY_STEP = (
    "test_it_waits_for_its_subscribers_publishes_every_step_on_every_topic_and_ends_by_itself"
)
WAITS = "test_without_the_subscribers_that_it_waits_for_it_says_which_topics_miss_them"

ELSEWHERE = {
    "dashboard port": (
        "system/test_dashboard.py::"
        "test_it_comes_back_by_itself_after_a_restart_and_says_when_its_port_is_taken"
    ),
    "dashboard address": (
        "system/test_dashboard.py::"
        "test_it_comes_back_by_itself_after_a_restart_and_says_when_its_port_is_taken"
    ),
    "dashboard rate": (
        "terrain_estimator/dashboard/test_web.py::test_it_takes_and_answers_at_its_rate"
    ),
    "dashboard window": (
        "terrain_estimator/dashboard/test_model.py::"
        "test_window_and_points_say_how_long_and_how_fine_the_recent_history_is"
    ),
    "dashboard points": (
        "terrain_estimator/dashboard/test_model.py::"
        "test_window_and_points_say_how_long_and_how_fine_the_recent_history_is"
    ),
    "estimator auto_start": "system/test_lifecycle.py::test_a_service_that_cannot_do_it_says_why",
    "estimator state.file": "system/test_lifecycle.py::with_state",
    "estimator state.autosave_period": "system/test_lifecycle.py::with_state",
    "recorder auto_start": (
        "system/test_lifecycle.py::"
        "test_a_recorder_writes_while_it_is_active_and_notes_who_estimated"
    ),
    "estimator runtime": (
        "terrain_estimator/offline/test_replay_runtime.py::"
        "test_a_replay_runs_what_the_parameter_says_and_by_itself_what_the_live_node_ran"
    ),
    "estimator rover": "test_parameters_change_behaviour.py::test_the_rover_file_names_the_wheels",
    "recorder fsync_interval": (
        "test_parameters_change_behaviour.py::"
        "test_a_shorter_interval_syncs_the_recording_more_often"
    ),
    "recorder output": "system/test_recorder.py::record",
    "recorder split.size": (
        "system/test_hosted_recorder.py::test_a_long_recording_goes_on_in_the_next_file"
    ),
    "recorder split.duration": (
        "system/test_hosted_recorder.py::test_a_long_recording_goes_on_in_the_next_file"
    ),
    "recorder topics": "system/test_recorder.py::record",
    "planner slip_limit": (
        "terrain_estimator/planning/test_planner.py::test_each_parameter_changes_the_advice"
    ),
    "planner sinkage_limit": (
        "terrain_estimator/planning/test_planner.py::test_each_parameter_changes_the_advice"
    ),
    "planner stop_probability": (
        "terrain_estimator/planning/test_planner.py::test_each_parameter_changes_the_advice"
    ),
    "planner pull_deviation": (
        "terrain_estimator/planning/test_planner.py::test_each_parameter_changes_the_advice"
    ),
    "planner window": (
        "terrain_estimator/planning/test_planner.py::test_each_parameter_changes_the_advice"
    ),
    "planner reaction_time": (
        "terrain_estimator/planning/test_planner.py::test_each_parameter_changes_the_advice"
    ),
    "planner deceleration": (
        "terrain_estimator/planning/test_planner.py::test_each_parameter_changes_the_advice"
    ),
    "planner standstill_speed": (
        "terrain_estimator/planning/test_planner.py::test_ticking_encoders_are_told_from_driving"
    ),
    "planner use_torque": (
        "terrain_estimator/planning/test_inputs.py::test_a_sensor_that_is_switched_off_is_not_used"
    ),
    "planner use_sinkage": (
        "terrain_estimator/planning/test_inputs.py::test_a_sensor_that_is_switched_off_is_not_used"
    ),
    "planner use_imu": (
        "terrain_estimator/planning/test_inputs.py::test_a_sensor_that_is_switched_off_is_not_used"
    ),
    "planner pairing_tolerance": (
        "terrain_estimator/planning/test_inputs.py::"
        "test_messages_are_paired_as_the_estimator_pairs_them"
    ),
    "planner pairing_timeout": (
        "terrain_estimator/planning/test_inputs.py::"
        "test_messages_are_paired_as_the_estimator_pairs_them"
    ),
    "planner period": (
        "system/test_planner.py::test_it_advises_once_a_period_and_says_when_it_does_not_know_yet"
    ),
    "planner rover": (
        "system/test_planner.py::test_it_advises_once_a_period_and_says_when_it_does_not_know_yet"
    ),
    "planner model": "system/test_planner.py::test_what_is_wrong_is_named",
    "simulator duration": f"system/test_simulator.py::{EVERY_STEP}",
    "simulator epoch": f"system/test_simulator.py::{EVERY_STEP}",
    "simulator wait_for_subscribers": f"system/test_simulator.py::{WAITS}",
    "simulator wait_timeout": f"system/test_simulator.py::{WAITS}",
    "simulator publish_clock": "system/test_simulator.py::test_the_clock_has_one_owner",
    "simulator real_time_factor": (
        "system/test_simulator.py::test_a_real_time_factor_below_one_stretches_the_wall_time"
    ),
    "simulator publish_tf": (
        "system/test_simulator_viewing.py::test_where_they_are_not_wanted_nobody_publishes_them"
    ),
    "simulator publish_markers": (
        "system/test_simulator_viewing.py::test_where_they_are_not_wanted_nobody_publishes_them"
    ),
    "simulator track_width": (
        "system/test_simulator_viewing.py::"
        "test_every_step_has_the_transform_of_its_odometry_and_the_wheels_in_the_body_frame"
    ),
    "slip_source rover": (
        "system/test_slip_source.py::test_slip_from_wheel_rates_and_odometry_is_that_of_the_wheels"
    ),
    "slip_source empty_sinkage": (
        "system/test_slip_source.py::"
        "test_a_rover_without_sinkage_and_contact_angle_sensors_needs_no_other_node"
    ),
    "slip_source velocity_type": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_each_parameter_changes_what_is_published"
    ),
    "slip_source body_frame": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_each_parameter_changes_what_is_published"
    ),
    "slip_source track_width": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_in_a_turn_every_wheel_has_the_slip_of_its_own_speed"
    ),
    "slip_source standstill_speed": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_each_parameter_changes_what_is_published"
    ),
    "slip_source radius_deviation": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_each_parameter_changes_what_is_published"
    ),
    "slip_source rate_deviation": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_each_parameter_changes_what_is_published"
    ),
    "slip_source default_sd.velocity": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_each_parameter_changes_what_is_published"
    ),
    "slip_source pairing_tolerance": (
        "terrain_estimator/messaging/test_slip_source.py::"
        "test_each_parameter_changes_what_is_published"
    ),
    "terrain_map spacing": (
        "terrain_estimator/messaging/test_map_track.py::"
        "test_points_are_a_spacing_apart_and_carry_what_was_estimated_there"
    ),
    "terrain_map points": (
        "system/test_terrain_map.py::test_the_track_is_a_cloud_that_a_late_reader_gets"
    ),
    "terrain_map period": (
        "system/test_terrain_map.py::test_the_track_is_a_cloud_that_a_late_reader_gets"
    ),
    "terrain_map pairing_tolerance": (
        "system/test_terrain_map.py::test_the_track_is_a_cloud_that_a_late_reader_gets"
    ),
    "terrain_map grid.resolution": (
        "terrain_estimator/messaging/test_map_grid.py::test_each_parameter_changes_the_grid"
    ),
    "terrain_map grid.reach": (
        "terrain_estimator/messaging/test_map_grid.py::test_each_parameter_changes_the_grid"
    ),
    "terrain_map grid.cells": (
        "terrain_estimator/messaging/test_map_grid.py::test_each_parameter_changes_the_grid"
    ),
    "terrain_map grid.free_slope": (
        "terrain_estimator/messaging/test_map_grid.py::test_each_parameter_changes_the_grid"
    ),
    "terrain_map grid.lethal_slope": (
        "terrain_estimator/messaging/test_map_grid.py::test_each_parameter_changes_the_grid"
    ),
    "terrain_map model": "system/test_terrain_grid.py::test_what_is_wrong_is_named",
    "terrain_map rover": "system/test_terrain_grid.py::test_what_is_wrong_is_named",
    "terrain_map slip_limit": (
        "system/test_terrain_grid.py::"
        "test_the_slope_is_one_that_the_rover_climbs_and_falls_with_each_doubt"
    ),
    "terrain_map pull_deviation": (
        "system/test_terrain_grid.py::"
        "test_the_slope_is_one_that_the_rover_climbs_and_falls_with_each_doubt"
    ),
    "watch period": (
        "system/test_watch.py::"
        "test_it_says_why_it_hears_nothing_then_what_it_hears_and_at_which_rates"
    ),
    "watch report": (
        "system/test_watch.py::"
        "test_it_says_why_it_hears_nothing_then_what_it_hears_and_at_which_rates"
    ),
    "watch real_time_factor": (
        "system/test_watch.py::"
        "test_it_says_why_it_hears_nothing_then_what_it_hears_and_at_which_rates"
    ),
}
"""Parameters of whole processes, and the test that would fail if one had no effect."""

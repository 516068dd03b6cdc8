# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Ends of the sentences "Change it ...", for every parameter in a parameter file."""

_NAMES = "if your rover is the model's, but its wheels have other names"
_DEVIATIONS = "to the value that a calibration of your drives gives"
_STILL = (
    "if encoders tick while the rover stands; keep it well below the slowest drive, and equal in"
    " estimator, planner and slip_source"
)
_TORQUE = "to false if torques come from uncalibrated motor currents"
_IMU = "to false if the mounting angle of the imu is unknown"
_SITE = "if the ground is known, from orbit or from an earlier drive"
_SITE_SD = (
    "together with the mean, to how far the ground here may be from it; rather too large than too"
    " small"
)
_MODEL = "to the model of your rover; use the same in estimator and planner"

WHEN = {
    "estimator": {
        "model": _MODEL,
        "rover": _NAMES,
        "runtime": (
            "to compiled if a start without the compiled core should be refused, to torchscript to"
            " give the bytes of recordings made with it"
        ),
        "use_torque": f"{_TORQUE}; in the planner too",
        "use_imu": f"{_IMU}; in the planner too",
        "use_moments": "to false if the suspension has springs or stiff joints",
        "use_sinkage": "to false if no sensor measures sinkages, or a poor one",
        "contact_angle_sd": (
            "if no contact angle is measured, to three times the usual angle between the ground"
            " below a wheel and the body"
        ),
        "prior.cohesion_mean": _SITE,
        "prior.cohesion_sd": _SITE_SD,
        "prior.tan_phi_mean": _SITE,
        "prior.tan_phi_sd": _SITE_SD,
        "prior.soil": "if only one soil is possible",
        "forgetting_time": (
            "if the ground changes slowly along the way; it costs accuracy everywhere else"
        ),
        "standstill_speed": _STILL,
        "roll_limit": (
            "to 0 if the roll is not calibrated; a larger one only where a study of your rover"
            " allows it"
        ),
        "turn_limit": (
            "to 0 if yaw rate or lateral velocity are too noisy to tell a turn; a larger one only"
            " where a study of your rover allows it"
        ),
        "gate_probability": (
            "rarely: a wrong model or a failing sensor causes GATED more often than a wrong gate"
        ),
        "slip_minimum": "rarely",
        "slip_maximum": "rarely",
        "body_frame": "to the frame_id of your drivers",
        "torque_noise.relative": _DEVIATIONS,
        "torque_noise.absolute": _DEVIATIONS,
        "bogie_joint": "to the name in your joint_states",
        "bogie_nose_down": (
            "if your joint's axis follows REP 103; with the wrong sign more observations are GATED"
        ),
        "default_sd.velocity": "if your odometry leaves its covariance at zero",
        "default_sd.pitch": "if your imu leaves its covariance at zero",
        "default_sd.acceleration": "if your imu leaves its covariance at zero",
        "default_sd.lateral_velocity": "to that of your odometry if it leaves the variance at zero",
        "default_sd.yaw_rate": "to that of your gyro if it leaves its covariance at zero",
        "pairing_tolerance": (
            "to half a period if sensors are not triggered together; in planner and terrain_map too"
        ),
        "pairing_timeout": "if a sensor is later than that; estimates are then as late",
        "auto_start": "to false under a lifecycle manager",
        "state.file": "if the estimate should survive a restart",
        "state.autosave_period": (
            "to a longer time to spare a flash memory, to a shorter one to lose less"
        ),
    },
    "planner": {
        "model": _MODEL,
        "rover": _NAMES,
        "use_torque": f"{_TORQUE}, as in the estimator; the ground ahead is then not judged",
        "use_sinkage": (
            "to false if no sensor measures sinkages, or a poor one, as in the estimator; neither"
            " sinkage_limit nor the ground ahead is then judged"
        ),
        "use_imu": f"{_IMU}, as in the estimator",
        "period": (
            "to a shorter time if your loop reacts faster; one piece of advice takes 8 ms of"
            " processor time"
        ),
        "slip_limit": "to the largest slip at which your rover does not dig itself in",
        "sinkage_limit": "to what the ground clearance of your rover allows",
        "stop_probability": "to a smaller value if a false stop costs less than a stuck rover",
        "pull_deviation": "if the soil constants are known better or worse than to 5 %",
        "window": "to a longer time if slip is noisier; the planner then reacts as much later",
        "reaction_time": "to the time that your loop takes from advice to braking",
        "deceleration": "to that of your rover",
        "standstill_speed": _STILL,
        "pairing_tolerance": "as in the estimator",
        "pairing_timeout": "as in the estimator",
    },
    "slip_source": {
        "rover": "to your rover's file",
        "velocity_type": "to the type of your velocity messages",
        "body_frame": "as in the estimator",
        "track_width": "to that of your rover if it turns, and the velocity has a yaw rate",
        "standstill_speed": _STILL,
        "radius_deviation": "to the accuracy of the rolling radius",
        "rate_deviation": "to the resolution of your encoders",
        "default_sd.velocity": "if your velocity has no covariance",
        "pairing_tolerance": "to half the period of the slower of the two topics",
        "empty_sinkage": (
            "to true if nothing measures sinkages and contact angles; set contact_angle_sd and"
            " use_sinkage of the estimator, too"
        ),
    },
    "terrain_map": {
        "spacing": "to the resolution that your map needs",
        "points": "to keep a long track fine; each point takes 40 bytes of every cloud",
        "period": (
            "to a longer time if the link to the reader is slow: every cloud holds the whole track"
        ),
        "pairing_tolerance": "as in the estimator",
        "model": "as in the estimator",
        "rover": _NAMES,
        "slip_limit": "as in the planner",
        "pull_deviation": "as in the planner",
        "grid.resolution": "to that of your costmap",
        "grid.reach": "to half the width of your rover, or to how far its ground holds beside it",
        "grid.cells": "to keep cells small on a long drive; each takes a byte of every grid",
        "grid.free_slope": "to the steepest slope of your terrain, with a reserve",
        "grid.lethal_slope": "to the slope that your rover has to climb anywhere",
    },
    "dashboard": {
        "port": (
            "if another program uses it, or to one port per rover if several rovers share a machine"
        ),
        "address": "rarely: a tunnel (ssh -L) shows the page on another computer and protects it",
        "rate": "to 1 or 2 if every per cent of a core counts",
        "window": "to the time that your rover needs to cross a patch of ground",
        "points": "to window times 10 to show every single sample; pages then have more to draw",
    },
    "recorder": {
        "auto_start": "to false under a lifecycle manager",
        "output": (
            "to a folder of your choice; an existing folder is refused, so leave it empty for a"
            " service that restarts"
        ),
        "topics": (
            "to record /clock or topics of your own, too (name the default topics as well), or to"
            " record fewer"
        ),
        "fsync_interval": "to a longer time to spare a flash memory, to a shorter one to lose less",
        "split.size": (
            "for recordings of hours, so that you can copy finished files while the next one is"
            " written"
        ),
        "split.duration": "as for split.size",
    },
}

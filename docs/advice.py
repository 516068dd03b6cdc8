# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""When to change a parameter: "Change it ...". Of every parameter of the nodes that have a file of parameters."""

_NAMES = "where your rover is the model's, but its wheels have other names"
_DEVIATIONS = "to what a calibration of your drives says"
_STILL = (
    "where encoders tick while the rover stands; keep it well below the slowest drive, the same in"
    " estimator, planner and slip_source"
)
_TORQUE = "to false where torques come from motor currents that nobody calibrated"
_IMU = "to false where the imu sits at an unknown angle"
_SITE = "where the ground is known, from orbit or from an earlier drive"
_SITE_SD = (
    "with the mean: to how far the ground of this place may be from it, rather too large than too"
    " small"
)
_MODEL = "to the model of your rover; give it to estimator and planner alike"

WHEN = {
    "estimator": {
        "model": _MODEL,
        "rover": _NAMES,
        "use_torque": f"{_TORQUE}; in the planner too",
        "use_imu": f"{_IMU}; in the planner too",
        "use_moments": "to false where the suspension has springs or stiff joints",
        "prior.cohesion_mean": _SITE,
        "prior.cohesion_sd": _SITE_SD,
        "prior.tan_phi_mean": _SITE,
        "prior.tan_phi_sd": _SITE_SD,
        "prior.soil": "where only one soil can be there",
        "drift": "where the ground changes slowly along the way; it costs accuracy everywhere else",
        "standstill_speed": _STILL,
        "gate_probability": (
            "rarely: GATED comes from a wrong model or a failing sensor more often than from a"
            " wrong gate"
        ),
        "slip_minimum": "rarely",
        "slip_maximum": "rarely",
        "body_frame": "to the frame_id of your drivers",
        "torque_noise.relative": _DEVIATIONS,
        "torque_noise.absolute": _DEVIATIONS,
        "bogie_joint": "to the name in your joint_states",
        "bogie_nose_down": (
            "where your joint's axis is that of REP-103; with the wrong sign there are more GATED"
            " observations"
        ),
        "default_sd.velocity": "where your odometry leaves its covariance zero",
        "default_sd.pitch": "where your imu leaves its covariance zero",
        "default_sd.acceleration": "where your imu leaves its covariance zero",
        "pairing_tolerance": (
            "where sensors are not triggered together: to half a period, in planner and"
            " terrain_map, too"
        ),
        "pairing_timeout": "where a sensor comes later than that; estimates then come as late",
        "auto_start": "to false under a manager of life cycles",
        "state.file": "where estimates are to go on after a restart",
        "state.autosave_period": "to spare a flash memory, or to lose less",
    },
    "planner": {
        "model": _MODEL,
        "rover": _NAMES,
        "use_torque": f"{_TORQUE}, as in the estimator; then nothing judges the ground ahead",
        "use_imu": f"{_IMU}, as in the estimator",
        "period": (
            "to a shorter one where your loop reacts faster; a piece of advice takes 8 ms of"
            " processor time"
        ),
        "slip_limit": "to the slip that your rover bears without digging itself in",
        "sinkage_limit": "to what the clearance of your rover allows",
        "stop_probability": "to a smaller value where a stop in vain costs less than a rover",
        "pull_deviation": "where the soil constants are better or worse known than to 5 %",
        "window": "to a longer one where slip is measured with more noise; it reacts as much later",
        "reaction_time": "to that of your loop from advice to brakes",
        "deceleration": "to that of your rover",
        "standstill_speed": _STILL,
        "pairing_tolerance": "as in the estimator",
        "pairing_timeout": "as in the estimator",
    },
    "slip_source": {
        "rover": "to your rover's file",
        "velocity_type": "to that of your velocity",
        "body_frame": "as in the estimator",
        "standstill_speed": _STILL,
        "radius_deviation": "to how well the rolling radius is known",
        "rate_deviation": "to the resolution of your encoders",
        "default_sd.velocity": "where your velocity comes without a covariance",
        "pairing_tolerance": "to half a period of the slower one of the two",
    },
    "terrain_map": {
        "spacing": "to the resolution that your map wants",
        "points": "where a long track is to stay fine; a cloud has 36 bytes for each",
        "period": (
            "to a longer one where the link to the reader is narrow: every cloud holds the whole"
            " track"
        ),
        "pairing_tolerance": "as in the estimator",
    },
    "dashboard": {
        "port": (
            "where another program has it, or to one a rover where several rovers share a machine"
        ),
        "address": "rarely: a tunnel (ssh -L) shows the page elsewhere and protects it",
        "rate": "to 1 or 2 where every per cent of a core counts",
        "window": "to the time in which your rover crosses a patch of ground",
        "points": "to window times 10 for every single sample; pages then have more to draw",
    },
    "recorder": {
        "auto_start": "to false under a manager of life cycles",
        "output": (
            "to a place of your own; a folder that is there already is refused, so a service that"
            " starts again leaves it empty"
        ),
        "topics": "to record /diagnostics, /clock, traction_advice or terrain_map, too",
        "fsync_interval": "to spare a flash memory, or to lose less",
        "split.size": (
            "for recordings of hours, so that a finished file can be copied away while the next one"
            " is written"
        ),
        "split.duration": "as split.size",
    },
}

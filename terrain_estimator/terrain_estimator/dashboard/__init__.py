# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the live page shows, and its web server; no ROS in it.

- ``reading``: messages as plain values.
- ``history``: rows over time in constant memory.
- ``journal``: what changed, in words.
- ``model``: all of these, and what a viewer lacks of them.
- ``web``: the page and its viewers.

A viewer says what it has and gets what is newer, once it has shown what it got: however slow it is,
one answer at most is on its way.
"""

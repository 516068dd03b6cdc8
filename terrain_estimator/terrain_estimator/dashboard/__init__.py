# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Content of the live page and its web server, without ROS.

- ``values``: messages as plain values.
- ``history``: rows over time in constant memory.
- ``reported_states``: states in the messages, in words.
- ``journal``: changes of these states that lasted.
- ``model``: all of these, and the part of them that a viewer lacks.
- ``web``: the page and its viewers.

A viewer sends a cursor and gets what is newer than that. It asks again only after it has shown the
answer, so that at most one answer is under way, however slow the viewer is.
"""

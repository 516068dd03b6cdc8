# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a model by wheel learns from a rover that turns, and how near it comes to the bound.

make by-wheel prints the tables of docs/lateral.md. The first have the motions of off_plane, with
soil constants that are each wrong by up to 5 %, over uneven ground and with hidden effects, too.
The last has the drives of lateral, with exact constants, beside their Cramer-Rao bound. All noise
is that of the simulated sensors. The estimator is the node's.
"""

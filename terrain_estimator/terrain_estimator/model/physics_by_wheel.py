# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Physics of a rover whose wheels are estimated one by one, so that it may turn and slide.

The rows are those of ``rows`` with a wheel in the place of an axle, and three more::

    roll_moment        0 = SUM_k roll moment of wheel k about the centre of mass / (m g b)   [1]
    lateral_velocity   dv_y/dt + omega v_x + g sin(roll) = SUM_k Y-part of wheel k / m     [m/s^2]
    yaw_rate           I domega/dt / (m g b) = SUM_k yaw moment of wheel k / (m g b)       [1]

Shear along and across share one limit (terramechanics.contact.rolling), so that the forces of a
wheel stay affine in (c, tan phi). Its motion across follows from the body's lateral velocity and
yaw rate, which are measured; the noise of both is carried along as sources of the rows.

No instant measures dv_y/dt and domega/dt. So both rows are weighted by n b_l, their targets by
n w_i (``body_motion``); the mean over the block then is the least-squares slope of the readings. A
turning rover's acceleration ahead has the part -omega v_y, which comes with the pitch
(``packed_observation``).
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from terrain_estimator.model.agreement import LARGEST_ERROR, Agreement
from terrain_estimator.model.block import block_rows, row_weights, velocity_twice
from terrain_estimator.model.body_motion import (
    BodyMotion,
    block_slopes,
    body_motion,
    moves,
    safe_motion,
)
from terrain_estimator.model.constant_columns import observed_columns
from terrain_estimator.model.gaussian import cholesky
from terrain_estimator.model.ground_by_wheel import EvenGround, GroundByWheel
from terrain_estimator.model.levers_by_wheel import levers_by_wheel, levers_of_banks
from terrain_estimator.model.packing import (
    PackedView,
    view_of,
    with_body_motion,
    with_sinkage,
    with_sinkage_and_sd,
    with_slip,
)
from terrain_estimator.model.physics import Physics, SoilRows
from terrain_estimator.model.rows import (
    ContactModel,
    Forces,
    Frame,
    Rows,
    are_usable,
    frame_of,
    measured_forces,
    places,
    read_forces,
    rows_of_forces,
    values_alone,
    varied_inputs,
)
from terrain_estimator.model.rows_beside import (
    BodyBeside,
    level_share,
    of_slopes,
    pulled_beside,
    slopes_beside,
    velocity_beside,
    with_motion,
)
from terrain_estimator.model.unmeasured import SMALL as LITTLE
from terrain_estimator.model.unmeasured import lacks_sinkage, usual_sinkage
from terrain_estimator.model.unmeasured_by_wheel import (
    found_sinkage,
    spent_on_sinkage,
    spent_rows,
    without_spent,
)
from terramechanics.contact.rolling import WheelMotion, rolling_forces
from terramechanics.numerics.batching import any_of
from terramechanics.vehicle.wheel_balances import motion_across
from terramechanics.vehicle.wheel_places import WIDEST_SLIP

INSIDE = (-0.59, 0.94)
"""[1] Slips between which the law of stresses moves the largest one, and those that pass for it."""
SMALL = 1e-3
"""[1] Share of the rim's speed by which the motion across is varied."""
PULLED = ("mean_velocity", "velocity", "acceleration", "lateral_velocity")
"""Rows of forces over the mass."""
FEWEST = 5
"""Readings from which on a block has a slope."""
ROUNDS = 3
"""Steps to the inputs on which the rows agree best."""
UNSTEADY = 0.01
"""[g] Deviation of an instant's acceleration to the side from its mean over the block.

That of the yaw rate's is as if the wheels at both ends had it.
"""


class RollingForces(nn.Module):
    """The forces of wheels that roll, by the contact law alone."""

    def forward(
        self,
        motion: WheelMotion,
        rim: Tensor,
        sinkage: Tensor,
        constants: Tensor,
        contact: ContactModel,
        values: Tensor | None,
    ) -> Tensor:
        """Return :func:`rolling_forces` of wheels whose rims have the speeds ``rim`` [n, W] [m/s].

        The ``motion`` is in units of these speeds. ``values`` are those of effects.
        """
        del rim, values
        return rolling_forces(
            motion, sinkage, constants, contact.radius, contact.width, contact.nodes
        )


class PhysicsByWheel(nn.Module):
    """Physics of single wheels.

    It has the methods of :class:`~terrain_estimator.model.physics.Physics` that the model calls.
    """

    wheel_y: Tensor
    yaw_inertia: Tensor
    spent: Tensor
    kept: Tensor
    telling: Tensor
    pulled: Tensor
    unsteady: Tensor

    def __init__(
        self,
        nominal: Physics,
        wheel_y: Tensor,
        yaw_inertia: float,
        rows: Sequence[str],
        axles: list[int],
        forces: nn.Module | None = None,
        ground_variation: float = 0.0,
    ) -> None:
        """Take the physics with wheels in the place of axles, and what a planar rover lacks.

        ``wheel_y`` [W] is in m, ``yaw_inertia`` in kg m^2; ``rows`` are the rows' names and
        ``axles`` the axles of the wheels. ``forces`` is called as :class:`RollingForces`, which it
        is by default. ``ground_variation`` [1] is the ground's deviation from wheel to wheel.
        """
        super().__init__()
        self.nominal = nominal
        self.forces = RollingForces() if forces is None else forces
        self.ground = (
            GroundByWheel(nominal.axle_x, ground_variation) if ground_variation else EvenGround()
        )
        self.axles, self.gravity = nominal.axles, nominal.gravity
        self.known_soils, self.uncertain_constants = (
            nominal.known_soils,
            nominal.uncertain_constants,
        )
        self.effect_values, self.small, self.fewest, self.little = 0, SMALL, FEWEST, LITTLE
        self.rounds, self.largest, self.widest = ROUNDS, LARGEST_ERROR, WIDEST_SLIP
        self.least_slip, self.most_slip = INSIDE
        self.unsteady_share = UNSTEADY**2
        self.register_buffer("wheel_y", wheel_y)
        scaled = torch.tensor(yaw_inertia, dtype=torch.float64) * nominal.body_scale[2]
        self.register_buffer("yaw_inertia", scaled)
        wheelbase = float(nominal.axle_x.amax() - nominal.axle_x.amin())
        unsteady = [nominal.gravity**2, (nominal.gravity / wheelbase * float(scaled)) ** 2]
        self.register_buffer("unsteady", torch.tensor(unsteady, dtype=torch.float64))
        spent, telling = spent_rows(rows, axles)
        self.register_buffer("spent", torch.tensor(spent))
        self.register_buffer("telling", torch.tensor(telling))
        pulled = [float(name in PULLED) for name in ("mean_velocity", *rows)]
        self.register_buffer("pulled", torch.tensor(pulled, dtype=torch.float64))
        kept = [float(place not in spent) for place in range(len(rows))]
        self.register_buffer("kept", torch.tensor(kept, dtype=torch.float64))

    def constants_of(self, chosen: Tensor, deviations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the constants of the ``chosen`` soil, as the nominal physics does."""
        return self.nominal.constants_of(chosen, deviations)

    def usable(self, view: PackedView, leading: Tensor) -> Tensor:
        """Return the usable wheels, as the nominal physics does; each motion has to be known."""
        inside = view_of(with_slip(view.packed, self.inside(view.slip)), self.axles)
        return self.nominal.usable(inside, leading) & moves(body_motion(view))

    def inside(self, slip: Tensor) -> Tensor:
        """Return slips within the range of a planar rover's law; NaN beyond WIDEST_SLIP."""
        known = slip.abs() <= self.widest
        return torch.where(known, slip.clamp(self.least_slip, self.most_slip), float("nan"))

    def balanced(
        self, view: PackedView, constants: Tensor, varied: Tensor, strength: Tensor
    ) -> PackedView:
        """Return one observation with the sinkages that the balances make most likely.

        Arguments as of the nominal physics; one with all sinkages is returned as it is.
        """
        packed = view.packed.unsqueeze(0)
        if not any_of(lacks_sinkage(packed, self.axles)):
            return view
        contact = values_alone(self.nominal.contact_of(constants, varied))
        theta = torch.cat([strength, torch.ones_like(strength[:1])])
        missing = torch.isnan(view_of(packed, self.axles).sinkage)
        return view_of(self.with_sinkages(packed, missing, contact, theta)[0], self.axles)

    def with_sinkages(
        self, packed: Tensor, missing: Tensor, contact: ContactModel, theta: Tensor
    ) -> Tensor:
        """Return observations [n, P] with what :func:`found_sinkage` finds where one is missing.

        ``missing`` is bool [n, W]; there ``packed`` has NaN, or what was found before.
        """
        view = view_of(packed, self.axles)
        depth = torch.where(torch.isnan(view.sinkage), usual_sinkage(contact), view.sinkage)
        frame = self.frame(with_sinkage(packed, depth), contact)
        motion = safe_motion(body_motion(frame.measured), frame.usable)
        left = self.hub_velocity(motion)
        moved = motion_across(frame.measured.slip, motion.rim, motion.steering, left)
        found = found_sinkage(frame, WheelMotion(*moved), missing, contact, theta, self.telling)
        depth = torch.where(missing, found, view.sinkage)
        deviation = torch.where(missing, self.little * depth, view.sinkage_sd)
        return with_sinkage_and_sd(packed, depth, deviation)

    def hub_velocity(self, motion: BodyMotion) -> Tensor:
        """Return the velocity of the hubs along the body's y, [..., W] [m/s]."""
        turning = motion.yaw_rate.unsqueeze(-1) * self.nominal.axle_x
        return motion.lateral.unsqueeze(-1) + turning

    def frame(self, packed: Tensor, contact: ContactModel) -> Frame:
        """Return the frame of observations [n, P], with all rows as an instant has them.

        Accelerations of the last two are the slopes of the block.
        """
        slip = view_of(packed, self.axles).slip
        straight = frame_of(with_slip(packed, self.inside(slip)), contact)
        usable = straight.usable
        own = with_slip(straight.measured.packed, torch.where(usable, slip, contact.stand_in[0]))
        view = view_of(own, self.axles)
        motion = safe_motion(body_motion(view), usable)
        slope, _ = block_slopes(view.step)
        levers = levers_by_wheel(
            view, motion.steering, contact.geometry, self.wheel_y, self.nominal.body_scale
        )
        enough = 1.0 if packed.shape[0] >= self.fewest else 0.0
        there = torch.full_like(straight.used[:, :1], enough) * straight.used[:, 0].amin()
        ahead, _, others = straight.target.split_with_sizes([1, 1, levers.shape[3] - 5], 1)
        body = self.body()
        up = level_share(body, view, motion).unsqueeze(1)
        steady = pulled_beside(body, view, motion)
        lateral = (slope * velocity_beside(body, motion)).mean() + steady
        turning = torch.zeros_like(lateral) + (slope * motion.yaw_rate).mean() * self.yaw_inertia
        beside = torch.stack([torch.zeros_like(lateral), lateral, turning], 1)
        rolling = torch.full_like(there, contact.moment_variance)
        unsteady = (self.unsteady_share * self.unsteady).expand(packed.shape[0], -1)
        return Frame(
            view,
            usable,
            levers,
            nn.functional.pad(straight.tilt, [0, 3]),
            torch.cat([ahead, up, others, beside], 1),
            torch.cat([straight.variance, rolling, unsteady], 1),
            torch.cat([straight.used, straight.used[:, -1:], there, there], 1),
        )

    def body(self) -> BodyBeside:
        """Return the numbers of the rows of how the body moves beside."""
        return BodyBeside(
            self.nominal.axle_x, self.nominal.centre[0], self.yaw_inertia, self.gravity
        )

    def rows(
        self,
        frame: Frame,
        likely: Tensor,
        contact: ContactModel,
        doubt: Tensor | None,
        values: Tensor | None = None,
    ) -> Rows:
        """Return the rows in a frame, expanded at ``likely`` [n, P], less the excess of doubt.

        ``values`` [1, V] are those of effects in the contact, where the forces have any.

        Behind the sources of a planar rover stand the lateral velocity, the yaw rate, the roll, and
        the banks of the ground below the wheels.
        """
        place = places(likely, frame, contact)
        where = varied_inputs(place, contact)
        motion = safe_motion(body_motion(place), frame.usable)
        left = self.hub_velocity(motion)
        rim, along, across = motion_across(where.slip, motion.rim, motion.steering, left)
        own = 2  # of the stencil: slip and sinkage as they are
        moved = WheelMotion(
            torch.cat([rim, rim[own : own + 1]]),
            torch.cat([along, along[own : own + 1]]),
            torch.cat([across, across[own : own + 1] + self.small]),
        )
        sets = torch.cat([where.constants, where.constants[own : own + 1]])
        sinkage = torch.cat([where.sinkage, where.sinkage[own : own + 1]])
        every = self.forces(moved, motion.rim, sinkage, sets, contact, values)
        evaluated = every[:-1]
        by_across = (every[-1] - every[own]) * (contact.column_unit / self.small)  # [n, W, 4, 3]
        forces = measured_forces(frame, place, read_forces(evaluated, where.scale, contact, doubt))
        measured = safe_motion(body_motion(frame.measured), frame.usable)
        faster = 1.0 / (motion.rim.abs() * torch.cos(motion.steering))
        further = (self.hub_velocity(measured) - left) * faster
        measured_values = forces.values + nn.functional.pad(
            (by_across * further.unsqueeze(-1).unsqueeze(-1)).unsqueeze(0),
            [0, 0, 0, 0, 0, 0, 0, 0, 0, forces.values.shape[0] - 1],
        )
        rows = rows_of_forces(frame, Forces(measured_values, forces.by_slip, forces.by_sinkage))
        by_left = by_across * faster[:, :, None, None]
        banks = levers_of_banks(
            frame.measured,
            measured.steering,
            contact.geometry,
            self.wheel_y,
            self.nominal.body_scale,
        )
        by_bank = banks @ forces.values[0]
        return with_motion(self.body(), rows, frame, measured, by_left, by_bank)

    def agreed(
        self,
        frame: Frame,
        packed: Tensor,
        contact: ContactModel,
        theta: Tensor,
        chosen: Tensor,
        missing: Tensor,
        values: Tensor | None = None,
    ) -> Agreement:
        """Return the inputs on which the rows agree best, as ``agreement`` does for a planar rover.

        ``missing`` [n, W] are the wheels whose sinkage ``packed`` has from the rows, ``values`` as
        in :meth:`rows`.

        Wheels that slip little turn their shear far with a small motion across: the steps are
        repeated.
        """
        alone, wheels = values_alone(contact), self.axles
        likely, doubt = packed, torch.zeros_like(packed[:, : 3 * wheels])
        view = view_of(packed, wheels)
        motion = body_motion(view)
        for _ in range(self.rounds):
            rows = self.spent_where(missing, self.rows(frame, likely, alone, None, values), theta)
            others = rows.used.shape[1] - 1
            used = (rows.used * chosen).narrow(1, 1, others)
            noise = (rows.noise[0] @ theta).narrow(1, 1, others) * used.unsqueeze(-1)
            short = (rows.target - rows.features[0] @ theta).narrow(1, 1, others) * used
            own = rows.variance.narrow(1, 1, others) * used + (1.0 - used)
            factor = cholesky(noise @ noise.transpose(1, 2) + torch.diag_embed(own))
            white = torch.linalg.solve_triangular(
                factor, torch.cat([noise, short.unsqueeze(-1)], 2), upper=False
            )
            told, surprise = white.split_with_sizes([noise.shape[2], 1], 2)
            error = (told * surprise).sum(1).clamp(-self.largest, self.largest)
            faster, deeper, _, aside, turned, _ = error.split_with_sizes(
                [wheels, wheels, wheels + 1, 1, 1, noise.shape[2] - 3 * wheels - 3], 1
            )
            slip = view.slip + view.slip_sd * faster
            sunk = torch.maximum(view.sinkage + view.sinkage_sd * deeper, 0.3 * view.sinkage)
            possible = are_usable(self.inside(slip), sunk, view.contact_angle, contact)
            slip = torch.where(possible, slip, view.slip)
            sunk = torch.where(possible, sunk, view.sinkage)
            lateral = motion.lateral + motion.lateral_sd * aside.squeeze(1)
            yaw_rate = motion.yaw_rate + motion.yaw_rate_sd * turned.squeeze(1)
            likely = with_sinkage(with_slip(packed, slip), sunk)
            likely = with_body_motion(likely, lateral, yaw_rate)
            if any_of(missing):
                likely = self.with_sinkages(likely, missing, alone, theta)
                frame = self.frame(self.at_found(packed, likely, missing), contact)
            of_slip, of_sinkage, _ = told.split_with_sizes(
                [wheels, wheels, noise.shape[2] - 2 * wheels], 2
            )
            left = [
                1.0 - (of_slip * of_slip).sum(1),
                1.0 - (of_sinkage * of_sinkage).sum(1),
                -(of_slip * of_sinkage).sum(1),
            ]
            doubt = torch.cat(left, 1)
        return Agreement(likely, doubt.view(-1, 3, wheels))

    def average(
        self, packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the rows of a block [n, P] on a soil; arguments as of the nominal physics."""
        deviations = expansion[2:]
        contact = self.nominal.contact(soil, deviations)
        theta = torch.cat([expansion[:2], torch.ones_like(expansion[:1])])
        view = view_of(packed, self.axles)
        known = torch.where(moves(body_motion(view)), view.slip, float("nan"))
        packed, missing = with_slip(packed, known), torch.isnan(view.sinkage)
        if any_of(missing):
            packed = self.with_sinkages(packed, missing, values_alone(contact), theta)
        frame = self.frame(packed, contact)
        agreed = self.agreed(frame, packed, contact, theta, chosen, missing)
        if any_of(missing):
            frame = self.frame(self.at_found(packed, agreed.inputs, missing), contact)
        rows = self.rows(frame, agreed.inputs, contact, agreed.doubt)
        motion = safe_motion(body_motion(frame.measured), frame.usable)
        rows = of_slopes(self.body(), rows, frame, motion, self.nominal.moment_variance)
        rows = self.ground(rows, frame, motion, contact, theta)
        rows = self.spent_where(missing, rows, theta)
        return self.averaged(rows, frame, learnt, deviations, chosen)

    def at_found(self, packed: Tensor, likely: Tensor, missing: Tensor) -> Tensor:
        """Return observations [n, P] with the sinkages of ``likely`` where one is ``missing``.

        Nothing was measured there, so that rows need not be moved to it.
        """
        found = view_of(likely, self.axles).sinkage
        return with_sinkage(
            packed, torch.where(missing, found, view_of(packed, self.axles).sinkage)
        )

    def spent_where(self, missing: Tensor, rows: Rows, theta: Tensor) -> Rows:
        """Return ``rows`` as :func:`spent_on_sinkage` does where a sinkage is ``missing``."""
        if not any_of(missing):
            return rows
        return spent_on_sinkage(rows, missing, theta, self.spent, self.kept)

    def averaged(
        self, rows: Rows, frame: Frame, learnt: Tensor, deviations: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the mean of the ``rows`` of a block, with mass and centre of mass in them.

        About a centre that is dx ahead and dy to the left of the rover file's the moment of the
        wheels is dx SUM Y less and dy SUM X more; these sums are m times the specific forces of the
        body, whose slopes are read. More mass takes more force for the same motion ahead and
        beside. Then the spent rows are taken off these columns, too.
        """
        nominal, view = self.nominal, frame.measured
        slope, share = block_slopes(view.step)
        per_shift = nominal.body_scale[2] / nominal.body_scale[0]  # 1 / (g b) [s^2/m^2]
        count = rows.used.shape[1]
        used = rows.used * chosen
        motion = safe_motion(body_motion(view), frame.usable)
        # not the row's target, of which spent rows may be taken off
        beside = slopes_beside(self.body(), view, motion).mean()
        ahead = slope * view.velocity + share * self.gravity * torch.sin(view.pitch)
        turned = ahead * per_shift * used.select(1, count - 1)
        torque = frame.target.narrow(1, 2, self.axles)
        columns = observed_columns(turned, torque, motion.rim, learnt.shape[2], count)
        fixed = nominal.fixed_columns
        wide, step = fixed.shape[1], view.step * used[:, 0]
        weight = row_weights(used, step)
        pulled = (velocity_twice(frame.target, 1) * weight).sum(0) * self.pulled
        heavier = nn.functional.pad(-pulled.unsqueeze(1), [0, wide - 1])
        shifted = nn.functional.pad(
            (-per_shift * beside).view(1, 1), [1, wide - 2, fixed.shape[0] - 1, 0]
        )
        velocity = torch.stack([view.velocity, view.velocity_sd**2], 1)
        columns = columns + torch.where(used[:, :1].unsqueeze(-1) > 0.0, learnt, 0.0)
        fixed = fixed + heavier + shifted
        if rows.taken.shape[2] > 0:
            columns = without_spent(columns, rows.taken, self.spent)
            multiples = (velocity_twice(rows.taken, 1) * weight.unsqueeze(-1)).sum(0)
            fixed = fixed - multiples @ fixed.index_select(0, self.spent + 1)
        none = rows.taken.narrow(2, 0, 0)
        averaged = block_rows(
            Rows(rows.features, rows.noise, rows.target, rows.variance, used, none),
            columns,
            step,
            velocity,
            deviations,
            fixed,
            nominal.link_variance,
        )
        return SoilRows(averaged, rows.noise[0, :, 0])

    def drive_row(
        self, view: PackedView, constants: Tensor, varied: Tensor, deviations: Tensor
    ) -> Tensor:
        """Return the velocity row of one observation and its changes, as rows.drive_row does."""
        del deviations
        contact = self.nominal.contact_of(constants, varied)
        motion = body_motion(view)
        rim, along, across = motion_across(
            view.slip, motion.rim, motion.steering, self.hub_velocity(motion)
        )
        sets = (constants + varied).unsqueeze(1)
        forces = rolling_forces(
            WheelMotion(rim, along, across), view.sinkage, sets, contact.radius, contact.width,
            contact.nodes,
        )  # fmt: skip
        sine, cosine = torch.sin(view.contact_angle), torch.cos(view.contact_angle)
        left, ahead = torch.sin(motion.steering), torch.cos(motion.steering)
        lever = torch.stack([-sine * ahead, cosine * ahead, torch.zeros_like(sine), -left], -1)
        row = (lever.unsqueeze(-1) * forces).sum([1, 2]) * (
            contact.column_unit * contact.body_scale[0]
        )
        return torch.cat([row[:1], 1e3 * (row[1:] - row[:1])])

    def has_moved(self, packed: Tensor, before: Tensor, after: Tensor) -> Tensor:
        """Return whether other rows would be needed, as the nominal physics does."""
        return self.nominal.has_moved(packed, before, after)

    def effect_sizes(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return the moments [J, 2] of the sizes of J = 0 named effects."""
        return self.nominal.effect_sizes(mean, variance)

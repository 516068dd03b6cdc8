# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""P-ALPaCA as one TorchScript module: features, rows, noise, prior and the recursive posterior.

Parameters k = [c (kPa), tan phi, net weights, soil constants, mass, centre of mass, acceleration
bias, velocity]; the rows are affine in k,

    y = [Phi_nom Phi_net] k + phi_nom + eps                        (Banerjee et al. eq. 19)

with k ~ N(mean, precision^-1) in information form (eqs. 20 and 21). Two things differ from the
paper, both because its recursion is biased by noise in the regressors (slip and sinkage are
measured to 5 %):

- Ten observations make a block, whose rows are their averages. The velocity is part of k and
  carried through the block by a row of its own, so that no noisy velocity is ever differenced.
- A block's posterior minimises r' S(theta)^-1 r with S moving with theta: orthogonal distance
  regression (Boggs, Byrd and Schnabel 1987), a few Gauss-Newton steps a block.

As that sum is not convex far from its minimum, a small bank of posteriors starts from a grid over
the prior (a Gaussian sum: Alspach and Sorenson 1972). A model with a net has that grid twice, the
second time with the net (a prior of spike and slab: Mitchell and Beauchamp 1988). All run as one
batch, and the published posterior is their mixture. The ground may change: where a block surprises,
some posteriors are started anew from the prior, with the weight of a hazard rate, and after it the
best of all are kept (Bayesian changepoint detection with a pruned bank: Adams and MacKay 2007). So
the estimate re-opens where the data contradict it, instead of drifting slowly.

Between blocks each observation moves a scalar Kalman filter of the velocity, driven by the force
that the posterior predicts.

The model has four parts: physics (rows of a block), net (learnt columns, or none), velocity filter,
and the rules of the bank. Each step of an update is a function without branches on tensors; the
branches are in ``update``, ``close`` and ``solve``. studies/batched.py runs the same steps for many
drives.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.model.bank import Bank, Solved, join, members_of, restarted, take, taken
from terrain_estimator.model.block import Posterior, Solution, solve_block
from terrain_estimator.model.gaussian import mixture, project
from terrain_estimator.model.hypotheses import Hypotheses
from terrain_estimator.model.innovation import Misses, misses
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.packed_observation import BLOCK, packed_size
from terrain_estimator.model.packing import PackedView, view_of, with_slip, without_link
from terrain_estimator.model.parameters import ParameterLayout, parameter_layout
from terrain_estimator.model.physics import SoilRows
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.physics_with_effects import AnyPhysics
from terrain_estimator.model.prior import Prior
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.velocity import Motion, VelocityFilter
from terrain_estimator.model.wheels_with_effects import WheelsWithEffects
from terramechanics.simulation.sample import TIME_STEP

REEVALUATIONS = 3
"""Times that the rows of a block are evaluated anew at most."""
RECENT = 3
"""[blocks] Age up to which a posterior counts for a change of the ground."""
LEAST_KNOWN = 0.5
"""[1] Part of an unknown velocity's precision that links an observation to the one before."""


class PAlpaca(nn.Module):
    """The model behind ``initial``, ``update`` and ``predict`` on a state of tensors.

    Scripted and saved, it needs nothing but torch. All tensors are float64; an observation is the
    flat tensor of ``terrain_estimator.model.packing``, the state that of
    ``terrain_estimator.model.state``. Nothing raises on numbers: a caller checks that the state is
    finite and keeps the one of before where it is not.
    """

    layout: ParameterLayout
    longest_step: Tensor
    every_row: Tensor

    def __init__(self, physics: AnyPhysics, net: NetFeatures, prior: Prior) -> None:
        """Compose the model; ``prior`` has the deviation of soil constants that ``physics`` has."""
        super().__init__()
        self.prior = prior  # for the metadata; the scripted module has the buffers
        self.layout = parameter_layout(
            net.columns, physics.uncertain_constants, physics.effect_values
        )
        self.physics, self.net = physics, net
        self.hypotheses = Hypotheses(prior, self.layout, physics.known_soils)
        self.velocity = VelocityFilter(physics.gravity, self.layout.first_constant)
        self.axles, self.known_soils = physics.axles, physics.known_soils
        self.observation_size = packed_size(
            physics.axles,
            rates=physics.effect_values > 0,
            by_wheel=isinstance(physics, PhysicsByWheel | WheelsWithEffects),
        )
        self.block_size, self.step_s, self.recent = BLOCK, TIME_STEP, RECENT
        self.least_known, self.most_reevaluations = LEAST_KNOWN, REEVALUATIONS
        self.register_buffer("longest_step", torch.tensor([1.0, 0.25], dtype=torch.float64))
        self.register_buffer("every_row", torch.ones(row_count(physics), dtype=torch.float64))

    def forward(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """Return the state after ``observation``, as ``update`` does."""
        return self.update(state, observation)

    @torch.jit.export
    def initial(self) -> dict[str, Tensor]:
        """Return the state at the start, with the model's own prior and no drift."""
        soils = torch.full((self.known_soils,), 1.0 / self.known_soils, dtype=torch.float64)
        own = self.hypotheses
        return self.initial_with_prior(own.prior_mean, own.prior_sd, soils, 0.0)

    @torch.jit.export
    def initial_with_prior(
        self, mean: Tensor, sd: Tensor, soils: Tensor, drift: float
    ) -> dict[str, Tensor]:
        """Return the state before the first observation, with a user's prior.

        ``mean`` [2] and ``sd`` [2] are of (c [Pa], tan phi), ``soils`` [K] the probability of each
        soil. ``drift`` [1/sqrt(s)] is the random walk of c and tan phi, in prior deviations.
        """
        unit = self.hypotheses.unit
        zero = torch.zeros_like(unit[0])
        nothing = torch.full_like(zero, float("nan"))
        state = {
            "block": torch.zeros(0, self.observation_size, dtype=torch.float64),
            "prior_mean": mean / unit,
            "prior_sd": sd / unit,
            "random_walk": drift * sd / unit,
            "log_soils": torch.log(soils),
            "velocity": zero,
            "velocity_variance": 1.0 / self.hypotheses.rover_precision[-1],
            "closed": zero,
            "changed": zero,
            "usable": torch.zeros(self.axles, dtype=torch.bool),
        }
        for name in (
            "acceleration",
            "acceleration_variance",
            "velocity_acceleration_covariance",
            "feature_noise",
            "change",
            "change_weight",
        ):
            state[name] = zero
        for name in (
            "forecast",
            "forecast_variance",
            "innovation",
            "innovation_variance",
            "misfit",
            "degrees",
        ):
            state[name] = nothing
        for name in ("single_misses", "white_misses"):
            state[name] = torch.full_like(self.every_row, float("nan"))
        return self.publish(state, self.hypotheses.first(state))

    @torch.jit.export
    def update(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """Return the state after one packed observation [P].

        Every tenth closes a block and moves the posterior.
        """
        view = view_of(observation, self.axles)
        usable = self.physics.usable(view, state["constants"])
        linked = (
            bool(view.linked > 0.0)
            and bool(self.is_known(state["velocity_variance"]))
            and bool(usable.all())
        )
        closes = state["block"].shape[0] > 0 and not linked
        if linked:
            state = self.track(state, view)
        else:
            if closes:
                state = self.close(state)
            state = self.velocity.unlink(state, view.velocity, view.velocity_sd**2)
            observation = self.first_of_block(view, usable)
        state["block"] = torch.cat([state["block"], observation.unsqueeze(0)])
        if state["block"].shape[0] == self.block_size:
            closes = True
            state = self.close(state)
        if closes:
            state["changed"] = (state["weight"] * (state["age"] <= self.recent)).sum()
        state["closed"] = torch.full_like(state["changed"], 1.0 if closes else 0.0)
        state["usable"] = usable
        forecast, variance = self.velocity.forecast(state, self.step_s)
        state["forecast"], state["forecast_variance"] = forecast, variance
        return state

    @torch.jit.export
    def predict(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """Return mean [m/s] and variance [2] of the velocity that ``observation`` [P] measures."""
        view = view_of(observation, self.axles)
        motion = self.motion(state, view)
        return torch.stack([motion.velocity, motion.velocity_variance + view.velocity_sd**2])

    @torch.jit.export
    def discard(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Return the state without the open block, with an unknown velocity."""
        unknown = 1.0 / self.hypotheses.rover_precision[-1]
        state = self.velocity.unlink(state, state["velocity"], unknown)
        state["block"] = state["block"][:0]
        return state

    @torch.jit.export
    def estimate(self, state: dict[str, Tensor]) -> Tensor:
        """Return the marginal posterior of (c, tan phi) over every soil [3, 2].

        The first row is the mean [Pa, 1], the others are the covariance.
        """
        unit = self.hypotheses.unit
        mean, covariance = state["strength_mean"] * unit, state["strength_covariance"] * unit
        return torch.cat([mean.unsqueeze(0), covariance * unit.unsqueeze(-1)])

    @torch.jit.export
    def effects(self, state: dict[str, Tensor]) -> Tensor:
        """Return mean and variance of the size of each of J effects in SI units [J, 2]."""
        layout = self.layout
        own = torch.eye(layout.size, dtype=torch.float64)[layout.first_effect : layout.first_fixed]
        means, covariances = project(state["mean"], state["precision"], own)
        mean, covariance = mixture(torch.log(state["weight"]), means, covariances)
        return self.physics.effect_sizes(mean, torch.diagonal(covariance))

    def is_known(self, variance: Tensor) -> Tensor:
        """Return whether a velocity of this ``variance`` [] is worth carrying over."""
        return variance * self.velocity.open_precision < self.least_known

    def motion(self, state: dict[str, Tensor], view: PackedView) -> Motion:
        """Return the motion at one observation, as the posterior predicts it."""
        layout = self.layout
        learnt = self.net.distinct(
            view.slip, view.sinkage, view.contact_angle, view.pitch.unsqueeze(0)
        )[0]
        view = self.physics.balanced(
            view, state["constants"], state["varied"], state["expected"][:2]
        )
        deviations = state["expected"][layout.first_constant : layout.first_fixed]
        row = self.physics.drive_row(view, state["constants"], state["varied"], deviations)
        return self.velocity.predict(state, row, without_nan(learnt), view.pitch, view.step)

    def track(self, state: dict[str, Tensor], view: PackedView) -> dict[str, Tensor]:
        """Return the state after a Kalman step of the velocity with one observation."""
        motion = self.motion(state, view)
        return self.velocity.track(state, motion, view.velocity, view.velocity_sd, view.step)

    def first_of_block(self, view: PackedView, usable: Tensor) -> Tensor:
        """Return an observation [P] that covers no time and has the slips of ``usable`` wheels [W].

        Every soil has to explain the same rows.
        """
        slip = torch.where(usable, view.slip, float("nan"))
        return without_link(with_slip(view.packed, slip))

    def learnt(self, packed: Tensor) -> Tensor:
        """Return the net columns [n, R, net] of packed observations [n, P]; 0 without a sinkage."""
        view = view_of(packed, self.axles)
        return without_nan(
            self.net(view.slip, view.sinkage, view.contact_angle, view.pitch.unsqueeze(1))
        )

    def average(self, packed: Tensor, soil: int, expansion: Tensor, chosen: Tensor) -> SoilRows:
        """Return the rows of a block [n, P] on a soil, see Physics."""
        return self.physics.average(packed, self.learnt(packed), soil, expansion, chosen)

    def publish(self, state: dict[str, Tensor], bank: Bank) -> dict[str, Tensor]:
        """Return the state with another bank, its mixtures, and the leading soil's constants."""
        state = self.hypotheses.publish(state, bank)
        leading = self.hypotheses.leading(state["soils"]).to(torch.float64)
        deviations = state["expansion"][:, 2 : 2 + self.layout.constants]
        constants, varied = self.physics.constants_of(leading, deviations)
        state["constants"], state["varied"] = constants, varied
        return state

    def finish(
        self, state: dict[str, Tensor], noise: Tensor, misfit: Tensor, degrees: Tensor
    ) -> dict[str, Tensor]:
        """Return the state after a block, with its misfit and the velocity of the posterior.

        ``noise`` [n, E, 3] is that of the velocity rows on the leading soil.
        """
        state = self.velocity.reinitialize(state, noise)
        state["misfit"], state["degrees"] = misfit, degrees
        return state

    def close(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Return the state after the open block; of its two velocities the newest goes on."""
        packed = state["block"]
        seconds = view_of(packed, self.axles).step.sum()
        state = self.hypotheses.diffuse(state, seconds)
        learnt = self.learnt(packed)
        solved, soil_rows = self.solve_active(state, packed, learnt)
        leading = int(self.hypotheses.most_probable(state["soils"]))
        first = list(soil_rows.keys())[0]  # noqa: RUF015 (TorchScript has no next)
        missed = self.missed(state, soil_rows[leading if leading in soil_rows else first], seconds)
        degrees = soil_rows[first].rows.present.sum() - 1.0
        if bool(self.hypotheses.surprised(solved.solution, degrees)):
            solved, soil_rows = self.solve_restarted(state, packed, learnt, solved, soil_rows)
        bank, misfit = self.hypotheses.select(solved)
        state = self.publish(state, without_inactive(bank))
        leading = int(self.hypotheses.most_probable(state["soils"]))
        noise = soil_rows[leading if leading in soil_rows else first].noise
        state = self.finish(state, noise, misfit, degrees)
        state["single_misses"], state["white_misses"] = missed.single, missed.white
        state["block"] = packed[:0]
        return state

    def missed(self, state: dict[str, Tensor], averaged: SoilRows, seconds: Tensor) -> Misses:
        """Return how a block's rows on the leading soil miss what the state before it predicts.

        c and tan phi drifted for ``seconds`` [].
        """
        others = self.layout.size - 2
        drift = nn.functional.pad(state["random_walk"] ** 2 * seconds, [0, others])
        covariance = state["covariance"] + torch.diag(drift)
        return misses(averaged.rows, state["expected"], covariance, self.layout.first_constant)

    def solve_active(
        self, state: dict[str, Tensor], packed: Tensor, learnt: Tensor
    ) -> tuple[Solved, dict[int, SoilRows]]:
        """Return the bank's hypotheses after a block [n, P], and the rows on their soils."""
        members, soils = members_of(state), self.hypotheses.active_soils(state)
        active: list[int] = soils.tolist()
        soil_rows: dict[int, SoilRows] = {}
        pieces: list[Solved] = []
        for soil in range(self.known_soils):
            if soil in active:
                own = members
                if active.count(soil) < len(active):
                    own = taken(members, torch.nonzero(soils == soil).squeeze(1))
                expansion = state["expansion"][soil]
                solution, rows = self.solve(own.posterior, packed, learnt, soil, expansion)
                soil_rows[soil] = rows
                pieces.append(Solved(solution, own.age, own.kind))
        solved = pieces[0]
        for piece in pieces[1:]:
            solved = join(solved, piece)
        return solved, soil_rows

    def solve(
        self, before: Posterior, packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor
    ) -> tuple[Solution, SoilRows]:
        """Return the posteriors ``before`` a block after it, and its rows at ``expansion``.

        Where the block moves a soil constant or a named effect far, or c and tan phi while a
        sinkage is missing, it is solved with rows that are evaluated anew at the new values.
        """
        first = self.physics.average(packed, learnt, soil, expansion, self.every_row)
        solution = solve_block(before, first.rows, self.longest_step)
        for _ in range(self.most_reevaluations):
            after = self.expansion_after(solution.posterior)
            if not bool(self.physics.has_moved(packed, expansion, after)):
                break
            expansion = after
            again = self.physics.average(packed, learnt, soil, expansion, self.every_row)
            solution = solve_block(before, again.rows, self.longest_step)
        return solution, first

    def expansion_after(self, posterior: Posterior) -> Tensor:
        """Return the mean [2 + M + V] of (c [kPa], tan phi), soil constants and effects."""
        return torch.softmax(posterior.log_weight, 0) @ self.hypotheses.places(posterior.mean)

    def solve_restarted(
        self,
        state: dict[str, Tensor],
        packed: Tensor,
        learnt: Tensor,
        solved: Solved,
        soil_rows: dict[int, SoilRows],
    ) -> tuple[Solved, dict[int, SoilRows]]:
        """Return ``solved`` with hypotheses started anew on every possible soil, and all rows."""
        for soil in range(self.known_soils):
            if bool(state["log_soils"][soil] == -float("inf")):
                continue
            if soil not in soil_rows:
                expansion = state["expansion"][soil]
                soil_rows[soil] = self.physics.average(
                    packed, learnt, soil, expansion, self.every_row
                )
            start = self.hypotheses.restart(state, soil)
            solution = solve_block(start, soil_rows[soil].rows, self.longest_step)
            solved = join(solved, restarted(solution, soil))
        return solved, soil_rows


def row_count(physics: AnyPhysics) -> int:
    """Return the number R of the rows of one observation."""
    if isinstance(physics, PhysicsByWheel | WheelsWithEffects):
        return int(physics.nominal.fixed_columns.shape[0]) - 1
    return len(row_names(physics.axles))


def without_nan(columns: Tensor) -> Tensor:
    """Return learnt ``columns`` with 0 where an input of the net is missing."""
    return torch.where(torch.isnan(columns), 0.0, columns)


def without_inactive(bank: Bank) -> Bank:
    """Return the hypotheses with a weight.

    Where none has one, as after a number beyond all bounds, all are kept, and NaN follows.
    """
    active = torch.nonzero(bank.weight != -float("inf")).squeeze(1)
    return take(bank, active) if 0 < active.shape[0] < bank.weight.shape[0] else bank

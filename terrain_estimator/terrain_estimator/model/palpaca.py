# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""P-ALPaCA as one TorchScript module: features, rows, noise, prior and the recursive posterior.

Parameters k = [c (kPa), tan phi, net weights, soil constants, mass, centre of mass, acceleration
bias, velocity]; the rows are affine in k,

    y = [Phi_nom Phi_net] k + phi_nom + eps                                   (Banerjee et al. eq. 19)

with k ~ N(mean, precision^-1) in information form (eqs. 20 and 21). Two things differ from the
paper, both because its recursion is biased by noise in the regressors (slip and sinkage are
measured to 5 %):

- Ten observations make a block, whose rows are their averages. The velocity is part of k and
  carried through the block by a row of its own, so that no noisy velocity is ever differenced.
- A block's posterior minimises r' S(theta)^-1 r with S moving with theta: orthogonal distance
  regression (Boggs, Byrd and Schnabel 1987), a few Gauss-Newton steps a block.

As that sum is not convex far from its minimum, a small bank of posteriors starts from a grid over
the prior (a Gaussian sum: Alspach and Sorenson 1972), once without the net and once with it (a
prior of spike and slab: Mitchell and Beauchamp 1988). All run as one batch, and the published
posterior is their mixture. The ground may change: before each block some posteriors are born from
the prior anew, with the weight of a hazard rate, and after it the best of all are kept (Bayesian
changepoint detection with a pruned bank: Adams and MacKay 2007). So the estimate is re-opened where
the data say that the ground is another, instead of being dragged along.

Between blocks each observation moves a scalar Kalman filter of the velocity, driven by the force
that the posterior predicts.
"""

import torch
from torch import Tensor

from terrain_estimator.model.bank import Bank, Solved, join, take, weigh
from terrain_estimator.model.block import BlockRows, Posterior, Solution, solve_block
from terrain_estimator.model.hypotheses import Hypotheses
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.prior import Prior, RoverBody
from terramechanics.simulation.simulation import TIME_STEP

BLOCK = 10
"""Observations in a block: one second at 10 Hz."""
RECENT = 3
"""[blocks] Age up to which a posterior speaks for a change of the ground."""

State = dict[str, Tensor]
"""All that the model remembers, of constant size but for the n < 10 observations of the open block:

- ``mean`` [H, D], ``precision`` [H, D, D], ``log_weight`` [H]: the bank at the start of the open
  block
- ``block`` [n, 8 A + 9]: packed observations
- ``weight`` [H]: of each posterior in the mixture; what it puts on negative c or tan phi does not
  count
- ``age`` [H]: blocks since each was born from the prior; those of the start are older than any
- ``kind`` [H]: index of the soil whose constants, plus its own deviations, each has; K more where
  the net has a say
- ``prior`` [3, 2]: mean, deviation, and random walk [1/sqrt(s)] of (c [kPa], tan phi), the user's
  or the model's
- ``log_soils`` [K]: log prior probability of each soil, -inf where the user excludes it
- ``moments`` [3, 2]: mean and covariance of (c [kPa], tan phi) in the mixture over everything
- ``soils`` [K]: probability of each soil
- ``expansion`` [K, 2 + M]: mean c [kPa], tan phi, deviations of the constants and of named effects,
  given each soil; of one without any, the prior's
- ``expected`` [D], ``covariance`` [D, D]: of the mixture within the most probable soil, which
  predicts the velocity
- ``constants`` [6], ``varied`` [C, 6]: of that soil, as in Contact
- ``velocity`` [2]: mean [m/s] and variance, now
- ``drive`` [6]: last acceleration [m/s^2], NaN where none is known; variance of the noise of its
  features; sum of square changes a step and sum of their weights; variance of the acceleration, and
  its covariance with ``velocity``
- ``innovation`` [2]: measured minus predicted velocity, and its variance; NaN where there was none
- ``misfit`` [2]: squared Mahalanobis distance of the last block, and its degrees of freedom; NaN
  where there was none
- ``report`` [8 + A]: what a caller reads after each observation: the forecast one step ahead [2],
  ``innovation`` [2], ``misfit`` [2], 1 where a block was closed, the probability that the ground
  changed within the last RECENT blocks, and 1 for each axle that is measured and in the model's
  range
"""


class PAlpaca(Hypotheses):
    """The model behind ``initial``, ``update`` and ``predict`` on a state of tensors.

    Scripted and saved, it needs nothing but torch. All tensors are float64; an observation is the
    flat tensor of ``terrain_estimator.model.packing``. Nothing raises on numbers: a caller checks
    that the state is finite and keeps the one of before where it is not.
    """

    longest_step: Tensor

    def __init__(
        self, body: RoverBody, constants: Tensor, prior: Prior, net: NetFeatures, added: int = 0
    ) -> None:
        """See Physics."""
        super().__init__(body, constants, prior, net, added)
        self.block_size, self.step_s, self.recent = BLOCK, TIME_STEP, RECENT
        self.register_buffer("longest_step", torch.tensor([1.0, 0.25], dtype=torch.float64))

    def forward(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """The same as ``update``."""
        return self.update(state, observation)

    @torch.jit.export
    def initial(self) -> dict[str, Tensor]:
        """The state before the first observation, with the model's own prior, on ground whose strength does not drift."""
        soils = torch.full((self.known_soils,), 1.0 / self.known_soils, dtype=torch.float64)
        return self.initial_with_prior(self.prior_mean, self.prior_sd, soils, 0.0)

    @torch.jit.export
    def initial_with_prior(
        self, mean: Tensor, sd: Tensor, soils: Tensor, drift: float
    ) -> dict[str, Tensor]:
        """The same with a user's prior: ``mean`` [2] and ``sd`` [2] of (c [Pa], tan phi), and the probability [K] of each soil.

        ``drift`` [1/sqrt(s)] is the random walk of c and tan phi, in prior deviations: what was
        known of them is forgotten so fast.
        """
        prior = torch.stack([mean, sd, drift * sd]) / self.unit
        start = torch.zeros(self.known_soils, self.offsets.shape[0], self.size, dtype=torch.float64)
        start[:, :, :2] = prior[0] + self.offsets * prior[1]
        start = start.flatten(0, 1).repeat(2, 1)
        kind = torch.arange(2 * self.known_soils).repeat_interleave(self.offsets.shape[0])
        theta_precision = (self.offset_spread * prior[1]) ** -2.0
        silent = torch.full_like(self.net_precision, self.no_say)
        alone = torch.diag(torch.cat([theta_precision, silent, self.other_precision]))
        joined = torch.diag(torch.cat([theta_precision, self.net_precision, self.other_precision]))
        precision = torch.stack([alone, joined]).repeat_interleave(start.shape[0] // 2, 0)
        nothing = torch.full((2,), float("nan"), dtype=torch.float64)
        state = {
            "block": torch.zeros(0, self.observation_size, dtype=torch.float64),
            "velocity": torch.stack([start[0, -1], 1.0 / self.other_precision[-1]]),
            "drive": torch.zeros(6, dtype=torch.float64),
            "innovation": nothing,
            "misfit": nothing,
            "prior": prior,
            "log_soils": torch.log(soils),
            "report": torch.cat(
                [nothing, nothing, nothing, torch.zeros(2 + self.axles, dtype=torch.float64)]
            ),
        }
        age = torch.full((start.shape[0],), 1e9, dtype=torch.float64)
        bank = weigh(Posterior(start, precision, age), age, kind)
        # so that the mixture is exactly the prior, whatever it puts on negative c or tan phi
        weight = (
            self.net_log_weight.view(2, 1, 1)
            + state["log_soils"].unsqueeze(1)
            + self.offset_log_weight
        ).flatten()
        return self.commit(
            state, Bank(bank.mean, bank.covariance, bank.precision, weight, age, kind)
        )

    @torch.jit.export
    def update(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """Take one packed observation [8 A + 9] into the state; every tenth closes a block and moves the posterior."""
        a, report = self.axles, state["report"]
        usable = self.usable_by_all(observation[: 8 * a].view(8, a), state["constants"])
        linked = (
            bool(observation[-1] > 0.0)
            and bool(state["velocity"][1] * self.open_precision < 0.5)
            and bool(usable.all())
        )
        closes = state["block"].shape[0] > 0 and not linked
        if linked:
            state = self.track(state, observation)
        else:
            state = self.unlink(
                self.close(state) if closes else state,
                observation[8 * a],
                observation[8 * a + 1] ** 2,
            )
            slip = torch.where(
                usable, observation[:a], float("nan")
            )  # every soil has to explain the same rows
            observation = torch.cat(
                [slip, observation[a:-2], torch.zeros_like(observation[:2])]
            )  # it covers no time
        state["block"] = torch.cat([state["block"], observation.unsqueeze(0)])
        if state["block"].shape[0] == self.block_size:
            closes = True
            state = self.close(state)
        changed = (
            (state["weight"] * (state["age"] <= self.recent)).sum().unsqueeze(0)
            if closes
            else report[7:8]
        )
        closed = torch.full((1,), 1.0 if closes else 0.0, dtype=torch.float64)
        ahead = self.forecast(state, self.step_s)
        state["report"] = torch.cat(
            [ahead, state["innovation"], state["misfit"], closed, changed, usable.to(torch.float64)]
        )
        return state

    @torch.jit.export
    def discard(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Drop the open block: the posterior stays as it was before it, the velocity is opened."""
        state = self.unlink(state, state["velocity"][0], 1.0 / self.other_precision[-1])
        state["block"] = state["block"][:0]
        return state

    @torch.jit.export
    def estimate(self, state: dict[str, Tensor]) -> Tensor:
        """Marginal posterior of (c, tan phi) over every soil as [3, 2]: the mean [Pa, 1], then the rows of the covariance."""
        moments = state["moments"] * self.unit
        return torch.cat([moments[:1], moments[1:] * self.unit.unsqueeze(-1)])

    def solve(
        self, before: Posterior, packed: Tensor, soil: int, expansion: Tensor
    ) -> tuple[Solution, BlockRows, Tensor]:
        """The posteriors ``before`` a block, after it, with its rows on a soil and their noise, see ``average``."""
        rows, noise = self.average(packed, soil, expansion, self.every_row)
        return solve_block(before, rows, self.longest_step), rows, noise

    def close(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Solve the open block and commit it; of its two velocities the newest goes on."""
        packed = state["block"]
        state = self.wander(state, packed[:, -2].sum())
        seen: list[int] = []
        rows: list[BlockRows] = []
        noise: list[Tensor] = []
        pieces: list[Solved] = []
        soils = torch.where(
            state["log_weight"] != -float("inf"), state["kind"] % self.known_soils, -1
        )
        alive: list[int] = soils.tolist()
        for soil in range(self.known_soils):
            if soil in alive:
                before, age, kind = (
                    Posterior(state["mean"], state["precision"], state["log_weight"]),
                    state["age"],
                    state["kind"],
                )
                if alive.count(soil) < len(alive):
                    members = torch.nonzero(soils == soil).squeeze(1)
                    before = Posterior(
                        before.mean[members], before.precision[members], before.log_weight[members]
                    )
                    age, kind = age[members], kind[members]
                solution, averaged, by_theta = self.solve(
                    before, packed, soil, state["expansion"][soil]
                )
                seen.append(soil)
                rows.append(averaged)
                noise.append(by_theta)
                pieces.append(Solved(solution, age, kind))
        solved = pieces[0]
        for piece in pieces[1:]:
            solved = join(solved, piece)
        degrees = rows[0].present.sum() - 1.0
        if bool(self.surprised(solved.solution, degrees)):
            for soil in range(self.known_soils):
                if bool(state["log_soils"][soil] == -float("inf")):
                    continue
                if soil not in seen:
                    averaged, by_theta = self.average(
                        packed, soil, state["expansion"][soil], self.every_row
                    )
                    seen.append(soil)
                    rows.append(averaged)
                    noise.append(by_theta)
                born = self.born(state, soil)
                age = torch.zeros_like(born.log_weight)
                solution = solve_block(born, rows[seen.index(soil)], self.longest_step)
                solved = join(
                    solved, Solved(solution, age, torch.full_like(age, soil, dtype=torch.long))
                )
        bank, misfit = self.survive(solved)
        survivors = torch.nonzero(bank.weight != -float("inf")).squeeze(1)
        if (
            0 < survivors.shape[0] < bank.weight.shape[0]
        ):  # none: the block held a number beyond all bounds, and what follows is NaN
            bank = take(bank, survivors)
        state = self.commit(state, bank)
        leading = int(state["soils"].argmax())
        state = self.steer(state, noise[seen.index(leading) if leading in seen else 0])
        state["misfit"] = torch.stack([misfit, degrees])
        state["block"] = packed[:0]
        return state

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""P-ALPaCA as one TorchScript module: features, rows, noise, prior and the recursive posterior.

Parameters k = [c (kPa), tan phi, net weights, soil constants, mass, centre of mass, acceleration bias, velocity]; the rows are
affine in k,

    y = [Phi_nom Phi_net] k + phi_nom + eps                                   (Banerjee et al. eq. 19)

with k ~ N(mean, precision^-1) in information form (eqs. 20 and 21). Two things differ from the paper, both because
its recursion is biased by noise in the regressors (slip and sinkage are measured to 5 %):

- Ten observations make a block, whose rows are their averages. The velocity is part of k and carried through the
  block by a row of its own, so that no noisy velocity is ever differenced.
- A block's posterior minimises r' S(theta)^-1 r with S moving with theta: orthogonal distance regression (Boggs, Byrd
  and Schnabel 1987), a few Gauss-Newton steps a block.

As that sum is not convex far from its minimum, a small bank of posteriors starts from a grid over the prior (a
Gaussian sum: Alspach and Sorenson 1972), once without the net and once with it (a prior of spike and slab: Mitchell and Beauchamp
1988). All run as one batch, and the published posterior is their mixture. The
ground may change: before each block some posteriors are born from the prior anew, with the weight of a hazard rate, and
after it the best of all are kept (Bayesian changepoint detection with a pruned bank: Adams and MacKay 2007). So the
estimate is re-opened where the data say that the ground is another, instead of being dragged along.

Between blocks each observation moves a scalar Kalman filter of the velocity, driven by the force that the posterior
predicts.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.bank import Bank, Solved, join, log_physical, merge, prune, shared_noise, take, weigh
from terrain_estimator.block import FIXED, LINK_VARIANCE, BlockRows, Posterior, Solution, block_rows, fixed_columns, solve_block
from terrain_estimator.gaussian import cholesky, drop, mixture, random_walk
from terrain_estimator.net import NetFeatures
from terrain_estimator.packing import packed_size
from terrain_estimator.prior import Body, Prior, uncertain_constants
from terrain_estimator.rows import (
    MOMENT_VARIANCE,
    PA_PER_UNIT,
    Contact,
    Rows,
    drive_row,
    likely_inputs,
    regression_rows,
    row_names,
    usable_wheels,
)
from terramechanics.batching import any_of
from terramechanics.contact import in_range, quadrature
from terramechanics.simulation import TIME_STEP
from terramechanics.suspension import Geometry

OPEN = 1e-2
"""[(m/s)^-2] Precision of a velocity that nothing is known of."""
BLOCK = 10
"""Observations in a block: one second at 10 Hz."""
KEPT = FIXED - 1
"""Parameters of the rover, not of the ground: mass, centre of mass, acceleration bias, velocity."""
BANK = 9
"""Posteriors that are kept, for each soil with and without the net."""
WITH_NET = 3e-3
"""[1] Prior probability that the net has a say: the physics are believed until the data speak against them by 6 nat."""
NO_SAY = 1e12
"""[1] Precision of a net weight that leaves it at zero."""
NEGLIGIBLE = 14.0
"""[nat] A posterior whose weight is e^-14 of the best one's is dropped."""
NEAREST = 0.3
"""[1] Squared Mahalanobis distance below which kin become one."""
HAZARD = 1e-3
"""[1] Prior probability that the ground changes within one block."""
SURPRISE = 0.95
"""[1] Where the known posteriors fit a block better than this share of honest blocks would, none is born: at this quantile of
chi-square a new one that fitted like the average honest block would have a twentieth of the weight at most, and less for its prior."""
RECENT = 3
"""[blocks] Age up to which a posterior speaks for a change of the ground."""


State = dict[str, Tensor]
"""All that the model remembers, of constant size but for the n < 10 observations of the open block:

- ``mean`` [H, D], ``precision`` [H, D, D], ``log_weight`` [H]: the bank at the start of the open block
- ``block`` [n, 8 A + 9]: packed observations
- ``weight`` [H]: of each posterior in the mixture; what it puts on negative c or tan phi does not count
- ``age`` [H]: blocks since each was born from the prior; those of the start are older than any
- ``kind`` [H]: index of the soil whose constants, plus its own deviations, each has; K more where the net has a say
- ``prior`` [3, 2]: mean, deviation, and random walk [1/sqrt(s)] of (c [kPa], tan phi), the user's or the model's
- ``log_soils`` [K]: log prior probability of each soil, -inf where the user excludes it
- ``moments`` [3, 2]: mean and covariance of (c [kPa], tan phi) in the mixture over everything
- ``soils`` [K]: probability of each soil
- ``expansion`` [K, 2 + M]: mean c [kPa], tan phi and deviations of the constants, given each soil; of one without any, the prior's
- ``expected`` [D], ``covariance`` [D, D]: of the mixture within the most probable soil, which predicts the velocity
- ``constants`` [6], ``varied`` [C, 6]: of that soil, as in Contact
- ``velocity`` [2]: mean [m/s] and variance, now
- ``drive`` [3]: last acceleration [m/s^2], variance of the noise of its features, mean square change a step
- ``innovation`` [2]: measured minus predicted velocity, and its variance; NaN where there was none
- ``misfit`` [2]: squared Mahalanobis distance of the last block, and its degrees of freedom; NaN where there was none
- ``report`` [8 + A]: what a caller reads after each observation: the forecast one step ahead [2], ``innovation`` [2],
  ``misfit`` [2], 1 where a block was closed, the probability that the ground changed within the last RECENT blocks,
  and 1 for each axle that is measured and in the model's range
"""


class PAlpaca(nn.Module):
    """The model behind ``initial``, ``update`` and ``predict`` on a state of tensors.

    Scripted and saved, it needs nothing but torch. All tensors are float64; an observation is the flat tensor of
    ``terrain_estimator.packing``. Nothing raises on numbers: a caller checks that the state is finite and keeps the one
    of before where it is not.
    """

    offsets: Tensor
    offset_log_weight: Tensor
    offset_spread: Tensor
    born_offsets: Tensor
    born_spread: Tensor
    born_log_weight: Tensor
    other_precision: Tensor
    stand_in: Tensor
    uncertain: Tensor
    varied: Tensor
    constants: Tensor
    nodes: Tensor
    prior_mean: Tensor
    prior_sd: Tensor
    net_precision: Tensor
    net_log_weight: Tensor
    body_scale: Tensor
    axle_x: Tensor
    centre: Tensor
    pivot: Tensor
    fixed_columns: Tensor
    every_row: Tensor
    longest_step: Tensor
    unit: Tensor
    column_unit: Tensor

    def __init__(self, body: Body, constants: Tensor, prior: Prior, net: NetFeatures) -> None:
        """``constants`` [K, 6] are those of the K soils that the model knows, as in terramechanics.contact.CONSTANTS.

        Where ``prior.constants_sd`` is above 0 each of them is a parameter of the posterior, in prior deviations.
        """
        super().__init__()
        self.axles, self.gravity, self.radius, self.width = body.axles, body.gravity, body.radius_m, body.width_m
        uncertain = uncertain_constants(constants, prior.constants_sd, body.width_m)
        self.known_soils, self.first_constant = constants.shape[0], 2 + net.columns
        self.kept = KEPT
        self.size = self.first_constant + uncertain.shape[1] + KEPT
        self.open_precision, self.link_variance, self.block_size, self.step_s = OPEN, LINK_VARIANCE, BLOCK, TIME_STEP
        self.bank, self.negligible, self.nearest, self.no_say = 2 * self.known_soils * BANK, NEGLIGIBLE, NEAREST, NO_SAY
        self.surprise, self.recent = SURPRISE, RECENT
        self.observation_size, self.moment_variance = packed_size(body.axles), MOMENT_VARIANCE
        self.net = net
        prior_mean = [prior.cohesion_pa, prior.tan_phi]
        prior_sd = [prior.cohesion_sd_pa, prior.tan_phi_sd]
        by_mass, by_weight = body.wheels_per_axle / body.mass_kg, body.wheels_per_axle / (body.mass_kg * body.gravity)
        wheelbase = float(body.geometry.axle_x[0] - body.geometry.axle_x[-1])
        by_moment = by_weight / wheelbase
        # Buffers, not literals in the methods: TorchScript rounds the numbers of torch.tensor([...]) to float32.
        place, weight = torch.tensor([-1.2, 0.0, 1.2], dtype=torch.float64), torch.tensor([0.2, 0.6, 0.2], dtype=torch.float64)
        self.register_buffer("offsets", torch.cartesian_prod(place, place))
        self.register_buffer("offset_log_weight", torch.cartesian_prod(weight, weight).log().sum(1))
        # with this spread, mean and variance of the mixture are exactly those of the prior
        self.register_buffer("offset_spread", (1.0 - (weight * place**2).sum()).sqrt())
        corner = torch.tensor([-0.8, 0.8], dtype=torch.float64)
        self.register_buffer("born_offsets", torch.cartesian_prod(corner, corner))
        self.register_buffer("born_spread", torch.tensor(0.6, dtype=torch.float64))  # likewise
        self.register_buffer("born_log_weight", torch.tensor(HAZARD / 4.0, dtype=torch.float64).log())
        other = [1.0] * uncertain.shape[1] + [prior.mass_sd**-2, prior.centre_of_mass_sd**-2, prior.acceleration_bias_sd**-2, OPEN]
        self.register_buffer("other_precision", torch.tensor(other, dtype=torch.float64))
        self.register_buffer("uncertain", uncertain)
        self.register_buffer("varied", torch.cat([torch.zeros_like(constants).unsqueeze(1), 1e-3 * uncertain], 1))
        wheel = [0.1, 0.01, 0.01 * body.radius_m, 1e-3 * body.radius_m, 0.0, 0.0, 0.0, 0.0]
        self.register_buffer("stand_in", torch.tensor(wheel, dtype=torch.float64).unsqueeze(1))
        self.register_buffer("constants", constants)
        self.register_buffer("nodes", quadrature())
        self.register_buffer("prior_mean", torch.tensor(prior_mean, dtype=torch.float64))
        self.register_buffer("prior_sd", torch.tensor(prior_sd, dtype=torch.float64))
        self.register_buffer("net_precision", torch.ones(net.columns, dtype=torch.float64))
        # log prior probability that the plant is as the physics say, and that the net has a say
        self.register_buffer("net_log_weight", torch.tensor([1.0 - WITH_NET, WITH_NET], dtype=torch.float64).log())
        self.register_buffer("body_scale", torch.tensor([by_mass, by_weight, by_moment, by_moment], dtype=torch.float64))
        self.register_buffer("axle_x", body.geometry.axle_x)
        self.register_buffer("centre", body.geometry.centre)
        self.register_buffer("pivot", body.geometry.pivot)
        self.register_buffer("fixed_columns", fixed_columns(body.axles, wheelbase))
        self.register_buffer("every_row", torch.ones(len(row_names(body.axles)), dtype=torch.float64))
        self.register_buffer("longest_step", torch.tensor([1.0, 0.25], dtype=torch.float64))
        self.register_buffer("unit", torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64))
        self.register_buffer("column_unit", torch.tensor([PA_PER_UNIT, 1.0, 1.0], dtype=torch.float64))

    def forward(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """The same as ``update``."""
        return self.update(state, observation)

    @torch.jit.export
    def initial(self) -> dict[str, Tensor]:
        """The state before the first observation, with the model's own prior, on ground whose strength does not drift."""
        soils = torch.full((self.known_soils,), 1.0 / self.known_soils, dtype=torch.float64)
        return self.initial_with_prior(self.prior_mean, self.prior_sd, soils, 0.0)

    @torch.jit.export
    def initial_with_prior(self, mean: Tensor, sd: Tensor, soils: Tensor, drift: float) -> dict[str, Tensor]:
        """The same with a user's prior: ``mean`` [2] and ``sd`` [2] of (c [Pa], tan phi), and the probability [K] of each soil.

        ``drift`` [1/sqrt(s)] is the random walk of c and tan phi, in prior deviations: what was known of them is forgotten so fast.
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
            "drive": torch.zeros(3, dtype=torch.float64),
            "innovation": nothing,
            "misfit": nothing,
            "prior": prior,
            "log_soils": torch.log(soils),
            "report": torch.cat([nothing, nothing, nothing, torch.zeros(2 + self.axles, dtype=torch.float64)]),
        }
        age = torch.full((start.shape[0],), 1e9, dtype=torch.float64)
        bank = weigh(Posterior(start, precision, age), age, kind)
        # so that the mixture is exactly the prior, whatever it puts on negative c or tan phi
        weight = (self.net_log_weight.view(2, 1, 1) + state["log_soils"].unsqueeze(1) + self.offset_log_weight).flatten()
        return self.commit(state, Bank(bank.mean, bank.covariance, bank.precision, weight, age, kind))

    @torch.jit.export
    def update(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """Take one packed observation [8 A + 9] into the state; every tenth closes a block and moves the posterior."""
        measured = observation[8 * self.axles :]
        wheels = observation[: 8 * self.axles].view(1, 8, self.axles)
        usable = usable_wheels(wheels, self.leading(state))[0]
        if self.known_soils > 1:
            usable = usable & self.in_every_range(wheels)[0]
        linked = bool((measured[-1] > 0.0) & (state["velocity"][1] * self.open_precision < 0.5) & usable.all())
        closes = state["block"].shape[0] > 0 and not linked
        if linked:
            state = self.track(state, observation)
        else:
            state = self.unlink(self.close(state) if closes else state, measured[0], measured[1] ** 2)
            slip = torch.where(usable, wheels[0, 0], float("nan"))  # every soil has to explain the same rows
            observation = torch.cat([slip, observation[self.axles : -2], torch.zeros_like(observation[:2])])  # it covers no time
        state["block"] = torch.cat([state["block"], observation.unsqueeze(0)])
        if state["block"].shape[0] == self.block_size:
            closes = True
            state = self.close(state)
        closed = torch.full((1,), 1.0 if closes else 0.0, dtype=torch.float64)
        changed = (state["weight"] * (state["age"] <= self.recent)).sum().unsqueeze(0)
        ahead = self.forecast(state, self.step_s)
        state["report"] = torch.cat([ahead, state["innovation"], state["misfit"], closed, changed, usable.to(torch.float64)])
        return state

    @torch.jit.export
    def discard(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Drop the open block: the posterior stays as it was before it, the velocity is opened."""
        state = self.unlink(state, state["velocity"][0], 1.0 / self.other_precision[-1])
        state["block"] = state["block"][:0]
        return state

    @torch.jit.export
    def predict(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """Posterior predictive of the velocity that ``observation`` measures: mean [m/s] and variance, shape [2]."""
        predicted = self.foresee(state, observation)
        return torch.stack([predicted[0], predicted[1] + observation[8 * self.axles + 1] ** 2])

    @torch.jit.export
    def forecast(self, state: dict[str, Tensor], horizon_s: float) -> Tensor:
        """The true velocity ``horizon_s`` after the last observation if slip persists: mean [m/s] and variance, shape [2]."""
        velocity, drive = state["velocity"], state["drive"]
        return torch.stack([velocity[0] + horizon_s * drive[0], velocity[1] + horizon_s**2 * (drive[1] + drive[2])])

    @torch.jit.export
    def estimate(self, state: dict[str, Tensor]) -> Tensor:
        """Marginal posterior of (c, tan phi) over every soil as [3, 2]: the mean [Pa, 1], then the rows of the covariance."""
        moments = state["moments"] * self.unit
        return torch.cat([moments[:1], moments[1:] * self.unit.unsqueeze(-1)])

    def contact(self, soil: int, deviations: Tensor) -> Contact:
        """The physics that the rows need, for the constants of a soil and their ``deviations`` [M] from the nominal ones."""
        return self.physics(self.constants[soil] + deviations @ self.uncertain[soil], self.varied[soil])

    def leading(self, state: dict[str, Tensor]) -> Contact:
        """The same for the most probable soil and its expected constants."""
        return self.physics(state["constants"], state["varied"])

    def physics(self, constants: Tensor, varied: Tensor) -> Contact:
        """The same for given constants."""
        return Contact(
            constants, varied, self.nodes, self.column_unit, Geometry(self.axle_x, self.centre, self.pivot, self.radius),
            self.body_scale, self.moment_variance, self.stand_in, self.gravity, self.radius, self.width,
        )  # fmt: skip

    def nominal_contact(self, soil: int = 0) -> Contact:
        """The same with the soil constants as given."""
        return self.physics(self.constants[soil], self.varied[soil])

    def in_every_range(self, wheels: Tensor) -> Tensor:
        """Wheels [n, A] of packed groups [n, 8, A] that are in the range of every soil with its nominal constants."""
        return in_range(wheels[:, 0], wheels[:, 2], self.constants.view(-1, 1, 1, 6), self.radius).all(0)

    def learnt(self, packed: Tensor) -> Tensor:
        """Net features [n, R, net] of packed observations [n, 8 A + 9]."""
        a = self.axles
        wheels = packed[:, : 8 * a].view(-1, 8, a)
        return self.net(wheels[:, 0], wheels[:, 2], wheels[:, 4], packed[:, 8 * a + 2 : 8 * a + 3])

    def foresee(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:
        """True velocity at ``observation``, from the velocity before and its force: mean, variance, acceleration [3]."""
        a, expected = self.axles, state["expected"]
        rows = drive_row(observation[: 8 * a].view(8, a), self.leading(state))
        by_constant = rows[1:] @ torch.cat([expected[:2], torch.ones_like(expected[:1])])
        direction = torch.cat([rows[0, :2], self.learnt(observation.unsqueeze(0))[0, 0], by_constant])
        known = direction.shape[0]
        explained = torch.dot(direction[: self.first_constant], expected[: self.first_constant]) + rows[0, 2]
        acceleration = explained - self.gravity * torch.sin(observation[8 * a + 2])
        step = observation[-2]
        spread = torch.dot(direction, torch.mv(state["covariance"][:known, :known], direction)) + state["drive"][1]
        velocity = state["velocity"]
        return torch.stack([velocity[0] + step * acceleration, velocity[1] + step**2 * spread, acceleration])

    def track(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        """Kalman step of the velocity."""
        mean, variance, acceleration = self.foresee(state, observation).unbind(0)
        noise = observation[8 * self.axles + 1] ** 2
        innovation, total = observation[8 * self.axles] - mean, variance + noise
        drive = state["drive"]
        change = 0.95 * drive[2] + 0.05 * (acceleration - drive[0]) ** 2
        state = state.copy()
        state["velocity"] = torch.stack([mean + variance / total * innovation, variance / total * noise])
        state["drive"] = torch.stack([acceleration, drive[1], change])
        state["innovation"] = torch.stack([innovation, total])
        return state

    def commit(self, state: dict[str, Tensor], bank: Bank) -> dict[str, Tensor]:
        """The state with another bank, and its mixtures: over everything, within each soil, within the most probable one."""
        weight = torch.softmax(bank.weight, 0)
        state = state.copy()
        state["mean"], state["precision"], state["weight"] = bank.mean, bank.precision, weight
        state["log_weight"] = torch.log_softmax(bank.weight, 0) - log_physical(bank.mean, bank.covariance)
        state["age"], state["kind"] = bank.age, bank.kind
        soil = bank.kind % self.known_soils
        mean, covariance = mixture(bank.weight, bank.mean[:, :2], bank.covariance[:, :2, :2])
        state["moments"] = torch.cat([mean.unsqueeze(0), covariance])
        index = torch.arange(self.known_soils)
        share = weight * (index.unsqueeze(1) == soil)  # [K, H]
        state["soils"] = share.sum(1)
        apart = torch.cat([bank.mean[:, :2], bank.mean[:, self.first_constant : self.size - self.kept]], 1)
        within_soil = (share @ apart) / state["soils"].clamp(min=1e-300).unsqueeze(1)
        nothing = torch.cat([state["prior"][0], torch.zeros_like(apart[0, 2:])])
        state["expansion"] = torch.where(state["soils"].unsqueeze(1) > 0.0, within_soil, nothing)
        leading = index == state["soils"].argmax()
        within = (leading.unsqueeze(1) & (index.unsqueeze(1) == soil)).any(0)
        state["expected"], state["covariance"] = mixture(torch.where(within, bank.weight, -float("inf")), bank.mean, bank.covariance)
        chosen = leading.to(torch.float64)
        uncertain = (chosen.view(-1, 1, 1) * self.uncertain).sum(0)
        state["constants"] = chosen @ self.constants + (chosen @ state["expansion"][:, 2:]) @ uncertain
        state["varied"] = (chosen.view(-1, 1, 1) * self.varied).sum(0)
        return state

    def close(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Solve the open block and commit it; of its two velocities the newest goes on."""
        packed = state["block"]
        state = self.wander(state, packed[:, -2].sum())
        seen: list[int] = []
        rows: list[BlockRows] = []
        noise: list[Tensor] = []
        pieces: list[Solved] = []
        for soil in range(self.known_soils):
            members = torch.nonzero((state["kind"] % self.known_soils == soil) & (state["log_weight"] != -float("inf"))).squeeze(1)
            if members.shape[0] > 0:
                averaged, by_theta = self.average(packed, soil, state["expansion"][soil], self.every_row)
                seen.append(soil)
                rows.append(averaged)
                noise.append(by_theta)
                before = Posterior(state["mean"][members], state["precision"][members], state["log_weight"][members])
                pieces.append(Solved(solve_block(before, averaged, self.longest_step), state["age"][members], state["kind"][members]))
        solved = pieces[0]
        for piece in pieces[1:]:
            solved = join(solved, piece)
        degrees = rows[0].present.sum() - 1.0
        if bool(self.surprised(solved.solution, degrees)):
            for soil in range(self.known_soils):
                if bool(state["log_soils"][soil] == -float("inf")):
                    continue
                if soil not in seen:
                    averaged, by_theta = self.average(packed, soil, state["expansion"][soil], self.every_row)
                    seen.append(soil)
                    rows.append(averaged)
                    noise.append(by_theta)
                born = self.born(state, soil)
                age = torch.zeros_like(born.log_weight)
                solution = solve_block(born, rows[seen.index(soil)], self.longest_step)
                solved = join(solved, Solved(solution, age, torch.full_like(age, soil, dtype=torch.long)))
        bank, misfit = self.survive(solved)
        alive = bank.weight != -float("inf")
        if bool(alive.any()):  # else the block held a number beyond all bounds, and what follows is NaN
            bank = take(bank, torch.nonzero(alive).squeeze(1))
        state = self.commit(state, bank)
        leading = int(state["soils"].argmax())
        state = self.steer(state, noise[seen.index(leading) if leading in seen else 0])
        state["misfit"] = torch.stack([misfit, degrees])
        state["block"] = packed[:0]
        return state

    def wander(self, state: dict[str, Tensor], seconds: Tensor) -> dict[str, Tensor]:
        """Let c and tan phi of every posterior drift for the time that a block covers."""
        variance = state["prior"][2] ** 2 * seconds
        if any_of(variance > 0.0):
            state = state.copy()
            state["precision"] = random_walk(state["precision"], variance)
        return state

    def average(self, packed: Tensor, soil: int, expansion: Tensor, chosen: Tensor) -> tuple[BlockRows, Tensor]:
        """Rows of a block on a soil, those ``chosen`` [R] (1 or 0), and the noise of its velocity rows [n, E, 3].

        ``expansion`` [2 + M] is (c [kPa], tan phi, deviations of the constants) for which they are evaluated.
        """
        contact, theta = self.contact(soil, expansion[2:]), torch.cat([expansion[:2], torch.ones_like(expansion[:1])])
        rows = regression_rows(packed, likely_inputs(packed, contact, theta, chosen), contact)
        rows = Rows(rows.features, rows.noise, rows.target, rows.variance, rows.used * chosen)
        measured = packed[:, 8 * self.axles :]
        velocity = torch.stack([measured[:, 0], measured[:, 1] ** 2], 1)
        columns = torch.where(rows.used[:, :1].unsqueeze(-1) > 0.0, self.learnt(packed), 0.0)  # needs every wheel
        step = measured[:, -2] * rows.used[:, 0]
        averaged = block_rows(rows, columns, step, velocity, expansion[2:], self.fixed_columns, self.link_variance)
        return averaged, rows.noise[0, :, 0]

    def surprised(self, solution: Solution, degrees: Tensor) -> Tensor:
        """Whether a block fits the posteriors worse than a share SURPRISE of honest blocks would."""
        misfit = torch.dot(torch.softmax(solution.posterior.log_weight, 0), solution.misfit)
        return torch.special.gammainc(0.5 * degrees, 0.5 * misfit.clamp(min=0.0)) > self.surprise

    def born(self, state: dict[str, Tensor], soil: int) -> Posterior:
        """Four posteriors for ground of one soil that has just changed, without the net: all but the rover's own parameters is prior."""
        prior, expected = state["prior"], state["expected"]
        count, others = self.born_offsets.shape[0], self.size - 2 - self.kept
        theta = prior[0] + self.born_offsets * prior[1]
        mean = torch.cat([theta, torch.zeros(count, others, dtype=torch.float64), expected[-self.kept :].expand(count, self.kept)], 1)
        eye = torch.eye(self.kept, dtype=torch.float64)
        kept = torch.cholesky_solve(eye, cholesky(state["covariance"][-self.kept :, -self.kept :]))
        theta_precision = (self.born_spread * prior[1]) ** -2.0
        silent = torch.full_like(self.net_precision, self.no_say)
        fresh = torch.cat([theta_precision, silent, self.other_precision[: -self.kept], torch.zeros_like(eye[0])])
        precision = torch.diag(fresh) + nn.functional.pad(kept, [self.size - self.kept, 0, self.size - self.kept, 0])
        precision = precision.expand(mean.shape[0], -1, -1)
        physical = log_physical(mean, torch.diag(1.0 / theta_precision).expand(count, -1, -1))
        return Posterior(mean, precision, self.born_log_weight + state["log_soils"][soil] - physical)

    def survive(self, solved: Solved) -> tuple[Bank, Tensor]:
        """The best of the solved posteriors without the velocity at the block's start, kin that met as one; and their misfit."""
        posterior = solved.solution.posterior
        mean, precision = drop(posterior.mean, posterior.precision, self.size - 1)
        bank = weigh(Posterior(mean, precision, posterior.log_weight - 0.5 * shared_noise(solved)), solved.age + 1.0, solved.kind)
        kept = torch.topk(bank.weight, min(self.bank, bank.weight.shape[0]))[1]
        bank = prune(take(bank, kept), self.negligible)
        misfit = torch.dot(torch.softmax(bank.weight, 0), solved.solution.misfit[kept])
        return merge(bank, self.nearest), misfit

    def steer(self, state: dict[str, Tensor], noise: Tensor) -> dict[str, Tensor]:
        """Let the velocity go on from the posterior; ``noise`` [n, E, 3] is that of the block's velocity rows."""
        expected = state["expected"]
        by_source = noise @ torch.cat([expected[:2], torch.ones_like(expected[:1])])
        state["velocity"] = torch.stack([expected[-1], state["covariance"][-1, -1]])
        state["drive"] = torch.stack([state["drive"][0], by_source.square().sum(1).mean(), state["drive"][2]])
        return state

    def unlink(self, state: dict[str, Tensor], velocity: Tensor, variance: Tensor) -> dict[str, Tensor]:
        """Open the velocity again: what was known of it says nothing about the one that ``velocity`` measures."""
        mean, precision = drop(state["mean"], state["precision"], self.size - 1)
        opened = nn.functional.pad(precision, [0, 1, 0, 1])
        opened[:, -1, -1] = self.open_precision
        state = state.copy()
        state["mean"] = torch.cat([mean, velocity.expand(mean.shape[0], 1)], 1)
        state["precision"] = opened
        # What is born takes its velocity from here.
        state["expected"] = torch.cat([state["expected"][:-1], velocity.unsqueeze(0)])
        state["covariance"] = nn.functional.pad(state["covariance"][:-1, :-1], [0, 1, 0, 1])
        state["covariance"][-1, -1] = 1.0 / self.open_precision
        state["velocity"] = torch.stack([velocity, variance])
        state["innovation"] = torch.full_like(state["innovation"], float("nan"))
        return state

# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The search for the physical effect that the nominal model lacks: named, sized, or unknown.

    nominal = nominal_of(rover, soil)
    # fits "nothing is missing"
    study = Study(nominal, [cut(run, nominal.contact) for run in runs])
    # each named effect, the most probable first
    candidates = search(study, foresee(study, singles(), progress), progress)
    # the rest beside the best one
    study.with_discrepancy(candidates[0])
    # all of it, and the verdict
    finding = investigate(study, singles(), thresholds, progress, soils_at_hand)
    # whether it helps on unseen runs
    proof = prove(nominal, finding.best, held_out)
    # the verdict with these runs counted
    finding = settled(finding, proof)
    # all of that in one, as the command does it
    answer = answered(study, Question(singles(), soils_at_hand, held_out), progress)
    # where it disagrees, which effects these runs separate, what to drive next
    diagnosis = diagnose(study, singles(), answer.asked, progress)

Each name stands in its module:

- ``runs``: a Run is the packed observations of one drive; Blocks are its seconds.
- ``library``: the registry's effects as hypotheses.
- ``rows``: the rows under a hypothesis, by the row building and the laws that models have.
- ``equations``: normal equations of one run; what one run contributes does not depend on the
  others.
- ``contributions``: their evaluation run by run, in this process or on workers.
- ``unknowns``: the unknowns of all runs and their priors.
- ``fit``: Gauss-Newton over all runs and the evidence of a hypothesis (Laplace).
- ``next_effect``: the equations with one more effect from those without it.
- ``flexible``: a discrepancy without a name.
- ``study``: runs and fits of one hypothesis to them. ``search``: fits of all that promise anything.
- ``other_soils``: runs on another soil of those at hand. ``common_constants``: a fit of soil
  constants that runs have in common; ``soil_revision``: a study on them.
- ``verdict``: the rule. ``finding``: the effects on given soils. ``investigation``: effects and
  soils, which compete.
- ``where``: rows against regions of signals (``regions``) on the innovations of a fit
  (``whitening``).
- ``isolability``: which effects the runs can separate, by expected log Bayes factors
  (``expected``).
- ``proof``: the model with the effect against the one without, on runs that neither has seen
  (``held_out``): each second from the one before (``one_step``), five seconds from the wheel rates
  alone (``rollout`` over the ``terrain``, as ``signals``). ``scores`` by row and region, the
  ``gap`` with its interval (``resampling``).
- ``answer``: search and proof, and the search again where a rover file may be off.
- ``next_drive``: which of some short drives (``manoeuvres``) would separate the effects in doubt
  best, and advice in words.
- ``separation``: manoeuvres by hand, for tables of one wheel.
- ``progress``: what a search reports to.

No files, no clock, no ROS. The generator of hidden effects in tests/hidden shares no module and no
number with it.
"""

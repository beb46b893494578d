"""Re-identification: a robot in doubt acts, until one hypothesis explains its readings.

Between actions the likeliest hypotheses are made finer: new values between old ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..body.body import Floats, Ints
from ..damage.apply import apply_damages
from ..damage.kinds import Damage
from ..engine.plant import Plant
from ..engine.walk import list_channels
from ..evolution.ranking import rank_best_first
from .belief import (
    CandidateAction,
    ResidualNoise,
    choose_action,
    compute_entropy,
    compute_log_likelihood,
    compute_posterior,
    score_outcomes,
    sum_over_groups,
    widen_scale,
)
from .hypotheses import compute_log_prior, group_damages, refine_damages
from .plausible_plants import PlausiblePlants, predict_walk
from .probes import (
    DRIFT,
    Probe,
    approximate_values,
    compute_slopes,
    extract_values,
    find_residual_scale,
    predict_values,
)

SURE = 0.95  # of one kind and target: enough to act on; chosen
MOST_ACTIONS = 12  # actions, however unsure; chosen
_FEWEST_ACTIONS = 2  # actions, however sure: the first may have been read badly; chosen
_SIZE_ACTIONS = 5  # actions by which a part's scale is measured; chosen
# [nats] that an action must be expected to tell, to be taken; chosen
_LEAST_GAIN = 0.05
_REFINEMENTS = 4  # rounds of finer values once the kind is known


@dataclass
class DamagePosterior:
    """What is believed of a robot that no longer behaves like its model.

    Attributes:
        plant: the robot as it was.
        probes: actions it may take.
        damages: H hypotheses.
        plausible: robots that walk as it did while it was whole.
        taken: measured values (M) by the index of each probe so far.
    """

    plant: Plant
    probes: list[Probe]
    damages: list[Damage]
    plausible: PlausiblePlants
    taken: dict[int, Floats] = field(default_factory=dict)
    _plants: list[Plant] = field(default_factory=list)
    _tables: dict[int, Floats] = field(default_factory=dict)
    _slopes: dict[int, Floats] = field(default_factory=dict)
    _approximations: dict[int, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Lay out the hypotheses' plants."""
        self._plants = [apply_damages(self.plant, d) for d in self.damages]
        self._names = list_channels(self.plant.body.anatomy).names
        self._scales = [
            widen_scale(
                find_residual_scale(p, self._names),
                compute_slopes([self.plant], p)[0],
                DRIFT,
            )
            for p in self.probes
        ]

    def compute_log_weights(self) -> Floats:
        """(H) belief, from the prior and all that was measured."""
        weight = compute_log_prior(self.damages)
        for k, measured in self.taken.items():
            if self._is_walk(k):
                shown = self._make_candidate(k, self._tables)
                weight = weight + score_outcomes(shown, measured)
        poses = [k for k in self.taken if not self._is_walk(k)]
        if not poses:
            return weight
        scale = [find_residual_scale(self.probes[k], self._names) for k in poses]
        return weight + compute_log_likelihood(
            np.concatenate([self._tables[k][:, 0] for k in poses], axis=1),
            np.concatenate([self._slopes[k] for k in poses], axis=1),
            np.concatenate([self.taken[k] for k in poses]),
            ResidualNoise(np.concatenate(scale), DRIFT),
        )

    def _is_walk(self, probe: int) -> bool:
        """Whether a probe is a walk."""
        return self.probes[probe].target is None

    def _make_candidate(self, probe: int, tables: dict[int, Floats]) -> CandidateAction:
        """What a probe would show."""
        worth = self.plausible.effective_share if self._is_walk(probe) else 1.0
        return CandidateAction(tables[probe], self._scales[probe], worth)

    def choose_probe(self, rng: np.random.Generator) -> tuple[int, float] | None:
        """The next probe's index, and the entropy expected after it [nats].

        None where no probe can be expected to tell more. Poses are predicted by
        `statics` for this, and the walk by MuJoCo once.
        """
        left = [k for k in range(len(self.probes)) if k not in self.taken]
        for k in left:
            self._extend_table(self._approximations, k, self._approximate)
        weight, group = self.compute_log_weights(), self._find_open_groups()
        candidates = [self._make_candidate(k, self._approximations) for k in left]
        best, expected = choose_action(candidates, weight, group, rng)
        now = compute_entropy(sum_over_groups(compute_posterior(weight), group))
        if len(self.taken) > _FEWEST_ACTIONS and now - expected < _LEAST_GAIN:
            return None
        return left[best], expected

    def _find_open_groups(self) -> Ints:
        """(H) groups to tell apart: kinds and targets, then values of the sure one."""
        _, group = group_damages(self.damages)
        chance = sum_over_groups(compute_posterior(self.compute_log_weights()), group)
        if chance.max() < SURE:
            return group
        return np.where(group == chance.argmax(), np.arange(len(group)), len(group))

    def _approximate(self, first: int, probe: Probe) -> Floats:
        """(H - first, K, M) what hypotheses from `first` on are guessed to show."""
        if probe.target is not None:
            return approximate_values(self._plants[first:], probe)[:, None]
        return self._predict(first, probe)

    def _predict(self, first: int, probe: Probe) -> Floats:
        """(H - first, K, M) what hypotheses from `first` on show; of a pose K is 1."""
        if probe.target is None:
            return predict_walk(self.plausible, self.damages[first:], probe)
        return predict_values(self._plants[first:], probe, np.zeros(1))[:, None]

    def _compute_slopes(self, first: int, probe: Probe) -> Floats:
        """(H - first, M, P + 1) see `slopes`."""
        return compute_slopes(self._plants[first:], probe)

    def _extend_table(
        self, tables: dict[int, Floats], k: int, how: Callable[[int, Probe], Floats]
    ) -> None:
        """Complete a table of a probe for hypotheses that are new."""
        old = tables.get(k)
        known = 0 if old is None else len(old)
        if known < len(self._plants):
            new = how(known, self.probes[k])
            tables[k] = new if old is None else np.concatenate([old, new])

    def observe(self, probe: int, sensed: Floats) -> None:
        """Record the channels (S, C) that a probe gave, and refine the hypotheses."""
        names = self._names
        self.record_values(probe, extract_values(self.probes[probe], sensed, names))

    def record_values(self, probe: int, measured: Floats) -> None:
        """Record values (M) of a probe, taken here or in an earlier process."""
        self.taken[probe] = measured
        if self._is_walk(probe) and probe in self._approximations:
            self._tables[probe] = self._approximations[probe]  # exact as it is
        self._extend_tables(probe)
        self._refine_hypotheses(3)

    def _extend_tables(self, probe: int) -> None:
        """Predict what a probe that was taken shows of hypotheses that are new."""
        self._extend_table(self._tables, probe, self._predict)
        self._extend_table(self._slopes, probe, self._compute_slopes)

    def refine_values(self) -> None:
        """Refine the values of the likeliest hypothesis until they are fine."""
        for _ in range(_REFINEMENTS):
            if not self._refine_hypotheses(1):
                return

    def _refine_hypotheses(self, count: int) -> bool:
        """Add hypotheses between the best ones; whether there were any."""
        new = refine_damages(self.damages, self.compute_log_weights(), count)
        self.damages += new
        self._plants += [apply_damages(self.plant, damage) for damage in new]
        for probe in self.taken:
            self._extend_tables(probe)
        return bool(new)

    def rank_damages(self) -> list[tuple[Damage, float]]:
        """The best hypothesis of each kind and target with its probability, in order.

        The probability is that of all values of this kind and target together.
        """
        weight = self.compute_log_weights()
        _, group = group_damages(self.damages)
        chance = sum_over_groups(compute_posterior(weight), group)
        best = []
        for g in rank_best_first(chance):
            members = np.flatnonzero(group == g)
            damage = self.damages[members[np.argmax(weight[members])]]
            best.append((damage, float(chance[g])))
        return best

    @property
    def is_done(self) -> bool:
        """Whether it is sure enough, or has acted enough."""
        if len(self.taken) < _FEWEST_ACTIONS:
            return False
        best, chance = self.rank_damages()[0]
        if chance >= SURE:  # how much is left of a part takes more to measure
            return best.kind != "part_scale" or len(self.taken) >= _SIZE_ACTIONS
        return len(self.taken) >= MOST_ACTIONS

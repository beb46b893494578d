"""Re-identification: a robot in doubt acts, until one hypothesis explains what it felt.

Between actions the likeliest hypotheses are made finer: new values between old ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..body.body import Floats, Ints
from ..body.damage import Damage
from ..engine.plant import Plant
from ..engine.walk import channels_of
from .belief import (
    Candidate,
    Noise,
    blurred,
    choose,
    entropy,
    explained,
    log_likelihood,
    of_groups,
    posterior,
)
from .hypotheses import finer, groups, log_prior
from .likely import Likely, predict_walk
from .probes import (
    DRIFT,
    Probe,
    guess,
    plants_of,
    predict,
    scale_of,
    slopes,
    values,
)

SURE = 0.95  # of one kind and target: enough to act on; chosen
MOST = 12  # actions, however unsure; chosen
_FEWEST = 2  # actions, however sure: the first may have been read badly; chosen
_SIZED = 5  # actions in which a part's scale is asked for; chosen
_WORTH = 0.05  # [nats] that an action must be expected to tell, to be taken; chosen
_POLISH = 4  # rounds of finer values once the kind is known


@dataclass(frozen=True)
class Told:
    """An action taken and what was felt.

    Attributes:
        probe: index into the probes.
        why: it in words.
        felt: (M) values.
    """

    probe: int
    why: str
    felt: Floats


@dataclass
class Doubt:
    """What is believed of a robot that no longer behaves like its model.

    Attributes:
        plant: the robot as it was.
        probes: actions it may take.
        damages: H hypotheses.
        likely: robots that walk as it did while it was whole.
        told: actions so far.
    """

    plant: Plant
    probes: list[Probe]
    damages: list[Damage]
    likely: Likely
    told: list[Told] = field(default_factory=list)
    _plants: list[Plant] = field(default_factory=list)
    _tables: dict[int, Floats] = field(default_factory=dict)
    _slopes: dict[int, Floats] = field(default_factory=dict)
    _guesses: dict[int, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Lay out the hypotheses' plants."""
        self._plants = plants_of(self.plant, self.damages)
        self._names = channels_of(self.plant.body.anatomy).names
        self._blurs = [
            blurred(scale_of(p, self._names), slopes([self.plant], p)[0], DRIFT)
            for p in self.probes
        ]

    def log_weight(self) -> Floats:
        """(H) belief, from the prior and all that was felt."""
        weight = log_prior(self.damages)
        poses = [t for t in self.told if not self._is_walk(t.probe)]
        for told in self.told:
            if self._is_walk(told.probe):
                shown = self._candidate(told.probe, self._tables)
                weight = weight + explained(shown, told.felt)
        if not poses:
            return weight
        tried = [t.probe for t in poses]
        scale = [scale_of(self.probes[k], self._names) for k in tried]
        return weight + log_likelihood(
            np.concatenate([self._tables[k][:, 0] for k in tried], axis=1),
            np.concatenate([self._slopes[k] for k in tried], axis=1),
            np.concatenate([t.felt for t in poses]),
            Noise(np.concatenate(scale), DRIFT),
        )

    def _is_walk(self, probe: int) -> bool:
        """Whether a probe is a walk."""
        return self.probes[probe].target is None

    def _candidate(self, probe: int, tables: dict[int, Floats]) -> Candidate:
        """What a probe would show."""
        worth = self.likely.worth if self._is_walk(probe) else 1.0
        return Candidate(tables[probe], self._blurs[probe], worth)

    def choose(self, rng: np.random.Generator) -> tuple[int, float] | None:
        """The next probe's index, and the entropy expected after it [nats].

        None where no probe can be expected to tell more. Poses are predicted by
        `statics` for this, and the walk by MuJoCo once.
        """
        left = [k for k in range(len(self.probes))
                if k not in [t.probe for t in self.told]]  # fmt: skip
        for k in left:
            self._extend(self._guesses, k, self._quick)
        weight, group = self.log_weight(), self._open()
        candidates = [self._candidate(k, self._guesses) for k in left]
        best, expected = choose(candidates, weight, group, rng)
        now = entropy(of_groups(posterior(weight), group))
        if len(self.told) > _FEWEST and now - expected < _WORTH:
            return None
        return left[best], expected

    def _open(self) -> Ints:
        """(H) groups to tell apart: kinds and targets, then values of the sure one."""
        _, group = groups(self.damages)
        chance = of_groups(posterior(self.log_weight()), group)
        if chance.max() < SURE:
            return group
        return np.where(group == chance.argmax(), np.arange(len(group)), len(group))

    def _unsized(self) -> bool:
        """Whether it is a part's scale, and how much is not asked enough yet."""
        kind = self.verdict()[0][0].kind
        return kind == "part_scale" and len(self.told) < _SIZED

    def _quick(self, first: int, probe: Probe) -> Floats:
        """(H - first, K, M) what hypotheses from `first` on are guessed to show."""
        if probe.target is not None:
            return guess(self._plants[first:], probe)[:, None]
        return self._exact(first, probe)

    def _exact(self, first: int, probe: Probe) -> Floats:
        """(H - first, K, M) what hypotheses from `first` on show; of a pose K is 1."""
        if probe.target is None:
            return predict_walk(self.likely, self.damages[first:], probe)
        return predict(self._plants[first:], probe, np.zeros(1))[:, None]

    def _slope(self, first: int, probe: Probe) -> Floats:
        """(H - first, M, P + 1) see `slopes`."""
        return slopes(self._plants[first:], probe)

    def _extend(
        self, tables: dict[int, Floats], k: int, how: Callable[[int, Probe], Floats]
    ) -> None:
        """Complete a table of a probe for hypotheses that are new."""
        old = tables.get(k)
        known = 0 if old is None else len(old)
        if known < len(self._plants):
            new = how(known, self.probes[k])
            tables[k] = new if old is None else np.concatenate([old, new])

    def observe(self, probe: int, why: str, sensed: Floats) -> None:
        """Take note of a probe's channels (S, C), then refine the hypotheses."""
        felt = values(self.probes[probe], sensed, self._names)
        self.recall(Told(probe, why, felt))

    def recall(self, told: Told) -> None:
        """Take note of an action that was taken, here or in an earlier process."""
        self.told.append(told)
        if self.probes[told.probe].target is None and told.probe in self._guesses:
            self._tables[told.probe] = self._guesses[told.probe]  # exact as it is
        self._extend(self._tables, told.probe, self._exact)
        self._extend(self._slopes, told.probe, self._slope)
        self._refine(3)

    def polish(self) -> None:
        """Refine the values of the likeliest hypothesis until they are fine."""
        for _ in range(_POLISH):
            if not self._refine(1):
                return

    def _refine(self, count: int) -> bool:
        """Add hypotheses between the best ones; whether there were any."""
        new = finer(self.damages, self.log_weight(), count)
        self.damages += new
        self._plants += plants_of(self.plant, new)
        for told in self.told:
            self._extend(self._tables, told.probe, self._exact)
            self._extend(self._slopes, told.probe, self._slope)
        return bool(new)

    def verdict(self) -> list[tuple[Damage, float]]:
        """The best hypothesis of each kind and target with its probability, in order.

        The probability is that of all values of this kind and target together.
        """
        weight = self.log_weight()
        names, group = groups(self.damages)
        chance = of_groups(posterior(weight), group)
        best = []
        for g in np.argsort(-chance, kind="stable"):
            members = np.flatnonzero(group == g)
            damage = self.damages[members[np.argmax(weight[members])]]
            best.append((damage, float(chance[g])))
        return best

    @property
    def done(self) -> bool:
        """Whether it is sure enough, or has asked enough."""
        if len(self.told) < _FEWEST:
            return False
        if self.verdict()[0][1] >= SURE:
            return not self._unsized()
        return len(self.told) >= MOST

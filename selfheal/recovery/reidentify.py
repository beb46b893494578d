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
from .belief import Noise, choose, entropy, log_likelihood, of_groups, posterior
from .hypotheses import finer, groups, log_prior
from .probes import (
    DRIFT,
    Probe,
    guess,
    plants_of,
    predict,
    scale_of,
    slopes,
    values,
    walk_bias,
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
        whole: (S, C) channels of a walk while the robot was whole.
        told: actions so far.
    """

    plant: Plant
    probes: list[Probe]
    damages: list[Damage]
    whole: Floats
    told: list[Told] = field(default_factory=list)
    _plants: list[Plant] = field(default_factory=list)
    _tables: dict[int, Floats] = field(default_factory=dict)
    _slopes: dict[int, Floats] = field(default_factory=dict)
    _guesses: dict[int, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Lay out the hypotheses' plants."""
        self._plants = plants_of(self.plant, self.damages)
        self._names = channels_of(self.plant.body.anatomy).names
        walk = next(p for p in self.probes if p.target is None)
        self._bias = walk_bias(self.plant, walk, self.whole)

    def log_weight(self) -> Floats:
        """(H) belief, from the prior and all that was felt."""
        prior = log_prior(self.damages)
        if not self.told:
            return prior
        tried = [t.probe for t in self.told]
        scale = [scale_of(self.probes[k], self._names) for k in tried]
        fit = log_likelihood(
            np.concatenate([self._tables[k] for k in tried], axis=1),
            np.concatenate([self._slopes[k] for k in tried], axis=1),
            np.concatenate([t.felt for t in self.told]),
            Noise(np.concatenate(scale), DRIFT),
        )
        return prior + fit

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
        scales = [scale_of(self.probes[k], self._names) for k in left]
        tables = [self._guesses[k] for k in left]
        best, expected = choose(tables, scales, weight, group, rng)
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

    def _quick(self, plants: list[Plant], probe: Probe) -> Floats:
        """(H, M) what plants are guessed to show."""
        if probe.target is not None:
            return guess(plants, probe)
        return self._exact(plants, probe)

    def _exact(self, plants: list[Plant], probe: Probe) -> Floats:
        """(H, M) what plants show."""
        bias = self._bias if probe.target is None else np.zeros(1)
        return predict(plants, probe, bias)

    def _extend(
        self,
        tables: dict[int, Floats],
        k: int,
        how: Callable[[list[Plant], Probe], Floats],
    ) -> None:
        """Complete a table of a probe for hypotheses that are new."""
        old = tables.get(k)
        known = 0 if old is None else len(old)
        if known < len(self._plants):
            new = how(self._plants[known:], self.probes[k])
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
        self._extend(self._slopes, told.probe, slopes)
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
            self._extend(self._slopes, told.probe, slopes)
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

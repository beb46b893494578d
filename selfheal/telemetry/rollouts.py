"""Short simulations: a mend of the columns in, how far they miss what came next out.

A robot in lasting contact has no balance of torques. There the model is started from
what the log says, and runs for a tenth of a second with the commands of the log. Its
change of velocity is compared with what was read. Missing physics makes that worse,
but not worse than no prediction at all, as a wrong sign or order does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..recording import list_controls
from ..recording.data import Floats
from .balance import ANEW, MIN_BLOCKS
from .states import Mend, States

if TYPE_CHECKING:
    import mujoco

HORIZON = 0.1  # [s] of a simulation; chosen: a servo answers, and errors stay small
MAX_STARTS = 200  # of simulations; chosen: a second of work for a quadruped
MAX_MISS = 100.0  # of one simulation, in mean square changes; chosen: it diverged
MAX_STEPS = 100  # of a simulation; chosen: as before


@dataclass(frozen=True, eq=False)
class Misses:
    """What simulations that start from a mended log miss.

    Attributes:
        share: (G) mean square miss over that of the change, of each group [1].
        blocks: (B, G) the same of each block.
    """

    share: Floats
    blocks: Floats

    @property
    def worst(self) -> float:
        """The largest share missed."""
        return float(self.share.max(initial=0.0))

    def select_changed(self, other: "Misses") -> Floats:
        """Shares missed (n), of what `other` misses differently [1]."""
        return self.share[np.abs(np.log(self.share / other.share)) > ANEW]

    def gain_over(self, other: "Misses") -> tuple[float, float]:
        """Nats by which this misses less in all, and how likely by chance.

        Args:
            other: the misses of another mend.

        Returns:
            The gain, and the p-value of a one-sided Wilcoxon signed-rank test over
            the blocks (Wilcoxon 1945).
        """
        from scipy.stats import wilcoxon

        each = (other.blocks - self.blocks).sum(axis=1)
        gain = float(np.sum(np.log(other.share / self.share)) / 2)
        if len(each) < MIN_BLOCKS or not np.any(each):
            return gain, 1.0
        return gain, float(wilcoxon(each, alternative="greater").pvalue)


class Rollouts:
    """Simulations from the same starts for every mend.

    Attributes:
        reason: why there are none; "" where there are.
        known: what was evaluated already.
        groups: names of what moves together: joints, and "BODY place", "BODY turn".
    """

    def __init__(self, model: "mujoco.MjModel", states: States) -> None:
        """Choose the starts.

        Args:
            model: of the robot.
            states: of the recording.
        """
        import copy

        self.model, self.states, series = copy.copy(model), states, states.series
        self.reason, self.known = states.reason, dict[str, Misses]()
        self.ahead = max(1, round(HORIZON / series.step))
        if self.reason:
            return
        known = states.find_known()
        both = known[: -self.ahead] & known[self.ahead :]
        both &= series.episode[: -self.ahead] == series.episode[self.ahead :]
        rows = np.flatnonzero(both)
        if len(rows) > MAX_STARTS:
            rows = rows[np.linspace(0, len(rows) - 1, MAX_STARTS).astype(int)]
        self.rows = rows
        blocks = np.unique(series.block[rows])
        if len(blocks) < MIN_BLOCKS:
            self.reason = f"{len(blocks)} blocks of about 1 s have all positions"
            return
        self.block = np.searchsorted(blocks, series.block[rows])
        self.groups, self.dofs = self._list_groups()

    def _list_groups(self) -> tuple[list[str], list[Sequence[int]]]:
        m = self.model
        names, dofs = [], list[Sequence[int]]()
        for j in self.states.joints.values():
            names.append(j.name)
            dofs.append([int(m.jnt_dofadr[j.number])])
        for base in self.states.bases:
            body, first = m.body(m.jnt_bodyid[base]).name, int(m.jnt_dofadr[base])
            names += name_groups(body)
            dofs += [range(first, first + 3), range(first + 3, first + 6)]
        return names, dofs

    def evaluate(self, mend: Mend, every: int = 1) -> Misses:
        """What simulations from a mended log miss, of each so many starts."""
        key = repr((mend, every))
        if key not in self.known:
            self.known[key] = self._evaluate(mend, every)
        return self.known[key]

    def _evaluate(self, mend: Mend, every: int) -> Misses:
        rows, block = self.rows[::every], self.block[::every]
        start = self.states.compute(mend, rows)
        end = self.states.compute(mend, rows + self.ahead)[1]
        missed = self._simulate(mend, rows, *start[:2]) - end
        change = end - start[1]
        count = int(self.block.max()) + 1
        share = np.empty(len(self.dofs))
        blocks = np.empty((count, len(self.dofs)))
        number = np.maximum(np.bincount(block, minlength=count), 1)
        for g, dofs in enumerate(self.dofs):
            size = float(np.mean((change[:, dofs] ** 2).sum(axis=1))) + 1e-12
            miss = np.minimum((missed[:, dofs] ** 2).sum(axis=1) / size, MAX_MISS)
            share[g] = max(float(np.mean(miss)), 1e-6)
            blocks[:, g] = np.bincount(block, miss, minlength=count) / number
        return Misses(share, blocks)

    def _simulate(self, mend: Mend, rows: np.ndarray, q: Floats, v: Floats) -> Floats:
        """Velocities (n, nv) a horizon later.

        Args:
            mend: of the columns.
            rows: (n) of the series, where it starts.
            q: (n, nq) positions there.
            v: (n, nv) velocities there.
        """
        import mujoco

        m, series = self.model, self.states.series
        seconds = self.ahead * series.step
        steps = min(max(1, round(seconds / m.opt.timestep)), MAX_STEPS)
        controls = list_controls(m)
        ctrl = np.zeros((self.ahead + 1, len(rows), m.nu))
        for k, control in enumerate(controls):
            name = control.full_name
            source, factor = mend.commands.get(name, (name, 1.0))
            for a in range(self.ahead + 1):
                ctrl[a, :, k] = series.ctrl[source][rows + a, 0] * factor
        data: Any = mujoco.MjData(m)
        out = np.zeros((len(rows), m.nv))
        given = m.opt.timestep
        m.opt.timestep = seconds / steps
        for i in range(len(rows)):
            mujoco.mj_resetData(m, data)
            data.qpos[:], data.qvel[:] = q[i], v[i]
            for s in range(steps):
                data.ctrl[:] = np.nan_to_num(ctrl[s * self.ahead // steps, i])
                if s == 0 and m.na:
                    self._begin(data)
                mujoco.mj_step(m, data)
            out[i] = data.qvel
        m.opt.timestep = given
        return out

    def _begin(self, data: Any) -> None:
        """Activations that have followed their commands."""
        m = self.model
        for a in np.flatnonzero((m.actuator_actadr >= 0) & (m.actuator_ctrlnum == 1)):
            data.act[m.actuator_actadr[a]] = data.ctrl[m.actuator_ctrladr[a]]


def name_groups(body: str) -> tuple[str, str]:
    """Names of the groups of a free body's place and turn."""
    return f"{body} place", f"{body} turn"

"""Short simulations: a map of the columns in, how far they miss what came next out.

A robot in lasting contact has no balance of torques. There the model is started from
what the log says, and runs for a tenth of a second with the commands of the log. Its
change of velocity is compared with what was read. Missing physics makes that worse,
but not worse than no prediction at all, as a wrong sign or order does.
"""

import copy

import numpy as np

from ..recording.data import Floats
from .balance import settle_activations
from .residuals import MIN_BLOCKS, Explainer, Residuals, average_blocks
from .states import ColumnMap, States

HORIZON = 0.1  # [s] of a simulation; chosen: a servo answers, and errors stay small
MAX_STARTS = 200  # of simulations; chosen: a second of work for a quadruped
MAX_MISS = 100.0  # of one simulation, in mean square changes; chosen: it diverged
MAX_STEPS = 100  # of a simulation; chosen: as before


class Rollouts(Explainer):
    """Simulations from the same starts for every map of the columns.

    Attributes:
        groups: degrees of freedom of what moves together, by its name: joints, and
            "BODY place", "BODY turn".
    """

    limits = 1.0, 0.5  # chosen: a log that is right misses less than no prediction
    says = "simulations are right"
    basis = (
        "Wilcoxon's signed-rank test of simulations of a tenth of a second, block by "
        "block, times the number of hypotheses tried"
    )

    def __init__(self, states: States) -> None:
        """Choose the starts."""
        super().__init__(states)
        self.ahead = max(1, self.series.count_rows(HORIZON))
        if self.reason:
            return
        known, episode = states.find_known(), self.series.episode
        known[: -self.ahead] &= known[self.ahead :]
        known[: -self.ahead] &= episode[: -self.ahead] == episode[self.ahead :]
        known[-self.ahead :] = False
        self.choose(known, MAX_STARTS)
        if self.count < MIN_BLOCKS:
            self.reason = f"{self.count} blocks of about 1 s have all positions"
            return
        address = self.model.jnt_dofadr
        self.groups = {j.name: [int(address[j.number])] for j in states.joints.values()}
        for base, body in states.bases.items():
            first = int(address[base])
            place, turn = name_groups(body)
            self.groups[place] = [*range(first, first + 3)]
            self.groups[turn] = [*range(first + 3, first + 6)]

    def _evaluate(self, column_map: ColumnMap, chosen: slice) -> Residuals:
        rows, block = self.rows[chosen], self.block[chosen]
        q, v, _ = self.states.compute(column_map, rows)
        end = self.states.compute(column_map, rows + self.ahead)[1]
        missed = self._simulate(column_map, rows, q, v) - end
        change = end - v
        shares, blocks = [], []
        for dofs in self.groups.values():
            size = float(np.mean((change[:, dofs] ** 2).sum(axis=1))) + 1e-12
            miss = np.minimum((missed[:, dofs] ** 2).sum(axis=1) / size, MAX_MISS)
            shares.append(max(float(np.mean(miss)), 1e-6))
            blocks.append(average_blocks(miss, block, self.count))
        share = np.array(shares)
        ones = np.ones_like(share)
        return Residuals(share, share, np.stack(blocks, axis=1), ones, ones)

    def _simulate(
        self, column_map: ColumnMap, rows: np.ndarray, q: Floats, v: Floats
    ) -> Floats:
        """Velocities (n, nv) a horizon later than positions q and velocities v."""
        import mujoco

        m = copy.copy(self.model)
        seconds = self.ahead * self.states.series.step
        steps = min(max(1, round(seconds / m.opt.timestep)), MAX_STEPS)
        m.opt.timestep = seconds / steps
        ctrl = np.nan_to_num(
            [
                self.states.compute_commands(column_map, rows + k)[..., 0]
                for k in range(self.ahead + 1)
            ]
        )
        data, out = mujoco.MjData(m), np.zeros((len(rows), m.nv))
        for i in range(len(rows)):
            mujoco.mj_resetData(m, data)
            data.qpos[:], data.qvel[:] = q[i], v[i]
            for s in range(steps):
                data.ctrl[:] = ctrl[s * self.ahead // steps, i]
                if s == 0:
                    settle_activations(m, data)
                mujoco.mj_step(m, data)
            out[i] = data.qvel
        return out


def name_groups(body: str) -> tuple[str, str]:
    """Names of the groups of a free body's place and turn."""
    return f"{body} place", f"{body} turn"

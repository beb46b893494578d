"""The balance of torques: a map of the columns in, what it leaves unexplained out.

Inverse dynamics gives the torque that each joint's motion takes; the actuators give it
by the model, and missing physics the rest. What these cannot stand for is a wrong sign,
unit or order of the columns.
"""

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..logs.model_facts import find_force_range
from ..recording import find_joint
from ..recording.data import Floats
from .contacts import collide
from .joints import follows_command
from .residuals import MIN_BLOCKS, Explainer, Residuals, average_blocks
from .states import ColumnMap, States
from .terms import Terms, make_terms

if TYPE_CHECKING:
    import mujoco

# share of a joint's torques that is left where they balance; chosen: physics that a
# model lacks leaves a twelfth at most
BALANCED = 0.1
MAX_ROWS = 700  # that are evaluated; chosen: 20 ms for a seven-joint arm
# [m] at which geoms count as touching, and kernels around a contact that feel it;
# chosen: an error of a pose, and the width of a kernel
CONTACT_MARGIN, CONTACT_KERNELS = 0.005, 3.0
LATE = 0.01  # [s] by which commands are shifted for their derivative; chosen


class TorqueBalance(Explainer):
    """The balance of one recording: evaluates maps of the columns in the same rows.

    Attributes:
        free: the model without contacts, limits, friction and constraints.
        dofs: (D) degrees of freedom whose torques are all known.
        torques: of the log as it is, see `compute_torques`.
        terms: of the log as it is, of each of the D.
        stiffness: (nv) gravity's torque over how far a joint moves, of the log as it
            is. By it springs are bounded, the same ones for all maps: else a map
            that makes motions small allows a stiffer one [N m/rad or N/m].
    """

    limits = 0.015, BALANCED
    says = "torques are balanced"
    basis = (
        "Wilcoxon's signed-rank test of the balance of torques, block by block, times "
        "the number of hypotheses tried"
    )

    def __init__(self, states: States) -> None:
        """Choose the rows."""
        import mujoco

        super().__init__(states)
        self.free = copy.copy(self.model)
        for what in ("CONTACT", "LIMIT", "EQUALITY", "FRICTIONLOSS"):
            flag = getattr(mujoco.mjtDisableBit, f"mjDSBL_{what}")
            self.free.opt.disableflags |= int(flag)
        if not self.reason and self.model.neq and self.model.eq_active0.any():
            self.reason = (
                "the model has equality constraints, whose forces are not known"
            )
        if self.reason:
            return
        self.choose(self._find_known(), MAX_ROWS)
        if self.count < MIN_BLOCKS:
            self.reason = (
                f"all positions are known, away from contacts, in {self.count} blocks "
                f"of about 1 s; at least {MIN_BLOCKS} are needed"
            )
            return
        self.dofs = self._list_dofs()
        self.torques = self.compute_torques(ColumnMap(), self.rows)
        swing = np.sqrt(np.mean(self.torques["hold"] ** 2, axis=0))
        self.stiffness = swing / np.maximum(np.std(self.torques["q"], axis=0), 1e-6)
        self.terms = self._list_terms(self.torques)

    def _find_known(self) -> np.ndarray:
        """(N) whether all positions are known in a row, away from contacts."""
        known = self.states.find_known()
        collides = (self.model.geom_contype != 0) | (self.model.geom_conaffinity != 0)
        if collides.sum() > 1:
            known &= ~self._find_contacts(np.flatnonzero(known))
        return known

    def _find_contacts(self, rows: np.ndarray) -> np.ndarray:
        """(N) whether something touches in some rows (n) or near them."""
        from scipy.ndimage import maximum_filter1d

        model = copy.copy(self.model)
        model.geom_margin[:] = np.maximum(model.geom_margin, CONTACT_MARGIN)
        touches = np.zeros(len(self.series.episode))
        poses = self.states.compute(ColumnMap(), rows)[0]
        touches[rows] = [data.ncon > 0 for data in collide(model, poses)]
        wide = self.series.count_rows(CONTACT_KERNELS * self.series.kernel)
        return maximum_filter1d(touches, 2 * wide + 1, mode="constant") > 0

    def _list_dofs(self) -> np.ndarray:
        """Degrees of freedom whose actuators' forces can be computed."""
        import mujoco

        m, lost = self.model, np.zeros(self.model.nv, bool)
        data = mujoco.MjData(m)
        mujoco.mj_forward(m, data)
        for a in range(m.nactuator):
            if follows_command(m, a):
                continue
            for output in m.actuator_outadr[a] + range(m.actuator_outnum[a]):
                first = data.moment_rowadr[output]
                row = slice(first, first + data.moment_rownnz[output])
                lost[data.moment_colind[row][data.actuator_moment[row] != 0]] = True
        return np.flatnonzero(~lost)

    def _evaluate(self, column_map: ColumnMap, chosen: slice) -> Residuals:
        """What a map leaves, held out.

        The error is over the square of the map's factor: likelihoods of one column are
        compared in its own unit.
        """
        block = self.block[chosen]
        left, size = np.empty(len(self.dofs)), np.empty(len(self.dofs))
        blocks = np.empty((self.count, len(self.dofs)))
        torques = self.compute_torques(column_map, self.rows[chosen])
        for k, terms in enumerate(self._list_terms(torques)):
            rest = np.empty_like(terms.missing)
            for here, found in terms.fit_others(block % 2, True):
                rest[here] = terms.leave(found)[here]
            # an offset explains the mean of gravity's torque, whatever the columns say
            mean = float(np.mean(terms.size)) + 1e-18
            hold = float(np.mean(terms.parts["hold"]))
            size[k] = max(mean - hold**2, 1e-18)
            left[k] = np.mean(rest**2)
            blocks[:, k] = average_blocks(rest**2, block, self.count)
        for base in self.states.bases:
            first = self.model.jnt_dofadr[base]
            for three in (range(first, first + 3), range(first + 3, first + 6)):
                these = np.isin(self.dofs, three)
                if these.any():
                    size[these] = size[these].mean()
        share = np.maximum(left / size, 1e-12)
        unit = self._list_factors(column_map) ** 2
        error = share * size / unit
        return Residuals(share, error, blocks / unit, error, size)

    def measure_share(self, column_map: ColumnMap, joint: str) -> float | None:
        """Share of a joint's torques that a map leaves [1]; None where not known."""
        dof = self.model.jnt_dofadr[self.states.joints[joint].number]
        if self.reason or dof not in self.dofs:
            return None
        return float(self.evaluate(column_map).share[self.dofs == dof][0])

    def _list_terms(self, torques: Mapping[str, Floats]) -> list[Terms]:
        """Terms (D) of torques, as `compute_torques` has them."""
        made = []
        for d in map(int, self.dofs):
            own = {name: values[:, d] for name, values in torques.items()}
            damping, stiffness = self.model.dof_damping[d], self.stiffness[d]
            made.append(make_terms(d, own, damping, stiffness))
        return made

    def _list_factors(self, column_map: ColumnMap) -> Floats:
        """Factor (D) by which a map multiplies the column of a degree of freedom.

        A torque that is left over accelerates: the density of the column is that of the
        torque times its derivative, the inertia times this factor. The inertia is left
        out, for what a rotor adds to it, and the model lacks, is not known.
        """
        factor = np.ones(self.model.nv)
        for name, (_, by) in column_map.positions.items():
            factor[self.model.jnt_dofadr[self.states.joints[name].number]] = by
        return np.abs(factor[self.dofs])

    def compute_torques(
        self, column_map: ColumnMap, rows: np.ndarray
    ) -> dict[str, Floats]:
        """Torques (n, nv) that parts of the motion in rows (n) take or are given.

        "hold": at rest [N m or N]; "all": with velocities and accelerations; "own": of
        the joint's own inertia. "act": of the actuators; "late": how that changes as
        commands come later [N m/s]. "q", "v": of each degree of freedom [rad, rad/s].
        """
        import mujoco

        m, data = self.free, mujoco.MjData(self.free)
        q, v, a = self.states.compute(column_map, rows)
        commands = self.states.compute_commands(column_map, rows)
        ctrl, change = commands[..., 0], commands[..., 1]
        shape, inertia = (len(rows), m.nv), np.zeros((m.nv, m.nv))
        out = {k: np.zeros(shape) for k in ("hold", "all", "own", "act", "late")}
        for i in range(len(rows)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[i], 0.0, 0.0
            mujoco.mj_inverse(m, data)
            out["hold"][i] = data.qfrc_inverse
            data.qvel[:], data.qacc[:] = v[i], a[i]
            mujoco.mj_inverse(m, data)
            out["all"][i] = data.qfrc_inverse
            if m.nactuator:
                early = self._actuate(data, ctrl[i] - change[i] * LATE)
                out["act"][i] = self._actuate(data, ctrl[i])
                out["late"][i] = (early - out["act"][i]) / LATE
            mujoco.mj_fullM(m, data, inertia)
            out["own"][i] = np.diag(inertia) * a[i]
        return out | {"q": self.states.list_positions(q), "v": v}

    def predict(
        self, column_map: ColumnMap, rows: np.ndarray
    ) -> tuple[Floats, Floats, Floats]:
        """What positions, rates and accelerations in rows (n) give without forces.

        Sensor data (n, nsensordata), orientations (nbody, n, 4), places (nbody, n, 3)
        [m].
        """
        import mujoco

        m, data, count = self.free, mujoco.MjData(self.free), len(rows)
        out = np.zeros((count, m.nsensordata))
        turns, places = (np.zeros((m.nbody, count, d)) for d in (4, 3))
        states = zip(*self.states.compute(column_map, rows), strict=True)
        for i, state in enumerate(states):
            data.qpos[:], data.qvel[:], data.qacc[:] = state
            mujoco.mj_inverse(m, data)
            out[i], turns[:, i], places[:, i] = data.sensordata, data.xquat, data.xpos
        return out, turns, places

    def _actuate(self, data: "mujoco.MjData", ctrl: Floats) -> Floats:
        """Torques (nv) of the actuators by commands (nu)."""
        import mujoco

        data.ctrl[:] = ctrl
        settle_activations(self.free, data)
        mujoco.mj_fwdActuation(self.free, data)
        return data.qfrc_actuator.copy()

    def find_limit(self, dof: int) -> float:
        """Largest torque of a joint's actuators [N m or N]; inf: unlimited."""
        joint, total = int(self.model.dof_jntid[dof]), 0.0
        for a in range(self.model.nactuator):
            if find_joint(self.model, a) == joint:
                ends = find_force_range(self.model, a)
                total += min(map(abs, ends)) if ends else np.inf
        return total or np.inf

    def name_dof(self, dof: int) -> str:
        """The joint of a degree of freedom, or the body of a free joint."""
        joint = self.model.joint(int(self.model.dof_jntid[dof]))
        return joint.name or self.model.body(int(self.model.dof_bodyid[dof])).name


def settle_activations(model: "mujoco.MjModel", data: "mujoco.MjData") -> None:
    """Have activations that follow a command be that command."""
    single = (model.actuator_actadr >= 0) & (model.actuator_ctrlnum == 1)
    for a in np.flatnonzero(single):
        data.act[model.actuator_actadr[a]] = data.ctrl[model.actuator_ctrladr[a]]

"""The balance of torques: a mend of the columns in, what it leaves unexplained out.

Inverse dynamics (Featherstone 2008, chapter 5) gives the torque that each joint's
motion takes; the actuators give it by the model. Between them may stand whatever
physics a model lacks: each of it is a term with a bounded coefficient. What these
cannot stand for is a wrong sign, unit or order of the columns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..recording import Recording, list_controls
from ..recording.data import Floats
from .joints import JointColumns, follows_command
from .series import Series
from .states import Mend, States, q_of_dofs

if TYPE_CHECKING:
    import mujoco

SMALL = 0.01  # of the mean difference of blocks, that is not ranked; chosen
ANEW = 0.3  # change of a share's logarithm that is no noise; chosen
MAX_ROWS = 700  # that are evaluated; chosen: 20 ms for a seven-joint arm
MIN_BLOCKS = 6  # of which half is held out at a time; chosen: three fit nine terms
# bounds of what missing physics may do, as shares of what the model states; chosen so
# that it stays physics: gains, masses and gravity keep their sign, friction dissipates
GAIN = (-0.7, 1.5)  # of an actuator
DELAY = (-0.02, 0.12)  # [s] of a command
GRAVITY = (-1.05, 1.0)  # none at all: a controller may compensate it
COUPLING = (-0.5, 1.0)  # torques of other joints' motion, and of rates
INERTIA = (-0.5, 4.0)  # rotor inertia, of the joint's own inertia
SPRING = (-0.5, 3.0)  # of gravity's torque, per rad
DRY_RATE = 0.1  # of a joint's usual rate, at which dry friction is whole; chosen
# [m] at which geoms count as touching, and kernels around a contact that feel it;
# chosen: an error of a pose, and the width of a kernel
CONTACT_MARGIN, CONTACT_KERNELS = 0.005, 3.0


@dataclass(frozen=True, eq=False)
class Balance:
    """What a mend leaves.

    Attributes:
        unexplained: (D) share of the variance of each degree of freedom's torques [1],
            held out.
        error: (D) mean square of the unexplained torque [(N m)^2 or N^2], over the
            square of the mend's factor: likelihoods of one column are compared in
            its own unit.
        blocks: (B, D) the same of each block.
        size: (D) variance of the torques [(N m)^2 or N^2].
    """

    unexplained: Floats
    error: Floats
    blocks: Floats
    size: Floats

    @property
    def worst(self) -> float:
        """The largest share unexplained."""
        return float(self.unexplained.max(initial=0.0))

    def select_changed(self, other: "Balance") -> Floats:
        """Shares unexplained (n) of the torques that `other` balances anew [1]."""
        return self.unexplained[np.abs(np.log(self.error / other.error)) > ANEW]

    def gain_over(self, other: "Balance") -> tuple[float, float]:
        """Nats a row by which this explains more, and how likely by chance.

        Args:
            other: the balance of another mend.

        Returns:
            The gain, and the p-value of a one-sided Wilcoxon signed-rank test over
            the blocks (Wilcoxon 1945).
        """
        from scipy.stats import wilcoxon

        # of differences of squares, those that are small say nothing: blocks at rest
        each = np.sum((other.blocks - self.blocks) / other.error, axis=1)
        each = each[np.isfinite(each)]
        each = each[np.abs(each) > SMALL * np.mean(np.abs(each))]
        whole = np.log(other.error / self.error) / 2
        if len(each) < MIN_BLOCKS or not np.any(each):
            return float(np.sum(whole)), 1.0
        p = wilcoxon(each, alternative="greater").pvalue
        return float(np.sum(whole)), float(p)


class TorqueBalance:
    """The balance of one recording: evaluates mends in the same rows.

    Attributes:
        reason: why it cannot be computed; "" where it can.
        dofs: (D) degrees of freedom whose torques are all known.
        torques: of the log as it is, see `compute_torques`.
        stiffness: (nv) gravity's torque over how far a joint moves, of the log as it
            is. By it springs are bounded, the same ones for all mends: else a mend
            that makes motions small allows a stiffer one [N m/rad or N/m].
    """

    def __init__(
        self,
        recording: Recording,
        model: "mujoco.MjModel",
        joints: Sequence[JointColumns],
        series: Series,
    ) -> None:
        """Choose the rows.

        Args:
            recording: of the robot.
            model: of it.
            joints: with their columns.
            series: of the recording.
        """
        import copy

        import mujoco

        self.series = series
        self.states = States(recording, model, joints, series)
        self.model = copy.copy(model)
        flags = mujoco.mjtDisableBit
        off = (flags.mjDSBL_CONTACT, flags.mjDSBL_LIMIT, flags.mjDSBL_FRICTIONLOSS)
        for flag in (*off, flags.mjDSBL_EQUALITY):
            self.model.opt.disableflags |= int(flag)
        self.given = model
        self.reason = self.states.reason
        if not self.reason and model.neq and model.eq_active0.any():
            self.reason = (
                "the model has equality constraints, whose forces are not known"
            )
        if self.reason:
            return
        self.rows = self._choose_rows()
        blocks = np.unique(series.block[self.rows])
        if len(blocks) < MIN_BLOCKS:
            self.reason = (
                f"all positions are known, away from contacts, in {len(blocks)} blocks "
                f"of about 1 s; at least {MIN_BLOCKS} are needed"
            )
            return
        self.block = np.searchsorted(blocks, series.block[self.rows])
        self.dofs = self._list_dofs()
        self.torques = self.compute_torques(Mend(), self.rows)
        swing = np.sqrt(np.mean(self.torques["hold"] ** 2, axis=0))
        self.stiffness = swing / np.maximum(np.std(self.torques["q"], axis=0), 1e-6)

    def _choose_rows(self) -> np.ndarray:
        """Rows in which all positions are known, away from contacts."""
        known = self.states.find_known()
        if _may_touch(self.given):
            known &= ~self._find_contacts(np.flatnonzero(known))
        rows = np.flatnonzero(known)
        if len(rows) > MAX_ROWS:
            rows = rows[np.linspace(0, len(rows) - 1, MAX_ROWS).astype(int)]
        return rows

    def _find_contacts(self, rows: np.ndarray) -> np.ndarray:
        """Whether something touches, or did within a kernel's width: (N)."""
        import copy

        import mujoco
        from scipy.ndimage import maximum_filter1d

        model = copy.copy(self.given)
        model.geom_margin[:] = np.maximum(model.geom_margin, CONTACT_MARGIN)
        data, touches = mujoco.MjData(model), np.zeros(len(self.series.episode))
        for row, q in zip(rows, self.states.compute(Mend(), rows)[0], strict=True):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            touches[row] = data.ncon > 0
        wide = round(CONTACT_KERNELS * self.series.kernel / self.series.step)
        return maximum_filter1d(touches, 2 * wide + 1, mode="constant") > 0

    def _list_dofs(self) -> np.ndarray:
        """Degrees of freedom whose actuators' forces can be computed."""
        import mujoco

        m = self.given
        lost = np.zeros(m.nv, bool)
        data = mujoco.MjData(m)
        mujoco.mj_forward(m, data)
        moment = np.zeros((m.nout, m.nv))
        if m.nout:
            mujoco.mju_sparse2dense(
                moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr,
                data.moment_colind,
            )  # fmt: skip
        for a in range(m.nactuator):
            if not follows_command(m, a):
                outputs = m.actuator_outadr[a] + np.arange(m.actuator_outnum[a])
                lost |= (moment[outputs] != 0).any(axis=0)
        return np.flatnonzero(~lost)

    def evaluate(self, mend: Mend, every: int = 1) -> Balance:
        """What a mend of the columns leaves unexplained, in each so many rows."""
        parts = self.compute_torques(mend, self.rows[::every])
        block = self.block[::every]
        count = int(self.block.max()) + 1
        rows = np.bincount(block, minlength=count)
        left, size = np.empty((2, len(self.dofs)))
        blocks = np.empty((count, len(self.dofs)))
        for k, d in enumerate(self.dofs):
            own, terms = self.make_terms(parts, d)
            rest, size[k] = _explain(terms, block)
            # an offset explains the mean of gravity's torque, whatever the columns say
            size[k] = max(size[k] - np.mean(own["hold"]) ** 2, 1e-18)
            left[k] = np.mean(rest**2)
            blocks[:, k] = np.bincount(block, rest**2, minlength=count) / np.maximum(
                rows, 1
            )
        for first in (self.given.jnt_dofadr[j] for j in self.states.bases):
            for three in (range(first, first + 3), range(first + 3, first + 6)):
                these = np.isin(self.dofs, three)
                size[these] = size[these].mean() if these.any() else 1.0
        share = np.maximum(left / size, 1e-12)
        unit = self._list_factors(mend) ** 2
        return Balance(share, share * size / unit, blocks / unit, size)

    def make_terms(
        self, parts: Mapping[str, Floats], dof: int
    ) -> tuple[dict[str, Floats], "Terms"]:
        """Torques (n) of one degree of freedom out of those of all, and their terms."""
        own = {name: values[:, dof] for name, values in parts.items()}
        return own, _make_terms(own, self.given.dof_damping[dof], self.stiffness[dof])

    def _list_factors(self, mend: Mend) -> Floats:
        """Factor (D) by which a mend multiplies the column of a degree of freedom.

        A torque that is left over accelerates: the density of the column is that of the
        torque times its derivative, the inertia times this factor. The inertia is left
        out, for what a rotor adds to it, and the model lacks, is not known.
        """
        factor = np.ones(self.given.nv)
        for name, (_, by) in mend.positions.items():
            factor[self.given.jnt_dofadr[self.states.joints[name].number]] = by
        return np.abs(factor[self.dofs])

    def compute_torques(self, mend: Mend, rows: np.ndarray) -> dict[str, Floats]:
        """Torques (n, nv) that parts of the motion take, or that give it [N m or N].

        Args:
            mend: of the columns.
            rows: (n) of the series.

        Returns:
            "hold": at rest; "rate": with velocities; "all": with accelerations; "own":
            of the joint's own inertia [N m]. "act": of the actuators; "late": how that
            changes as commands come later [N m/s]. "q", "v", "a": of each degree of
            freedom [rad, rad/s, rad/s^2].
        """
        import mujoco

        m, data = self.model, mujoco.MjData(self.model)
        q, v, a = self.states.compute(mend, rows)
        ctrl, change = np.zeros((len(rows), m.nu)), np.zeros((len(rows), m.nu))
        for k, control in enumerate(list_controls(m)):
            name = control.full_name
            source, factor = mend.commands.get(name, (name, 1.0))
            column = self.series.ctrl[source][rows] * factor
            ctrl[:, k], change[:, k] = column[:, 0], column[:, 1]
        shape = (len(rows), m.nv)
        out = {
            k: np.zeros(shape) for k in ("hold", "rate", "all", "own", "act", "late")
        }
        for i in range(len(rows)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[i], 0.0, 0.0
            mujoco.mj_inverse(m, data)
            out["hold"][i] = data.qfrc_inverse
            data.qvel[:] = v[i]
            mujoco.mj_inverse(m, data)
            out["rate"][i] = data.qfrc_inverse
            if m.nactuator:
                self._actuate(data, ctrl[i] - change[i] * 0.01)
                early = data.qfrc_actuator.copy()
                self._actuate(data, ctrl[i])
                out["act"][i] = data.qfrc_actuator
                out["late"][i] = (early - data.qfrc_actuator) / 0.01
            data.qacc[:] = a[i]
            mujoco.mj_inverse(m, data)
            out["all"][i] = data.qfrc_inverse
            # the diagonal of the inertia matrix, at this position
            out["own"][i] = _inertia_diagonal(m, data) * a[i]
        out["q"], out["v"], out["a"] = q_of_dofs(m, q), v, a
        return out

    def _actuate(self, data: Any, ctrl: Floats) -> None:
        import mujoco

        data.ctrl[:] = ctrl
        m = self.model
        for a in np.flatnonzero((m.actuator_actadr >= 0) & (m.actuator_ctrlnum == 1)):
            data.act[m.actuator_actadr[a]] = ctrl[m.actuator_ctrladr[a]]
        mujoco.mj_fwdActuation(m, data)


def _inertia_diagonal(model: "mujoco.MjModel", data: Any) -> Floats:
    """Diagonal (nv) of the joint-space inertia matrix [kg m^2]."""
    import mujoco

    whole = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    return np.diag(whole).copy()


def _may_touch(model: "mujoco.MjModel") -> bool:
    return bool(((model.geom_contype != 0) | (model.geom_conaffinity != 0)).sum() > 1)


@dataclass(frozen=True, eq=False)
class Terms:
    """The torques of a degree of freedom as a sum with bounded coefficients.

    Attributes:
        missing: (n) torque of the actuators without that of the motion [N m or N].
        x: (n, k) terms of missing physics.
        bounds: (2, k) of their coefficients.
        size: (n) square of the torques that the motion takes [(N m)^2 or N^2].
    """

    missing: Floats
    x: Floats
    bounds: Floats
    size: Floats


def _make_terms(parts: Mapping[str, Floats], damping: float, stiffness: float) -> Terms:
    """The terms of one degree of freedom.

    Args:
        parts: (n) its torques, as `TorqueBalance.compute_torques` has them.
        damping: of the joint [N m s/rad].
        stiffness: of gravity, by which a spring is bounded [N m/rad].
    """
    hold, act = parts["hold"], parts["act"]
    coupling = parts["all"] - hold - parts["own"]
    usual = float(np.sqrt(np.mean(parts["v"] ** 2))) + 1e-12
    inf = np.inf
    terms = [
        (act, GAIN), (parts["late"], DELAY), (-hold, GRAVITY), (-coupling, COUPLING),
        (-parts["own"], INERTIA), (-parts["v"], (-1.5 * damping, inf)),
        (-np.tanh(parts["v"] / (DRY_RATE * usual)), (0.0, inf)),
        (-parts["q"], (SPRING[0] * stiffness, SPRING[1] * stiffness)),
        (np.ones_like(act), (-inf, inf)),
    ]  # fmt: skip
    return Terms(
        act - parts["all"], np.stack([t for t, _ in terms], axis=1),
        np.array([b for _, b in terms]).T, parts["own"] ** 2 + hold**2 + coupling**2,
    )  # fmt: skip


def _explain(terms: Terms, block: np.ndarray) -> tuple[Floats, float]:
    """What a degree of freedom's torques (n) leave, held out, and their mean square.

    Args:
        terms: of the degree of freedom.
        block: (n) number of the block of each row.
    """
    left = np.empty_like(terms.missing)
    for half in (0, 1):
        seen = block % 2 == half
        found = solve_bounded(terms.x[seen], -terms.missing[seen], terms.bounds)
        left[~seen] = terms.missing[~seen] + terms.x[~seen] @ found
    return left, float(np.mean(terms.size)) + 1e-18


def solve_bounded(x: Floats, y: Floats, bounds: Floats) -> Floats:
    """Coefficients (k) by which a bounded sum of terms is nearest to values.

    Args:
        x: (n, k) terms.
        y: (n) values.
        bounds: (2, k) least and largest coefficients.
    """
    from scipy.optimize import lsq_linear

    if not len(x):
        return np.zeros(x.shape[1])
    size = np.sqrt((x**2).mean(axis=0))
    used = size > 1e-12
    if not used.any() or len(x) <= used.sum():
        return np.zeros(x.shape[1])
    scale = size[used]
    r: Any = np.linalg.qr(np.column_stack([x[:, used] / scale, y]), mode="r")
    low, high = bounds[0, used] * scale, bounds[1, used] * scale
    problem = {"A": r[:, :-1], "b": r[:, -1], "bounds": (low, high + 1e-15)}
    found = lsq_linear(**problem, method="bvls")
    if found.status in (0, 2):  # out of iterations, or at a step that a bound stopped
        found = lsq_linear(**problem, method="trf")
    out = np.zeros(x.shape[1])
    out[used] = found.x / scale
    return out

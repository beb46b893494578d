"""Bodies and model sensors: takes states, finds columns that kinematics contradicts.

The rates of a pose, and what sensors say of it (frames, gyroscopes, accelerometers),
follow from positions alone: no force takes part.
"""

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording
from ..recording.data import Floats
from .balance import TorqueBalance
from .fault import ColumnCorrection, Fault, correct_factor, format_columns
from .pairs import (
    DEPENDENT_ROWS,
    MIN_ROWS,
    Relation,
    correlation_p_value,
    name_unit,
    relate,
)
from .rollouts import Rollouts, name_groups
from .sensor_frames import find_turned
from .series import Series
from .states import IDENTITY, X_Y_Z_W, Mend, spin

if TYPE_CHECKING:
    import mujoco

MAX_ROWS = 600  # that are evaluated; chosen: some tens of milliseconds
# mean square of an error over that of what is predicted, above which two rates differ
# and below which they agree, and ratio of the two; chosen
DIFFERS, AGREES, FAR_BETTER = 0.3, 0.15, 0.25
SINKS = 0.03  # of a body's size, to which one that is read rightly sinks; chosen
BASES = {
    "order": "F test of the squared errors in both orders, a tenth of the rows counted",
    "columns": "correlation, Fisher's z, a tenth of the rows counted",
}
# MuJoCo's sensors that follow from positions, rates and accelerations
KINEMATIC = (
    *("ACCELEROMETER", "GYRO", "VELOCIMETER", "FRAMEPOS", "FRAMEXAXIS", "FRAMEYAXIS"),
    *("FRAMEZAXIS", "FRAMELINVEL", "FRAMEANGVEL", "SUBTREECOM"),
)


# mean squared errors as it is and in the other order, rows, what was compared
Errors = tuple[float, float, int, str]


class BodyCheck:
    """The faults of columns about bodies."""

    def __init__(
        self, recording: Recording, model: "mujoco.MjModel", series: Series,
        balance: TorqueBalance, rollouts: Rollouts, mend: Mend,
    ) -> None:  # fmt: skip
        """Gather the signals.

        Args:
            recording: of the robot.
            model: of it.
            series: of the recording.
            balance: of its torques.
            rollouts: from its states.
            mend: of the joints' columns.
        """
        self.model, self.series = model, series
        self.balance, self.rollouts, self.mend = balance, rollouts, mend
        self.signals: dict[tuple[str, str], str] = {}
        for episode in recording.episodes.values():
            for name, signal in episode.signals.items():
                self.signals.setdefault((signal.kind, signal.target), name)

    def find_orders(self) -> list[Fault]:
        """Wrong orders of quaternions."""
        every = [
            (b, n) for (k, b), n in self.signals.items() if k == "body_orientation"
        ]
        return [f for body, name in every if (f := self._check_order(body, name))]

    def find_rates(self, wrong: Collection[str]) -> list[Fault]:
        """Signs and units of rates, poses and sensors.

        Args:
            wrong: bodies whose quaternion has another order.
        """
        found = list[Fault]()
        for (kind, body), name in self.signals.items():
            if kind == "body_linear_velocity":
                found += self._check_linear(body, name)
            elif kind == "body_angular_velocity" and body not in wrong:
                found += self._check_angular(body, name)
        if not wrong and not self.balance.states.reason:
            found += self._check_predicted()
        return found

    def _check_order(self, body: str, name: str) -> Fault | None:
        """Whether a quaternion is read in another order than it was written."""
        from scipy.stats import f

        turns = self.series.signals[name]
        for measure in (self._spin_errors, self._frame_errors, self._sink_errors,
                        self._rollout_errors, self._torque_errors):  # fmt: skip
            errors = measure(body, name, turns)
            if errors is None:
                continue
            given, other, rows, what = errors
            if given > DIFFERS and other < FAR_BETTER * given and other < 1:
                count = rows / DEPENDENT_ROWS
                p = float(f.sf(given / max(other, 1e-12), count, count))
                return Fault(
                    "quaternion_order", self.series.episodes, (name,), body,
                    f"{format_columns([name])} is written x y z w, not w x y z: {what} "
                    f"are off by {given:.2g} of their mean square as it is, by "
                    f"{other:.2g} in the other order",
                    p, BASES["order"], (ColumnCorrection(name, {"order": "xyzw"}),),
                )  # fmt: skip
        return None

    def _spin_errors(self, body: str, name: str, turns: Floats) -> Errors | None:
        """Errors of angular velocities in both orders, by a gyroscope of the body."""
        rate = self.signals.get(("body_angular_velocity", body))
        measured = None if rate is None else self.series.signals[rate][:, :, 0]
        if measured is None:
            return None
        known = np.isfinite(turns[:, 0, 0]) & np.isfinite(measured[:, 0])
        if known.sum() < MIN_ROWS:
            return None
        turns, measured = turns[known], measured[known]
        errors = []
        for order in (IDENTITY, X_Y_Z_W):
            miss = spin(turns[:, list(order)])[1] - measured
            errors.append(float(np.mean(miss**2) / (np.mean(measured**2) + 1e-12)))
        return errors[0], errors[1], len(turns), "angular velocities"

    def _frame_errors(self, body: str, name: str, turns: Floats) -> Errors | None:
        """Errors of a body's orientation in both orders, by the joints' positions."""
        states = self.balance.states
        base = {self.model.body(self.model.jnt_bodyid[j]).name for j in states.bases}
        if states.reason or body in base:
            return None
        rows = self._choose_rows(np.isfinite(turns[:, 0, 0]))
        if len(rows) < MIN_ROWS:
            return None
        frames = self._predict(rows)[1][self.model.body(body).id]
        errors = []
        for order in (IDENTITY, X_Y_Z_W):
            unit = spin(turns[rows][:, list(order)])[0]
            # 4 sin^2 of half the angle between the two: at most 4
            errors.append(float(np.mean(4 * (1 - (unit * frames).sum(axis=1) ** 2))))
        return errors[0], errors[1], len(rows), "orientations that the joints give"

    def _rollout_errors(self, body: str, name: str, turns: Floats) -> Errors | None:
        """Misses of short simulations in both orders, of a base in lasting contact."""
        states, m = self.balance.states, self.model
        bases = [j for j in states.bases if m.body(m.jnt_bodyid[j]).name == body]
        if not bases or not self.balance.reason or self.rollouts.reason:
            return None
        own = [g for g, n in enumerate(self.rollouts.groups) if n in name_groups(body)]
        given = self.rollouts.evaluate(self.mend).share[own]
        if given.max() < 1:  # better than no prediction
            return None
        turned = self.mend.then(Mend(order={body: X_Y_Z_W}))
        other = self.rollouts.evaluate(turned).share[own]
        rows = len(self.rollouts.rows) * int(DEPENDENT_ROWS)  # each is a start anew
        what = "simulations from its pose"
        return float(given.mean()), float(other.mean()), rows, what

    def _sink_errors(self, body: str, name: str, turns: Floats) -> Errors | None:
        """Depths to which a lone body sinks into what it touches, in both orders."""
        import mujoco

        states, m = self.balance.states, self.model
        bases = [j for j in states.bases if m.body(m.jnt_bodyid[j]).name == body]
        rows = self._choose_rows(np.isfinite(turns[:, 0, 0]))
        if states.reason or not bases or states.joints or len(rows) < MIN_ROWS:
            return None
        geoms = m.geom_bodyid == m.jnt_bodyid[bases[0]]
        allowed = SINKS * float(np.max(m.geom_rbound[geoms], initial=1e-3))
        data, errors = mujoco.MjData(m), []
        for order in (IDENTITY, X_Y_Z_W):
            mend, total = self.mend.then(Mend(order={body: order})), 0.0
            for q in states.compute(mend, rows)[0]:
                data.qpos[:] = q
                mujoco.mj_kinematics(m, data)
                mujoco.mj_comPos(m, data)
                mujoco.mj_collision(m, data)
                total += np.min(data.contact.dist, initial=0.0) ** 2
            errors.append(float(total) / len(rows) / allowed**2)
        return errors[0], errors[1], len(rows), "depths to which it sinks into others"

    def _torque_errors(self, body: str, name: str, turns: Floats) -> Errors | None:
        """What the balance of torques leaves in both orders, of a body that flies."""
        states, m = self.balance.states, self.model
        bases = [j for j in states.bases if m.body(m.jnt_bodyid[j]).name == body]
        if self.balance.reason or not bases:
            return None
        first = m.jnt_dofadr[bases[0]]
        dofs = [k for k, d in enumerate(self.balance.dofs) if d - first in (3, 4, 5)]
        given, other = (
            self.balance.evaluate(self.mend.then(mend))
            for mend in (Mend(), Mend(order={body: X_Y_Z_W}))
        )
        share = (other.unexplained * other.size / given.size)[dofs]
        # errors are counted thrice: half of any inertia may be missing, which leaves
        # a quarter of a torque that should not be there
        return (
            3 * float(given.unexplained[dofs].mean()),
            3 * float(share.mean()),
            len(self.balance.rows),
            "torques of its flight",
        )

    def _check_linear(self, body: str, name: str) -> list[Fault]:
        place = self.signals.get(("body_position", body))
        if place is None:
            return []
        rates = self.series.signals[place][:, :, 1]
        return self._compare(name, body, rates, "the derivative of its position")

    def _check_angular(self, body: str, name: str) -> list[Fault]:
        turn = self.signals.get(("body_orientation", body))
        if turn is None:
            return []
        rates = spin(self.series.signals[turn])[1]
        return self._compare(name, body, rates, "the rate of its orientation")

    def _compare(
        self, name: str, target: str, expected: Floats, what: str
    ) -> list[Fault]:
        """Signs, units and exchanges of a signal's columns against expected ones.

        Args:
            name: of the signal.
            target: body or sensor.
            expected: (N, d) what kinematics gives.
            what: that is.
        """
        got = self.series.signals[name][:, :, 0]
        if got.shape[1] != expected.shape[1]:
            return []
        lags, found = range(1), []
        every = range(got.shape[1])
        table = [
            [
                relate(expected[:, i], got[:, k], self.series.episode, lags)
                for k in every
            ]
            for i in every
        ]
        flipped = [i for i in every if _is_reversed(table[i][i])]
        if flipped:
            signs = [-1 if i in flipped else 1 for i in every]
            first = table[flipped[0]][flipped[0]]
            found.append(self._make(
                "sign", name, target,
                f"columns {flipped} of {format_columns([name])} are the opposite of "
                f"{what} (correlation {first.r:.2f})",
                ColumnCorrection(name, {"sign": signs}), first,
            ))  # fmt: skip
        scaled = [table[i][i] for i in every if table[i][i].has_other_unit]
        if scaled and not flipped:
            ratio = float(np.median([abs(r.ratio) for r in scaled]))
            unit = name_unit(ratio) or "another unit"
            found.append(self._make(
                "unit", name, target, f"{format_columns([name])} is {ratio:.4g} times "
                f"{what}: {unit}", correct_factor(name, 1 / ratio), scaled[0],
            ))  # fmt: skip
        for i in every:
            for k in range(i + 1, got.shape[1]):
                own = table[i][i].is_different and table[k][k].is_different
                if own and all(
                    r.is_same and r.r > 0 for r in (table[i][k], table[k][i])
                ):
                    found.append(self._make(
                        "exchange", name, target,
                        f"columns {i} and {k} of {format_columns([name])} "
                        "are exchanged: each follows what the "
                        f"other should be, {what} (correlation {table[i][k].r:.2f})",
                        ColumnCorrection(name, {"columns": _swap(every, i, k)}),
                        table[i][k],
                    ))  # fmt: skip
        return found

    def _make(
        self, kind: str, name: str, target: str, seen: str,
        correction: ColumnCorrection, relation: Relation,
    ) -> Fault:  # fmt: skip
        """A fault of one signal.

        Args:
            kind: of it.
            name: of the signal.
            target: body or sensor.
            seen: what was.
            correction: of the column.
            relation: that tells it.
        """
        p = correlation_p_value(relation.r, relation.rows, DEPENDENT_ROWS)
        every = self.series.episodes
        return Fault(
            kind, every, (name,), target, seen, p, BASES["columns"], (correction,)
        )

    def _check_predicted(self) -> list[Fault]:
        """Model sensors and poses against what the joints' positions give."""
        import mujoco

        rows = self._choose_rows(np.ones(len(self.series.episode), bool))
        if len(rows) < MIN_ROWS:
            return []
        readings, _, places = self._predict(rows)
        expected, targets = dict[str, Floats](), dict[str, str]()
        sensors = dict[str, str]()
        for (kind, target), name in self.signals.items():
            if kind == "sensor":
                s = self.model.sensor(target)
                if mujoco.mjtSensor(s.type[0]).name[7:] not in KINEMATIC:
                    continue
                a, sensors[name] = int(s.adr[0]), target
                values = readings[:, a : a + int(s.dim[0])]
            elif kind == "body_position" and not self._is_base(target):
                values = places[self.model.body(target).id]
            else:
                continue
            whole = np.full((len(self.series.episode), values.shape[1]), np.nan)
            whole[rows] = values
            expected[name], targets[name] = whole, target
        found = find_turned(self.model, self.series, sensors, expected)
        for name, whole in expected.items():
            found += self._compare(
                name, targets[name], whole, "what the positions give"
            )
        return found

    def _is_base(self, body: str) -> bool:
        bases = self.balance.states.bases
        return body in {self.model.body(self.model.jnt_bodyid[j]).name for j in bases}

    def _choose_rows(self, known: np.ndarray) -> np.ndarray:
        rows = np.flatnonzero(known & self.balance.states.find_known())
        if len(rows) > MAX_ROWS:
            rows = rows[np.linspace(0, len(rows) - 1, MAX_ROWS).astype(int)]
        return rows

    def _predict(self, rows: np.ndarray) -> tuple[Floats, Floats, Floats]:
        """Sensor data (n, nsensordata), orientations (nbody, n, 4), places (.., 3)."""
        import mujoco

        m, data = self.balance.model, mujoco.MjData(self.balance.model)
        q, v, a = self.balance.states.compute(self.mend, rows)
        out = np.zeros((len(rows), m.nsensordata))
        turns, places = (
            np.zeros((m.nbody, len(rows), 4)),
            np.zeros((m.nbody, len(rows), 3)),
        )
        for i in range(len(rows)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[i], v[i], a[i]
            mujoco.mj_inverse(m, data)
            out[i], turns[:, i], places[:, i] = data.sensordata, data.xquat, data.xpos
        return out, turns, places


def _is_reversed(relation: Relation) -> bool:
    """Whether two columns are opposite, at the same time."""
    return relation.is_same and relation.r < 0


def _swap(places: Sequence[int], i: int, k: int) -> list[int]:
    """Places with two of them exchanged."""
    out = list(places)
    out[i], out[k] = out[k], out[i]
    return out

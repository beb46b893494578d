"""What measures and what commands each joint: takes a model, gives names of columns."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..recording import (
    Recording,
    find_controls,
    find_joint,
    find_output,
    list_controls,
)
from ..recording.actuator_laws import find_goal, get_servo_gains, is_pid
from ..recording.data import Floats

if TYPE_CHECKING:
    import mujoco

STRIDE = 0.25  # [s] over which positions and velocities are compared; chosen
MAX_RATIO = 7.5  # of two columns in one unit: degrees are 57 times, so its square root


@dataclass(frozen=True)
class Reference:
    """The position at which a servo's force vanishes, but for an offset.

    MuJoCo: force = gain ctrl + bias0 + bias1 length + bias2 velocity, and length =
    gear q.

    Attributes:
        command: name of its column.
        scale: [rad or m per unit of the command].
    """

    command: str
    scale: float


@dataclass(frozen=True)
class JointColumns:
    """A hinge or slide, and the columns about it.

    Attributes:
        number: in the model.
        position, velocity: names of their signals; "" where there is none.
        servo: what its position is commanded to; None where nothing commands that.
        actuators: all that act on this joint alone.
        commands: names of these actuators' columns.
        range: of the joint [rad or m]; None where it has no limits.
        unit: "rad" or "m".
    """

    name: str
    number: int
    position: str = ""
    velocity: str = ""
    servo: Reference | None = None
    actuators: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    range: tuple[float, float] | None = None
    unit: str = "rad"

    @property
    def span(self) -> float:
        """Width of the range [rad or m]; 0 where it has no limits."""
        return self.range[1] - self.range[0] if self.range else 0.0

    @property
    def columns(self) -> tuple[str, ...]:
        """The signals that read it."""
        return tuple(filter(None, (self.position, self.velocity)))


def list_signals(recording: Recording) -> dict[tuple[str, str], str]:
    """The first signal of each kind and target."""
    found: dict[tuple[str, str], str] = {}
    for episode in recording.episodes.values():
        for name, signal in episode.signals.items():
            found.setdefault((signal.kind, signal.target), name)
    return found


def list_joints(
    recording: Recording, model: "mujoco.MjModel"
) -> dict[str, JointColumns]:
    """Every hinge and slide of a model by its name, with a recording's columns of it.

    Commands have the names that `reorder_commands` gives them.
    """
    import mujoco

    names = [control.full_name for control in list_controls(model)]
    read = _find_readings(recording, model)
    hinges = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    found = {}
    for j in range(model.njnt):
        if model.jnt_type[j] not in hinges:
            continue
        name = model.joint(j).name
        acting = [a for a in range(model.nactuator) if find_joint(model, a) == j]
        low, high = model.jnt_range[j]
        found[name] = JointColumns(
            name,
            j,
            read.get(("position", name), ""),
            read.get(("velocity", name), ""),
            _find_servo(model, acting, names),
            tuple(model.actuator(a).name for a in acting),
            tuple(names[c] for a in acting for c in find_controls(model, a)),
            (float(low), float(high)) if model.jnt_limited[j] else None,
            "m" if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE else "rad",
        )
    return found


def shares_unit(recording: Recording, joint: JointColumns) -> bool:
    """Whether a joint's velocity, if it is read, is in the unit of its position.

    By what both say of how far it moves in `STRIDE`: farther than an encoder's step.
    """
    moved, summed = list[Floats](), list[Floats]()
    for e in recording.episodes.values():
        if {joint.position, joint.velocity} <= {*e.signals} and e.time.size > 2:
            x, v = (
                e.signals[n].values.reshape(e.time.size)
                for n in (joint.position, joint.velocity)
            )
            steps = np.diff(e.time)
            every = max(1, round(STRIDE / float(np.median(steps))))
            path = np.cumsum(np.nan_to_num((v[1:] + v[:-1]) / 2) * steps)
            path = np.append(0.0, path)
            moved.append(x[every:] - x[:-every])
            summed.append(path[every:] - path[:-every])
    if not moved:
        return False
    one, other = (
        float(np.nanmean(np.concatenate(part) ** 2)) for part in (moved, summed)
    )
    ratio = np.sqrt(other / max(one, 1e-30))
    return bool(1 / MAX_RATIO < ratio < MAX_RATIO)


def _find_readings(
    recording: Recording, model: "mujoco.MjModel"
) -> dict[tuple[str, str], str]:
    """The first signal that reads each joint's position and velocity."""
    import mujoco

    sensors = {
        mujoco.mjtSensor.mjSENS_JOINTPOS: "position",
        mujoco.mjtSensor.mjSENS_JOINTVEL: "velocity",
    }
    found: dict[tuple[str, str], str] = {}
    for episode in recording.episodes.values():
        for name, signal in episode.signals.items():
            if not np.isfinite(signal.values).any():
                continue
            if signal.kind in ("joint_position", "joint_velocity"):
                found.setdefault((signal.kind[6:], signal.target), name)
            elif signal.kind == "sensor":
                sensor = model.sensor(signal.target)
                if what := sensors.get(mujoco.mjtSensor(sensor.type[0])):
                    joint = model.joint(int(sensor.objid[0])).name
                    found.setdefault((what, joint), name)
    return found


def follows_command(model: "mujoco.MjModel", actuator: int) -> bool:
    """Whether an actuator's activation, if any, is its command, but for a lag."""
    import mujoco

    kinds = mujoco.mjtDyn
    lags = (kinds.mjDYN_NONE, kinds.mjDYN_FILTER, kinds.mjDYN_FILTEREXACT)
    return int(model.actuator_dyntype[actuator]) in map(int, lags)


def _find_servo(
    model: "mujoco.MjModel", actuators: list[int], names: list[str]
) -> Reference | None:
    """The reference of the first position servo; `names` are those of ctrl."""
    import mujoco

    for a in actuators:
        (gain, _), bias = get_servo_gains(model, a), model.actuator_biasprm[a]
        gear, goal = model.actuator_gear[find_output(model, a), 0], find_goal(model, a)
        affine = model.actuator_biastype[a] == int(mujoco.mjtBias.mjBIAS_AFFINE)
        fixed = model.actuator_gaintype[a] == int(mujoco.mjtGain.mjGAIN_FIXED)
        is_servo = affine and (fixed or is_pid(model, a)) and follows_command(model, a)
        if is_servo and goal >= 0 and gain and gear:
            return Reference(names[goal], float(-gain / bias[1] / gear))
    return None

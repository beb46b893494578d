"""What a diagnosis knows of a robot: its joints, actuators, bodies and signals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...recording.data import Floats

if TYPE_CHECKING:
    import mujoco

POSITION_LIKE = ("joint_position", "body_position", "body_orientation", "sensor")
NOT_PREDICTED = ("supply_voltage", "temperature")  # the model does not predict them
STOPS = 0.5  # [s] in which a torque that shows would stop a joint; chosen
VAGUE = 2.0  # steps of a simulation, by which a contact may be off; chosen


@dataclass(frozen=True, eq=False)
class Channel:
    """A signal that is compared, and its columns among all.

    Attributes:
        name: in the recording.
        kind: of the contract.
        target: joint, actuator, body or sensor.
        unit: of the readings.
        width: columns.
        first: its first column.
        spread: standard deviation of the readings [unit], over all columns.
        reach: largest magnitude [unit].
        lattice: the step of its values [unit] if they lie on one, else 0.
        scatter: (width) of a reading about its neighbors' parabola [unit].
        noise: (width) of a reading [unit]; larger where it is slow, for a parabola
            takes that for motion.
        memory: (width) correlation of that noise with the sample before; 0: white.
    """

    name: str
    kind: str
    target: str
    unit: str
    width: int
    first_column: int
    spread: float
    max_abs: float
    quantum: float
    scatter: Floats
    noise: Floats
    ar1: Floats

    @property
    def columns(self) -> slice:
        """Where it stands among all columns."""
        return slice(self.first_column, self.first_column + self.width)

    @property
    def free_columns(self) -> int:
        """How many of its columns are free; a direction is as long as another."""
        return self.width - (self.width > 1 and self.unit in ("1", "quaternion"))

    @property
    def is_scored(self) -> bool:
        """Whether the contract's score counts it."""
        return self.kind in POSITION_LIKE


def repeat_by_column(signals: Sequence[Channel], field: str) -> np.ndarray:
    """(C) a signal's `field`, once for each of its columns."""
    return np.concatenate([np.full(c.width, getattr(c, field)) for c in signals])


@dataclass(frozen=True)
class Joint:
    """A hinge or slide, and how the recordings use it.

    Attributes:
        id, dof, qpos: in the given model.
        name: of the joint.
        unit: "rad" or "m".
        torque: typical [N m or N].
        speed: root mean square [unit/s].
        fastest: largest speed [unit/s].
        range: angles seen, from end to end [unit].
        middle: of that range.
        inertia: at the joint [kg m^2 or kg].
        measured: whether its position is recorded.
    """

    id: int
    name: str
    dof: int
    qpos: int
    unit: str
    torque: float
    speed: float
    max_speed: float
    range: float
    range_center: float
    inertia: float
    measured: bool

    @property
    def force(self) -> str:
        """Unit of its torque."""
        return "N m" if self.unit == "rad" else "N"


@dataclass(frozen=True)
class Actuator:
    """An actuator, and how the recordings use it.

    Attributes:
        id: in the model.
        name: of the actuator.
        dof, qpos: of the joint it drives; -1 where it drives none.
        servo: it holds a position that is commanded.
        most: largest torque that it was asked for [N m or N].
        rate: largest rate of its command [unit/s].
        unit: of the joint, "rad" or "m".
        measured: whether the joint's position is recorded.
    """

    id: int
    name: str
    dof: int
    qpos: int
    servo: bool
    max_force: float
    max_rate: float
    unit: str
    measured: bool

    @property
    def force(self) -> str:
        """Unit of its torque."""
        return "N m" if self.unit == "rad" else "N"


@dataclass(frozen=True, eq=False)
class MovingBody:
    """A body that moves.

    Attributes:
        id: in the model.
        name: of the body.
        mass: [kg].
        chain: mass of it and of all that hangs on it [kg].
        size: typical extent [m].
        far: (3) its far end in its frame [m].
        com: (3) its center of mass in its frame [m].
        box: (3, 2) where a payload may be in its frame [m].
        length: of the link [m], 0 where it has none.
        offset: from its parent's origin [m].
        parent: body id.
        free: floats.
    """

    id: int
    name: str
    mass: float
    subtree_mass: float
    size: float
    far_end: Floats
    com: Floats
    box: Floats
    length: float
    offset: float
    parent: int
    is_floating: bool


@dataclass(frozen=True, eq=False)
class RobotSummary:
    """All that an effect may ask before it says where it could be.

    Attributes:
        model: as given, compiled.
        step: of the simulation [s].
        signals: those compared.
        joints: hinges and slides.
        actuators: all.
        bodies: those that move.
        touches: whether anything touched the world.
        is_posed: whether no motion was read, but poses.
    """

    model: "mujoco.MjModel"
    timestep: float
    channels: tuple[Channel, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    bodies: tuple[MovingBody, ...]
    has_contact: bool
    has_only_poses: bool = False

    @property
    def contact_timing_error(self) -> float:
        """By how much contacts may begin early or late [s]: it hides such a delay."""
        return VAGUE * self.timestep if self.has_contact else 0.0

    def joint_by_id(self, joint: int) -> Joint:
        """The joint of that id."""
        return next(j for j in self.joints if j.id == joint)

    def joint_by_dof(self, dof: int) -> Joint:
        """The joint of that degree of freedom."""
        return next(j for j in self.joints if j.dof == dof)

    def actuator_place(self, actuator: Actuator) -> dict[str, Any]:
        """What an effect needs to act at an actuator."""
        return {
            "actuator": actuator.id,
            "dof": actuator.dof,
            "qpos": actuator.qpos,
            "gear": float(self.model.actuator_gear[actuator.id, 0]),
        }


def has_affine_force(model: "mujoco.MjModel", actuator: int) -> bool:
    """Whether a force is affine in length and speed, by numbers that a text states.

    That of a muscle, of a DC motor and of a user's own law is not.
    """
    law = model.actuator_gaintype[actuator], model.actuator_biastype[actuator]
    return bool(max(law) <= 1)  # mjtGain: fixed, affine; mjtBias: none, affine


def min_stable_inertia(model, joint: int) -> float:
    """Inertia [kg m^2 or kg] that the servos at a joint do not turn around in a step.

    MuJoCo holds a servo's stiffness for a step, and with the integrators Euler and RK4
    its damping too: a lighter joint diverges.
    """
    step = model.opt.timestep
    servos = (
        np.isin(model.actuator_trntype, (0, 1))  # at a joint
        & (model.actuator_trnid[:, 0] == joint)
        & (model.actuator_biastype == 1)  # affine
    )
    stiffness, damping = -model.actuator_biasprm[servos, 1:3].T
    gear = model.actuator_gear[servos, 0]
    return float((gear**2 * (stiffness * step + damping) * step).sum())


def find_link_axis(model: "mujoco.MjModel", body: int) -> tuple[Floats, float]:
    """Direction (3) in which a body reaches from its origin, and how far [m].

    To its only child, else to the far end of its geoms, else to its center of mass.
    """
    ends = [model.body_pos[c] for c in _child_bodies(model, body)]
    if len(ends) != 1 or np.linalg.norm(ends[0]) < 1e-6:
        ends = [*_geom_ends(model, body), model.body_ipos[body]]
    far = max(ends, key=np.linalg.norm)
    length = float(np.linalg.norm(far))
    return (far / length, length) if length > 1e-6 else (np.array([1.0, 0, 0]), 0.0)


def measure_extent(model: "mujoco.MjModel", body: int) -> Floats:
    """How far (3) [m] a body's boxes and children reach along each axis of its frame.

    A mesh keeps its size.
    """
    import mujoco

    kinds = (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID)
    far = [np.abs(model.body_pos[c]) for c in _child_bodies(model, body)]
    for geom in np.flatnonzero(model.geom_bodyid == body):
        if int(model.geom_type[geom]) in map(int, kinds):
            turn = np.empty(9)
            mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
            half = np.abs(turn.reshape(3, 3)) @ model.geom_size[geom]
            far.append(np.abs(model.geom_pos[geom]) + half)
    return np.max(far, axis=0) if far else np.zeros(3)


def _child_bodies(model, body: int):
    return [c for c in np.flatnonzero(model.body_parentid == body) if c != body]


def _geom_ends(model, body: int):
    """Far ends of the geoms' axes, without their radius, in the body's frame."""
    import mujoco

    long = (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))
    for geom in np.flatnonzero(model.geom_bodyid == body):
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0, 1]), model.geom_quat[geom])
        half = model.geom_size[geom, 1] if int(model.geom_type[geom]) in long else 0.0
        yield model.geom_pos[geom] + half * axis
        yield model.geom_pos[geom] - half * axis


def summarize_joints(model, torque: Floats, motion, measured) -> tuple[Joint, ...]:
    """The hinges and slides.

    Args:
        model: compiled.
        torque: (nv) typical.
        motion: gives, for a joint's id, its speeds' root mean square, largest speed,
            lowest and highest position seen.
        measured: ids of joints whose position is recorded.
    """
    found = []
    for j in range(model.njnt):
        if model.jnt_type[j] not in (2, 3):  # slide, hinge
            continue
        dof = int(model.jnt_dofadr[j])
        speed, fastest, low, high = motion(j)
        inertia = float(model.dof_M0[dof])
        joint = Joint(
            id=j,
            name=model.joint(j).name,
            dof=dof,
            qpos=int(model.jnt_qposadr[j]),
            unit="m" if model.jnt_type[j] == 2 else "rad",
            # neither weight nor a motor acts on what a chain drives
            torque=max(float(torque[dof]), inertia * speed / STOPS, 1e-9),
            speed=max(speed, 1e-3),
            max_speed=max(fastest, 1e-3),
            range=max(high - low, 1e-3),
            range_center=(high + low) / 2,
            inertia=inertia,
            measured=j in measured,
        )
        found.append(joint)
    return tuple(found)


def summarize_bodies(model: "mujoco.MjModel") -> tuple[MovingBody, ...]:
    """The bodies that move and have a name."""
    found = []
    for b in range(1, model.nbody):
        if model.body_weldid[b] == 0 or not model.body(b).name:
            continue
        axis, length = find_link_axis(model, b)
        size = _body_size(model, b, length)
        far = axis * length
        box = np.stack([np.minimum(0, far) - size, np.maximum(0, far) + size], axis=1)
        moving = MovingBody(
            id=b,
            name=model.body(b).name,
            mass=float(model.body_mass[b]),
            subtree_mass=float(model.body_subtreemass[b]),
            size=size,
            far_end=far,
            com=model.body_ipos[b].copy(),
            box=box,
            length=length,
            offset=float(np.linalg.norm(model.body_pos[b])),
            parent=int(model.body_parentid[b]),
            is_floating=bool((model.jnt_type[model.jnt_bodyid == b] == 0).any()),
        )
        found.append(moving)
    return tuple(found)


def _body_size(model, body: int, length: float) -> float:
    """Extent [m] of a body, from its geoms or else its inertia."""
    bound = model.geom_rbound[model.geom_bodyid == body]
    mass = max(float(model.body_mass[body]), 1e-9)
    gyration = float(np.sqrt(model.body_inertia[body].max() / mass))
    return max([length, gyration, *bound, 1e-3])

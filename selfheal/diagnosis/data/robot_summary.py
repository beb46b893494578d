"""Robot summaries: takes a compiled model and its motion, gives joints and bodies."""

from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...recording.data import Floats

if TYPE_CHECKING:
    import mujoco
    from mujoco import MjModel

POSITION_LIKE = ("joint_position", "body_position", "body_orientation", "sensor")
NOT_PREDICTED = ("supply_voltage", "temperature")  # the model does not predict them
# [s] in which a torque that shows would stop a joint; chosen: below the length of a
# segment
STOPPING_SECONDS = 0.5
CONTACT_TIMING_STEPS = 2.0  # by which contacts may be early or late; chosen
# of a joint: typical torque [N m or N], speed [unit/s] and range [unit]; chosen: not
# zero, for scales of parameters are made of them
MIN_TORQUE, MIN_SPEED, MIN_RANGE = 1e-9, 1e-3, 1e-3
MIN_LINK_LENGTH = 1e-6  # [m]; chosen: a shorter link has no direction
MIN_BODY_SIZE, MIN_BODY_MASS = 1e-3, 1e-9  # [m], [kg]; chosen: not zero


@dataclass(frozen=True, eq=False)
class Channel:
    """A signal that is compared, and its columns among those of all signals.

    Attributes:
        name: of the signal, in the recording.
        kind: as the contract has it.
        target: name of the joint, actuator, body or sensor.
        unit: of the readings.
        width: how many columns it has; c below.
        first_column: number of its first column.
        spread: standard deviation of the readings, over all columns [unit].
        max_abs: largest magnitude of a reading [unit].
        quantum: to whose multiples its readings are rounded [unit]; 0: to none.
        scatter: (c) standard deviation of readings about local parabolas [unit].
        noise: (c) standard deviation of a reading's noise [unit]. It is larger than
            the scatter where the noise is slow: a parabola takes that for motion. So
            it is where a joint hardly moves and its readings are rounded.
        ar1: (c) correlation of the noise with that of the sample before [1]; 0: it
            is white.
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
        """The signal's columns among those of all signals."""
        return slice(self.first_column, self.first_column + self.width)

    @property
    def error_unit(self) -> tuple[float, str]:
        """A number by which the length of an error gets a unit, and that unit.

        Of an orientation the angle: twice the length of a small change of a quaternion.
        """
        return (2.0, "rad") if self.kind == "body_orientation" else (1.0, self.unit)

    @property
    def free_columns(self) -> int:
        """How many columns are free: a quaternion or direction has a unit norm."""
        return self.width - (self.width > 1 and self.unit in ("1", "quaternion"))

    @property
    def rounding_noise(self) -> float:
        """Standard deviation of the error of rounding, which is uniform [unit]."""
        return self.quantum / np.sqrt(12)

    @property
    def is_scored(self) -> bool:
        """Whether the contract's score counts it."""
        return self.kind in POSITION_LIKE


def repeat_by_column(channels: Sequence[Channel], field: str) -> np.ndarray:
    """(C) the value of a field of each channel, once for each of its columns."""
    return np.concatenate([np.full(c.width, getattr(c, field)) for c in channels])


@dataclass(frozen=True)
class Joint:
    """A hinge or slide, and how the recordings use it.

    Attributes:
        id: in the given model.
        name: of the joint.
        dof: index of its velocity in qvel.
        qpos: index of its position in qpos.
        unit: of its position, "rad" or "m".
        torque: typical torque [N m or N].
        speed: root mean square of its velocity [unit/s].
        max_speed: largest speed [unit/s].
        range: of the positions seen, from end to end [unit].
        range_center: middle of that range [unit].
        late_range: the same of the last positions seen [unit].
        late_center: middle of that range [unit].
        inertia: at the joint, as MuJoCo's dof_M0 [kg m^2 or kg].
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
    late_range: float
    late_center: float
    inertia: float
    measured: bool

    @property
    def force(self) -> str:
        """Unit of the torque, "N m" or "N"."""
        return "N m" if self.unit == "rad" else "N"


@dataclass(frozen=True)
class Actuator:
    """An actuator, and how the recordings use it.

    Attributes:
        id: in the given model.
        name: of the actuator.
        dof: index of its joint's velocity in qvel; -1: it drives no joint.
        qpos: index of its joint's position in qpos; -1: it drives no joint.
        servo: whether it holds a position that is commanded, in that position's unit.
        max_force: largest torque that was commanded [N m or N].
        speed: root mean square of its velocity, without the gear [unit/s].
        max_rate: largest rate of its goal, or of its commands if it has none [unit/s].
        unit: of the position of what it drives, "rad" or "m".
        measured: whether the joint's position is recorded.
    """

    id: int
    name: str
    dof: int
    qpos: int
    servo: bool
    max_force: float
    speed: float
    max_rate: float
    unit: str
    measured: bool

    @property
    def force(self) -> str:
        """Unit of the torque, "N m" or "N"."""
        return "N m" if self.unit == "rad" else "N"


@dataclass(frozen=True, eq=False)
class MovingBody:
    """A body that moves.

    Attributes:
        id: in the given model.
        name: of the body.
        mass: of the body alone [kg].
        subtree_mass: of the body and all bodies below it [kg].
        size: typical extent [m].
        far_end: (3) of the link, in the body's frame [m].
        com: (3) center of mass, in the body's frame [m].
        box: (3, 2) lowest and highest coordinates that a payload may have in the body's
            frame [m].
        length: of the link [m]; 0: it has none.
        offset: distance of its origin from its parent's [m].
        parent: id of the parent body.
        is_floating: whether a free joint moves it.
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
    """A robot as effects see it when they propose where they could be.

    Attributes:
        model: as given, compiled.
        timestep: of the simulation [s].
        channels: signals that are compared.
        joints: hinges and slides.
        actuators: all of the model.
        bodies: those that move and have a name.
        has_contact: whether anything touches something.
        has_only_poses: whether single poses were read, and no motion.
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
        """By how much contacts may be early or late [s]; no shorter delay shows."""
        return CONTACT_TIMING_STEPS * self.timestep if self.has_contact else 0.0

    def joint_by_dof(self, dof: int) -> Joint:
        """The joint with an index in qvel."""
        return next(j for j in self.joints if j.dof == dof)


def min_stable_inertia(model: "MjModel", joint: int) -> float:
    """Least inertia at which a joint's servos are stable [kg m^2 or kg].

    MuJoCo holds a servo's stiffness k for a step h and, with the integrators Euler and
    RK4, its damping d. A joint with less than sum gear^2 (k h + d) h diverges.
    """
    step = model.opt.timestep
    servos = (
        np.isin(model.actuator_trntype, (0, 1))  # at a joint
        & (model.actuator_trnid[:, 0] == joint)
        & (model.actuator_biastype == 1)  # affine
    )
    stiffness, damping = -model.actuator_biasprm[servos, 1:3].T
    gear = model.actuator_gear[model.actuator_outadr[servos], 0]
    return float((gear**2 * (stiffness * step + damping) * step).sum())


def find_link_axis(model: "mujoco.MjModel", body: int) -> tuple[Floats, float]:
    """Unit vector (3) along a link from the body's origin, and the link's length [m].

    A link reaches to the only child, else to the far end of the geoms, else to the
    center of mass.
    """
    ends = [model.body_pos[c] for c in _child_bodies(model, body)]
    if len(ends) != 1 or np.linalg.norm(ends[0]) < MIN_LINK_LENGTH:
        ends = [*_geom_ends(model, body), model.body_ipos[body]]
    far = max(ends, key=np.linalg.norm)
    length = float(np.linalg.norm(far))
    if length > MIN_LINK_LENGTH:
        return far / length, length
    return np.array([1.0, 0, 0]), 0.0


def measure_extent(model: "mujoco.MjModel", body: int) -> Floats:
    """How far (3) a body's boxes and children reach along each axis of its frame [m].

    Meshes and other geoms do not count.
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


def _child_bodies(model: "MjModel", body: int) -> list[np.integer]:
    """Ids of a body's children."""
    return [c for c in np.flatnonzero(model.body_parentid == body) if c != body]


def _geom_ends(model: "MjModel", body: int) -> Iterator[Floats]:
    """Ends (3) of the geoms' axes, without their radius, in the body's frame [m]."""
    import mujoco

    elongated = (
        int(mujoco.mjtGeom.mjGEOM_CAPSULE),
        int(mujoco.mjtGeom.mjGEOM_CYLINDER),
    )
    for geom in np.flatnonzero(model.geom_bodyid == body):
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0, 1]), model.geom_quat[geom])
        half = (
            model.geom_size[geom, 1] if int(model.geom_type[geom]) in elongated else 0.0
        )
        yield model.geom_pos[geom] + half * axis
        yield model.geom_pos[geom] - half * axis


def summarize_joints(
    model: "mujoco.MjModel",
    torque: Floats,
    motion: Callable[[int], tuple[float, ...]],
    measured: Set[int],
) -> tuple[Joint, ...]:
    """Summarize the hinges and slides.

    Args:
        torque: (nv) typical [N m or N].
        motion: gives, for a joint's id, the root mean square of its velocity, its
            largest speed, its lowest and highest position, and those of the end.
        measured: ids of joints whose position is recorded.
    """
    joints = []
    for j in range(model.njnt):
        if model.jnt_type[j] not in (2, 3):  # slide, hinge
            continue
        dof = int(model.jnt_dofadr[j])
        speed, max_speed, low, high, late_low, late_high = motion(j)
        inertia = float(model.dof_M0[dof])
        joint = Joint(
            id=j,
            name=model.joint(j).name,
            dof=dof,
            qpos=int(model.jnt_qposadr[j]),
            unit="m" if model.jnt_type[j] == 2 else "rad",
            # neither weight nor a motor acts on what a chain drives
            torque=max(
                float(torque[dof]), inertia * speed / STOPPING_SECONDS, MIN_TORQUE
            ),
            speed=max(speed, MIN_SPEED),
            max_speed=max(max_speed, MIN_SPEED),
            range=max(high - low, MIN_RANGE),
            range_center=(high + low) / 2,
            late_range=max(late_high - late_low, MIN_RANGE),
            late_center=(late_high + late_low) / 2,
            inertia=inertia,
            measured=j in measured,
        )
        joints.append(joint)
    return tuple(joints)


def summarize_bodies(model: "mujoco.MjModel") -> tuple[MovingBody, ...]:
    """Summarize the bodies that move and have a name."""
    bodies = []
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
        bodies.append(moving)
    return tuple(bodies)


def _body_size(model: "MjModel", body: int, length: float) -> float:
    """Extent of a body [m]: the largest of link, geoms and radius of gyration."""
    bound = model.geom_rbound[model.geom_bodyid == body]
    mass = max(float(model.body_mass[body]), MIN_BODY_MASS)
    gyration = float(np.sqrt(model.body_inertia[body].max() / mass))
    return max([length, gyration, *bound, MIN_BODY_SIZE])

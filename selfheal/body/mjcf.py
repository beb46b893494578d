"""Body to MJCF and back: the one room that writes MuJoCo models of bodies."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from ..errors import ModelError
from ..limited_reading import explain_dangerous
from ..printable import join_names
from ..recording import read_spec
from .body import (
    BELLY_SENSOR,
    GRAVITY,
    Anatomy,
    Bodies,
    Floats,
    Ints,
    list_parents_first,
)
from .changes import compute_direction, tilt_gravity
from .genome import HINGE_AXES, UP

_SAME_AXIS = 1e-6  # by which directions of one kind differ in an MJCF [1 or rad]


@dataclass(frozen=True)
class Physics:
    """Constants of the articulated simulation that a body does not fix.

    Attributes:
        timestep: [s].
        friction: sliding friction of every contact with the floor [1].
        kp: servo stiffness [N m/rad].
        kv: servo damping [N m s/rad].
        damping: of each joint [N m s/rad].
        armature: of each joint [kg m^2].
        density: factor on every mass [1].

    Defaults are chosen. The 2006 program's servos are "in effect kinematic"
    (papers.md 1.1): kp = 200 holds a part within 0.3 degrees of its target.
    """

    timestep: float = 0.002
    friction: float = 1.0
    kp: float = 200.0
    kv: float = 3.0
    damping: float = 0.02
    armature: float = 0.002
    density: float = 1.0


def _add_torso(
    spec: mujoco.MjSpec, anatomy: Anatomy, physics: Physics
) -> mujoco.MjsBody:
    """Add the torso, free unless it is bolted down, and its belly sensor."""
    half = anatomy.torso_half
    torso = spec.worldbody.add_body(name="torso", pos=[0, 0, half[2] + 1e-4])
    if not anatomy.fixed:
        torso.add_freejoint(name="torso_free")
    torso.add_geom(
        name="torso",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        mass=anatomy.torso_mass * physics.density,
    )
    torso.add_site(
        name="belly_sensor",
        pos=[0, 0, BELLY_SENSOR - half[2]],
        quat=[0, 1, 0, 0],  # looking down
    )
    return torso


def _add_part(
    parent: mujoco.MjsBody, bodies: Bodies, row: int, i: int, physics: Physics
) -> mujoco.MjsBody:
    """Attach part i + 1 of body `row` to its parent."""
    a, scale = bodies.anatomy, bodies.thickness[row, i]
    turn, bend = bodies.heading[row, i] / 2, (a.bends[i] if a.bends else 0.0) / 2
    c, s = np.array([np.cos([turn, bend]), np.sin([turn, bend])])
    part = parent.add_body(
        name=a.parts[i],
        pos=bodies.anchor[row, i],
        quat=[c[0] * c[1], -s[0] * s[1], c[0] * s[1], s[0] * c[1]],  # z, then y
    )
    part.add_joint(
        name=a.joints[i],
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=bodies.axis[row, i],
        damping=[physics.damping, 0, 0],
        armature=physics.armature,
    )
    if a.block_mass[i] > 0:
        part.add_geom(
            name=f"{a.parts[i]}_block",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[a.block_center[i] * scale, 0, 0],
            size=a.block_half[i] * scale,
            mass=a.block_mass[i] * scale * physics.density,
        )
    length = bodies.length[row, i]
    part.add_geom(
        name=a.parts[i],
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, length, 0, 0],
        size=[a.radius[i] * scale, 0, 0],
        mass=bodies.mass[row, i] * physics.density,
    )
    if i + 1 in a.feet:
        part.add_site(name=f"{a.parts[i]}_tip", pos=[length, 0, 0])
    return part


def _add_servos_and_sensors(
    spec: mujoco.MjSpec, anatomy: Anatomy, physics: Physics
) -> None:
    """Add the servos and the sensors: vertical, clearance, angles, foot tips."""
    for joint in anatomy.joints:
        servo = spec.add_actuator(
            name=f"{joint}_servo", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.set_to_position(kp=physics.kp, kv=physics.kv)
    sensor, kind = mujoco.mjtSensor, mujoco.mjtObj
    on_site, on_joint = {"objtype": kind.mjOBJ_SITE}, {"objtype": kind.mjOBJ_JOINT}
    spec.add_sensor(
        name="vertical",
        type=sensor.mjSENS_FRAMEZAXIS,
        objname="level",
        reftype=kind.mjOBJ_XBODY,
        refname="torso",
        **on_site,
    )
    spec.add_sensor(
        name="clearance",
        type=sensor.mjSENS_RANGEFINDER,
        objname="belly_sensor",
        intprm=[1, 0, 0],
        **on_site,
    )
    for joint in anatomy.joints:
        angle = {"type": sensor.mjSENS_JOINTPOS, "objname": joint, **on_joint}
        spec.add_sensor(name=f"{joint}_position", **angle)
    for foot in anatomy.feet:
        tip = f"{anatomy.parts[foot - 1]}_tip"
        spec.add_sensor(name=tip, type=sensor.mjSENS_FRAMEPOS, objname=tip, **on_site)


def build_spec(
    bodies: Bodies, row: int = 0, physics: Physics | None = None
) -> mujoco.MjSpec:
    """The articulated model of one body.

    Args:
        physics: None = the defaults.

    Returns:
        A torso on a floor, one hinge and servo a part. Only contacts with the floor
        make forces (papers.md 1.1), and of a bolted robot none.
    """
    physics = physics or Physics()
    spec = mujoco.MjSpec()
    spec.modelname = bodies.anatomy.name
    spec.option.timestep = physics.timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    geom = spec.default.geom
    geom.contype, geom.conaffinity = 1, 0
    geom.friction = [physics.friction, 0.005, 0.0001]
    spec.worldbody.add_light(pos=[0, 0, 2])
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[2, 2, 0.1],
        contype=0,
        conaffinity=0 if bodies.anatomy.fixed else 1,
    )
    spec.worldbody.add_site(name="level")
    hung = {0: _add_torso(spec, bodies.anatomy, physics)}
    for part in list_parents_first(bodies.parent[row]):
        on = hung[int(bodies.parent[row, part - 1])]
        hung[part] = _add_part(on, bodies, row, part - 1, physics)
    _add_servos_and_sensors(spec, bodies.anatomy, physics)
    return spec


def build_walking_spec(
    body: Bodies, physics: Physics, torque: Floats, slope: Floats
) -> mujoco.MjSpec:
    """The articulated model of one body with motors of limited torque on a slope.

    Its only sensors are the feet's tips.

    Args:
        torque: (P) largest of each motor [N m].
        slope: (2) tilt of the ground and downhill azimuth [rad]; gravity is turned,
            the floor stays z = 0.
    """
    spec = build_spec(body, 0, physics)
    tilt, azimuth = slope
    downhill = np.array([*compute_direction(azimuth), 0.0])
    level = np.array([0.0, 0.0, -GRAVITY])
    spec.option.gravity = tilt_gravity(level, tilt, downhill)
    for servo, limit in zip(spec.actuators, torque, strict=True):
        servo.forcelimited, servo.forcerange = True, [-limit, limit]
    for sensor in list(spec.sensors):
        if sensor.type != mujoco.mjtSensor.mjSENS_FRAMEPOS:
            spec.delete(sensor)  # each costs time at every step
    return spec


def format_mjcf(bodies: Bodies, row: int = 0, physics: Physics | None = None) -> str:
    """MJCF text of one body, which opens in any MuJoCo viewer; see `build_spec`."""
    spec = build_spec(bodies, row, physics)
    spec.compile()
    return spec.to_xml()


def load(path: str | Path) -> Bodies:
    """Read a robot's anatomy and true body from an MJCF.

    The MJCF has one body, the torso, which is a box, free or bolted to the world. Each
    part below it has one hinge, one capsule along x that starts at the joint, and at
    most one box, its housing. All masses are explicit. The actuators list the joints in
    the order of the parts. A part with a site `<part>_tip` is a foot.

    Returns:
        A batch of one body with its anatomy.

    Raises:
        ModelError: the file is missing, does not compile or is not such a robot.
    """
    if reason := explain_dangerous(
        path, "selfheal.recording.names:compile_model", "mujoco"
    ):
        raise ModelError(f"{path}: {reason}")
    try:
        spec = read_spec(path)
        model = spec.compile()
    except (ValueError, OSError) as error:
        reason = " ".join(str(error).split())  # in one line
        raise ModelError(f"{path}: MuJoCo cannot read it: {reason}") from error
    joints = [a.target for a in spec.actuators]
    if not joints:
        raise ModelError(f"{path}: no actuators, so no moving parts")
    ids = [int(model.joint(j).bodyid[0]) for j in joints]
    carriers = {int(model.body_parentid[body]) for body in ids} - {*ids}
    if len(carriers) != 1:
        names = join_names(sorted(model.body(body).name for body in carriers))
        raise ModelError(f"{path}: parts hang on {names}; they need one torso")
    known = {carriers.pop(): 0} | {body: i + 1 for i, body in enumerate(ids)}
    parent = np.array([known[int(model.body_parentid[b])] for b in ids])
    anatomy = _read_anatomy(str(path), spec, model, ids, parent)
    return Bodies(
        anatomy=anatomy,
        parent=parent[None],
        anchor=model.body_pos[ids][None].copy(),
        heading=_read_bends(str(path), model, ids)[0][None],
        axis=model.jnt_axis[model.body_jntadr[ids]][None].copy(),
        length=anatomy.length[None].copy(),
        thickness=np.ones((1, len(ids))),
        mass=anatomy.mass[None].copy(),
    )


def _find_geoms(
    path: str, body: mujoco.MjsBody, kind: mujoco.mjtGeom, fewest: int
) -> list[mujoco.MjsGeom]:
    """A body's one geom of this kind; none where `fewest` is 0 and it has none."""
    found = [g for g in body.geoms if g.type == kind]
    shape = kind.name[7:].lower()
    if not fewest <= len(found) <= 1:
        raise ModelError(
            f"{path}: body {body.name!r} has {len(found)} {shape} geoms; "
            "it needs exactly one"
        )
    if found and not found[0].mass > 0:
        raise ModelError(f"{path}: the {shape} of {body.name!r} needs a positive mass")
    return found


def _read_anatomy(
    path: str, spec: mujoco.MjSpec, model: mujoco.MjModel, ids: list[int], parent: Ints
) -> Anatomy:
    """What the parts are, without how they are attached."""
    box, capsule = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CAPSULE
    bodies = [spec.body(model.body(b).name) for b in ids]
    (torso,) = _find_geoms(path, bodies[int(np.argmin(parent))].parent, box, 1)
    rods = [_find_geoms(path, b, capsule, 1)[0] for b in bodies]
    blocks = [next(iter(_find_geoms(path, b, box, 0)), None) for b in bodies]
    hips = model.body_pos[ids][parent == 0]
    sites = {site.name for site in spec.sites}
    return Anatomy(
        name=spec.modelname,
        parts=tuple(b.name for b in bodies),
        joints=tuple(a.target for a in spec.actuators),
        torso_half=np.array(torso.size),
        torso_mass=float(torso.mass),
        rim=np.array([*np.abs(hips[:, :2]).max(axis=0), hips[0, 2]]),
        length=np.array([2 * model.geom(g.name).size[1] for g in rods]),
        radius=np.array([model.geom(g.name).size[0] for g in rods]),
        mass=np.array([g.mass for g in rods]),
        block_half=np.array([g.size if g else np.zeros(3) for g in blocks]),
        block_center=np.array([g.pos[0] if g else 0.0 for g in blocks]),
        block_mass=np.array([g.mass if g else 0.0 for g in blocks]),
        feet=tuple(i + 1 for i, b in enumerate(bodies) if f"{b.name}_tip" in sites),
        hinges=_read_hinges(model.jnt_axis[model.body_jntadr[ids]]),
        bends=_read_bends(path, model, ids)[1],
        ordered=bool((parent <= np.arange(len(ids))).all()),
        fixed=not (model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)).any(),
    )


def _read_hinges(axes: Floats) -> tuple[int, ...]:
    """Kinds of hinges by their axes (P, 3); none where all lift."""
    alike = np.abs(axes[:, None] - HINGE_AXES).max(axis=2) < _SAME_AXIS
    kinds = np.where(alike.any(axis=1), alike.argmax(axis=1), UP)
    return () if (kinds == UP).all() else tuple(kinds.tolist())


def _read_bends(
    path: str, model: mujoco.MjModel, ids: list[int]
) -> tuple[Floats, tuple[float, ...]]:
    """Headings (P) and bends [rad] of parts, of which none may be rolled."""
    turns = np.empty((len(ids), 9))
    for turn, quat in zip(turns, model.body_quat[ids], strict=True):
        mujoco.mju_quat2Mat(turn, quat)
    frames = turns.reshape(-1, 3, 3)
    if (rolled := np.abs(frames[:, 2, 1]) > _SAME_AXIS).any():
        name = model.body(ids[int(np.argmax(rolled))]).name
        raise ModelError(
            f"{path}: body {name!r} is rolled about its own axis; it may "
            "be turned about z, and then about its y"
        )
    bends = np.arctan2(-frames[:, 2, 0], frames[:, 2, 2])
    flat = (np.abs(bends) < _SAME_AXIS).all()
    headings = np.arctan2(-frames[:, 0, 1], frames[:, 1, 1])
    return headings, () if flat else tuple(bends.tolist())

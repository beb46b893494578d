"""One step of a free, reshaping body with MJX's contacts and solver."""

import contextlib
import functools
import io
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

from ..body.body import GRAVITY
from ._jax import prepare_jax

if TYPE_CHECKING:
    from jax import Array
    from mujoco import mjx

CONTACTS = 8  # lowest spheres that may push; chosen: 12 and 24 agree no better
NEWTON = 2  # solver iterations a step; chosen: 20 agree no better
LINE_SEARCH = 4  # line search iterations in each; chosen: 20 agree no better
FRICTION = 1.0  # [1] as mjcf.Physics


class BodyState(NamedTuple):
    """A free body on its way; its frame has its origin at the center of mass.

    Attributes:
        pose: (7) position [m] and orientation quaternion.
        velocity: (6) linear in the world [m/s], angular in the body [rad/s].
        spin: (3) angular momentum in the world, moving parts included [kg m^2/s].
        pull: (6) last acceleration, where the solver starts [m/s^2, rad/s^2].
    """

    pose: "Array"
    velocity: "Array"
    spin: "Array"
    pull: "Array"


class BodyPose(NamedTuple):
    """What a body is like on the way from one planned pose to the next.

    Attributes:
        spheres: (C, 3) from the center of mass [m].
        flow: (C, 3) their velocity relative to it [m/s].
        radius: (C) [m].
        inertia: (3, 3) about the center of mass [kg m^2].
        spin: (3) angular momentum of the parts' relative motion [kg m^2/s].
        mass: () [kg].
    """

    spheres: "Array"
    flow: "Array"
    radius: "Array"
    inertia: "Array"
    spin: "Array"
    mass: "Array"


@functools.cache
def import_mjx() -> ModuleType:
    """The module mujoco.mjx, without the lines it prints when warp is missing."""
    prepare_jax()
    with contextlib.redirect_stdout(io.StringIO()):
        from mujoco import mjx
    return mjx


@functools.cache
def build_sphere_model(timestep: float) -> tuple["mjx.Model", "mjx.Data"]:
    """MJX's model and data of one free body of `CONTACTS` spheres above a floor.

    It makes one solver iteration, started where `qacc_smooth` says. `step_body` repeats
    it, because MJX's own loop over iterations is slow in a batch.

    Args:
        timestep: of the simulation [s].
    """
    import mujoco

    mjx = import_mjx()
    spec = mujoco.MjSpec()
    option, disable = spec.option, mujoco.mjtDisableBit
    option.timestep = timestep
    option.gravity = [0, 0, -GRAVITY]
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.iterations, option.ls_iterations = 1, LINE_SEARCH
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.disableflags = disable.mjDSBL_EULERDAMP | disable.mjDSBL_WARMSTART
    geom = spec.default.geom
    geom.contype, geom.conaffinity, geom.mass = 1, 0, 0
    geom.friction = [FRICTION, 0.005, 0.0001]
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1], contype=0, conaffinity=1
    )
    body = spec.worldbody.add_body(mass=1, inertia=[1, 1, 1], explicitinertial=True)
    body.add_freejoint()
    for _ in range(CONTACTS):
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[1, 0, 0])
    model = spec.compile()
    with prepare_jax().ensure_compile_time_eval():  # also while a program is traced
        return mjx.put_model(model), mjx.make_data(model)


def convert_quaternion(quat: "Array") -> "Array":
    """(3, 3) matrix of a unit quaternion (4)."""
    import jax.numpy as jnp

    w, x, y, z = quat
    return jnp.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def step_body(
    model: "mjx.Model", data: "mjx.Data", state: BodyState, pose: BodyPose
) -> BodyState:
    """Move a body by one timestep while its parts go to their next planned pose.

    Between contacts it keeps its momentum, that of the moving parts included.

    Args:
        state: of the body before the step.
        pose: of its parts after the step.
    """
    import jax.numpy as jnp

    mjx = import_mjx()
    turn = convert_quaternion(state.pose[3:])
    pose = _keep_lowest_spheres(pose, turn, state.pose)
    dt = model.opt.timestep
    inverse = _invert_symmetric(pose.inertia)
    free = inverse @ (state.spin @ turn - pose.spin)
    free = jnp.concatenate([state.velocity[:3] + dt * model.opt.gravity, free])
    free = (free - state.velocity) / dt
    mass = jnp.zeros((6, 6)).at[:3, :3].set(pose.mass * jnp.eye(3))
    mass = mass.at[3:, 3:].set(pose.inertia)
    model, data = _write_kinematics(model, data, state, pose, turn)
    data = data.tree_replace({"_impl.M": mass})
    data = mjx.make_constraint(model, mjx.collision(model, data))
    data = data.tree_replace(
        {"_impl.efc_aref": _compute_reference_acceleration(data, pose, turn)}
    )
    data = data.replace(qfrc_smooth=mass @ free, qacc=state.pull)
    for _ in range(NEWTON):
        data = mjx.solve(model, data.replace(qacc_smooth=data.qacc))
    after = mjx.euler(model, data)
    spin = turn @ (pose.inertia @ after.qvel[3:] + pose.spin)
    return BodyState(after.qpos, after.qvel, spin, data.qacc)


def _keep_lowest_spheres(pose: BodyPose, turn: "Array", place: "Array") -> BodyPose:
    """Keep only the spheres that are closest to the floor, or deepest in it."""
    import jax

    depth = pose.radius - pose.spheres @ turn[2] - place[2]
    _, which = jax.lax.top_k(depth, CONTACTS)
    return pose._replace(
        spheres=pose.spheres[which], flow=pose.flow[which], radius=pose.radius[which]
    )


def _write_kinematics(
    model: "mjx.Model",
    data: "mjx.Data",
    state: BodyState,
    pose: BodyPose,
    turn: "Array",
) -> tuple["mjx.Model", "mjx.Data"]:
    """Put what MJX's kinematics would compute into the model and the data."""
    import jax.numpy as jnp

    place = state.pose[:3]
    spheres = place + pose.spheres @ turn.T
    floor = jnp.zeros((1, 3))
    rolls = jnp.concatenate([turn.T, jnp.zeros((3, 3))], axis=1)
    model = model.replace(
        geom_size=jnp.concatenate([floor, jnp.tile(pose.radius[:, None], 3)]),
        body_invweight0=model.body_invweight0.at[1, 0].set(1 / pose.mass),
    )
    data = data.replace(
        qpos=state.pose,
        qvel=state.velocity,
        geom_xpos=jnp.concatenate([floor, spheres]),
        geom_xmat=jnp.tile(jnp.eye(3), (CONTACTS + 1, 1, 1)),
        subtree_com=jnp.stack([place, place]),
        cdof=jnp.concatenate([jnp.eye(3, 6, 3), rolls]),
    )
    return model, data


def _compute_reference_acceleration(
    data: "mjx.Data", pose: BodyPose, turn: "Array"
) -> "Array":
    """MJX's reference accelerations, damping the spheres' own motion too."""
    import jax.numpy as jnp

    contact, efc = data._impl.contact, data._impl
    flow = jnp.einsum("cij,cj->ci", contact.frame, pose.flow @ turn.T)
    slide = FRICTION * flow[:, 1:]
    edges = flow[:, :1] + jnp.stack([slide, -slide], axis=2).reshape(CONTACTS, 4)
    damping = 2 / (contact.solimp[:, 1] * contact.solref[:, 0])  # as MJX's _kbi
    damping = jnp.where(contact.dist < contact.includemargin, damping, 0.0)
    return efc.efc_aref - (damping[:, None] * edges).reshape(-1)


def _invert_symmetric(a: "Array") -> "Array":
    """(3, 3) inverse of a symmetric matrix, by its cofactors."""
    import jax.numpy as jnp

    rows = jnp.array(
        [jnp.cross(a[1], a[2]), jnp.cross(a[2], a[0]), jnp.cross(a[0], a[1])]
    )
    return rows / (a[0] @ rows[0])

"""Gravity compensation by a robot's controller: one value for all that it carries."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ....recording.data import Floats
from ...data.robot_summary import RobotSummary
from ..base import Term
from ..by_target import WorldEffect
from ..declaration import UNUSUAL, USUAL, Finding, ParameterSpec, Proposal
from ..places import Place
from ..protocols import ModelEdit

if TYPE_CHECKING:
    from mujoco import MjData, MjModel

FREE = 0  # mjtJoint
WEIGHT_POSES = 8  # in which torques of weight are looked for; chosen
# share of the largest torque of weight below which a joint bears none; chosen:
# rounding of mj_rne
MIN_WEIGHT_SHARE = 1e-6
MAX_GRAVCOMP = 2.0  # [1] of a controller that takes masses for twice what they are
MIN_USUAL_BODIES = 3  # of a robot whose controller often carries them; chosen
MIN_CHANGE = 0.15  # [1] below which masses may be wrong as well; chosen


@dataclass(frozen=True, kw_only=True)
class BodiesPlace(Place):
    """What a controller carries.

    Attributes:
        bodies: their ids.
    """

    bodies: tuple[int, ...]


class GravityCompensation(WorldEffect, ModelEdit[BodiesPlace]):
    """One value for the bodies that the joints of a fixed base carry.

    Where bodies state several values, those with the value that most of the mass has
    are changed, and the others keep theirs.
    """

    name = "gravity_compensation"
    group = "actuator"
    description = "The controller carries the robot's weight, beside what it commands."
    equation = "f = -gravcomp m g at the center of mass of every body"
    source = "MuJoCo body/gravcomp"
    separate_by = "hold several poses and compare each joint's angle with its command"
    phrase = "the controller carries {gravcomp} of the robot's weight, {other}"
    parameters = (ParameterSpec("gravcomp", "1", nonnegative=True, is_in_model=True),)

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term of a robot whose motors bear all of its weight, on a fixed base.

        Usual of many bodies: of few, masses and rotors a little off do as much.
        """
        model = robot.model
        bodies = find_compensated_bodies(model)
        if not bodies or not _bear_motors_all(model, bodies):
            return []
        now = float(model.body_gravcomp[bodies[0]])
        p = self.bound(
            "gravcomp",
            (0.0, MAX_GRAVCOMP),
            scale=0.3,
            nominal=now,
            resolution=MIN_CHANGE,
        )
        starts = ((1.0 if now < 0.5 else 0.0,),)
        odds = USUAL if len(bodies) >= MIN_USUAL_BODIES else UNUSUAL
        place = BodiesPlace(bodies=bodies)
        return [self.make_term("world", place, Proposal((p,), starts, odds))]

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        return BodiesPlace(bodies=find_compensated_bodies(model))

    def edit_model(self, model: "MjModel", place: BodiesPlace, values: Floats) -> None:
        model.body_gravcomp[list(place.bodies)] = values[0]


def find_compensated_bodies(model: "MjModel") -> tuple[int, ...]:
    """Ids of the bodies with mass on the joints of a fixed base, of one `gravcomp`."""
    floats = model.jnt_bodyid[model.jnt_type == FREE]
    carried = (model.body_weldid != 0) & (model.body_mass > 0)
    carried &= ~np.isin(model.body_rootid, floats)
    bodies = np.flatnonzero(carried)
    values = model.body_gravcomp[bodies]
    masses = {v: model.body_mass[bodies[values == v]].sum() for v in np.unique(values)}
    if not masses:
        return ()
    return tuple(bodies[values == max(masses, key=masses.__getitem__)].tolist())


def _bear_motors_all(model: "MjModel", bodies: tuple[int, ...]) -> bool:
    """Whether these bodies have weight, and motors bear it at every joint.

    Of a closed loop, some motor is enough: the loop passes its torque on.
    """
    import mujoco

    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    weight = np.zeros(model.nv)
    driven = np.zeros(model.nv, bool)
    for _ in range(WEIGHT_POSES):
        data.qpos[:] = model.qpos0 + rng.normal(size=model.nq)
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_fwdPosition(model, data)
        driven |= np.abs(dense_moments(model, data)).max(axis=0, initial=0.0) > 0
        torque = np.zeros(model.nv)
        for body in bodies:
            force = -model.body_mass[body] * model.opt.gravity
            at = data.xipos[body]
            mujoco.mj_applyFT(model, data, force, np.zeros(3), at, body, torque)
        weight = np.maximum(weight, np.abs(torque))
    size = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    borne = weight > MIN_WEIGHT_SHARE * size
    is_loop = bool(model.neq) and bool(driven.any())
    return bool(borne.any() and (driven[borne].all() or is_loop))


def dense_moments(model: "MjModel", data: "MjData") -> Floats:
    """Moment arms of all actuators' outputs, one row each of (nv) columns."""
    import mujoco

    moments = np.zeros((len(data.moment_rownnz), model.nv))
    if moments.size:
        mujoco.mju_sparse2dense(
            moments,
            data.actuator_moment.ravel(),
            data.moment_rownnz,
            data.moment_rowadr,
            data.moment_colind.ravel(),
        )
    return moments

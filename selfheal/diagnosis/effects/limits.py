"""Limits: where a joint stops, and how much an actuator gives.

What a model states of a limit is where these effects are absent. They take its place:
a stop may be farther in, farther out, or beyond all that was seen.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...recording import find_controls, find_output
from ...recording.actuator_laws import has_affine_force, is_pid
from ...recording.data import Floats
from ..data.robot_summary import Actuator, Joint, RobotSummary
from .base import Effect, Term
from .by_target import ActuatorEffect
from .declaration import FindingField, Parameter, ParameterSpec, Proposal
from .places import AT_JOINT, ActuatorPlace, JointPlace, joint_place
from .protocols import ModelEdit

if TYPE_CHECKING:
    from mujoco import MjModel

# the end of a joint's range that has none [rad or m]; chosen: beyond any position
UNLIMITED_RANGE = 1e6
# share of what an actuator was commanded beyond which it is not limited; chosen
UNLIMITED_SHARE = 1.1


@dataclass(frozen=True, kw_only=True)
class StopPlace(JointPlace):
    """One end of a joint's range.

    Attributes:
        side: -1 the lower or 1 the upper one.
    """

    side: int


class HardStop(Effect, ModelEdit[StopPlace]):
    """A stop that takes the place of the one that the model states at that end."""

    name = "hard_stop"
    target_kinds = ("joint",)
    group = "transmission"
    description = (
        "A stop, or an obstacle, that the joint cannot pass; in the place of one that "
        "the model states, perhaps farther out."
    )
    equation = "q <= range (or >=), as soft as timeconst says"
    source = "MuJoCo joint/range, joint/solreflimit"
    separate_by = "move slowly towards the angle from the free side"
    phrase = "{at} stops at {range}, {other}"
    parameters = (
        ParameterSpec("range", "rad", is_in_model=True),
        ParameterSpec("timeconst", "s", nonnegative=True),
    )
    parameter_sets = (("range",), ("range", "timeconst"))
    finding_fields = (FindingField("side", (-1, 1)),)
    place_type = StopPlace

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """Two terms at each hinge and slide, one for each end of its range."""
        return [
            self._make_term(robot, joint, side)
            for joint in robot.joints
            for side in (-1, 1)
        ]

    def edit_model(self, model: "MjModel", place: StopPlace, values: Floats) -> None:
        joint, (stop, *soft) = place.joint, values
        low, high = -UNLIMITED_RANGE, UNLIMITED_RANGE
        if model.jnt_limited[joint]:
            low, high = model.jnt_range[joint]
        ends = (stop, max(high, stop)) if place.side < 0 else (min(low, stop), stop)
        if not model.jnt_limited[joint] or ends != (low, high):
            model.jnt_solref[joint, : len(soft)] = soft
        model.jnt_range[joint] = np.clip(ends, -UNLIMITED_RANGE, UNLIMITED_RANGE)
        model.jnt_limited[joint] = 1

    def _make_term(self, robot: RobotSummary, joint: Joint, side: int) -> Term:
        """The term of the lower (-1) or upper (1) end of a joint's range."""
        # the farthest position that was seen
        end = joint.range_center + side * joint.range / 2
        nominal = _find_nominal_end(robot.model, joint, side)
        reach = 0.5 * joint.range
        reached = end if np.isinf(nominal) else side * max(side * end, side * nominal)
        low, high = sorted((end - side * reach, reached + side * reach))
        stop = self.bound(
            "range", (low, high), scale=0.1 * joint.range, at=joint, nominal=nominal
        )
        starts = [end - side * 0.02 * joint.range, end - side * 0.1 * joint.range]
        if side * (end - nominal) > -0.02 * joint.range:  # the nominal is in the way
            starts.append(end + side * 0.1 * joint.range)
        soft = self._bound_softness(robot, joint)
        place = joint_place(robot.model, joint.id).extend(StopPlace, side=side)
        values = tuple((start, *(p.nominal for p in soft)) for start in starts)
        return self.make_term(
            f"joint:{joint.name}", place, Proposal((stop, *soft), values)
        )

    def _bound_softness(
        self, robot: RobotSummary, joint: Joint
    ) -> tuple[Parameter, ...]:
        """The contact's time constant, where solref has one and motion was read."""
        time, hard = robot.model.jnt_solref[joint.id, 0], 2 * robot.timestep
        if time < hard or robot.has_only_poses:
            return ()
        soft = self.bound(
            "timeconst", (hard, 0.2), scale=0.2 * time, nominal=float(time)
        )
        return (soft,)


def _find_nominal_end(model: "MjModel", joint: Joint, side: int) -> float:
    """The end of a joint's range as the model states it; infinite where it does not."""
    if not model.jnt_limited[joint.id]:
        return side * np.inf
    return float(model.jnt_range[joint.id, int(side > 0)])


class TorqueSaturation(ActuatorEffect, ModelEdit[ActuatorPlace]):
    """A limit in the place of those that the model states; of a motor ctrlrange too."""

    name = "torque_saturation"
    description = (
        "The actuator gives no more than so much torque; more, perhaps, than the model "
        "states."
    )
    equation = "|tau| <= limit"
    source = "MuJoCo actuator/forcerange"
    separate_by = "command larger and larger steps"
    phrase = "{at} cannot give more than {limit}, {other}"
    parameters = (ParameterSpec("limit", "N m", nonnegative=True, is_in_model=True),)

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        model, a = robot.model, actuator.id
        # at a site the gear is a direction
        geared = model.actuator_gear[find_output(model, a), 0] != 0
        if not geared or not (has_affine_force(model, a) or is_pid(model, a)):
            return None
        most, nominal = actuator.max_force, find_nominal_limit(model, a)
        high = max(20 * most, 2 * nominal) if np.isfinite(nominal) else 20 * most
        limit = self.bound(
            "limit",
            (0.005 * most, high),
            scale=0.1 * most,
            at=actuator,
            nominal=nominal,
        )
        starts = [s * min(most, nominal) for s in (0.9, 0.6, 0.35, 0.2, 0.1, 0.05)]
        if most > nominal:  # more was commanded than the model can give
            starts = [UNLIMITED_SHARE * most, *starts]
        return Proposal((limit,), tuple((start,) for start in starts))

    def edit_model(
        self, model: "MjModel", place: ActuatorPlace, values: Floats
    ) -> None:
        a, stated = place.actuator, find_nominal_limit(model, place.actuator)
        most = values[0] / abs(model.actuator_gear[find_output(model, a), 0])
        limited = model.actuator_forcelimited[a]
        given = model.actuator_forcerange[a] if limited else (-np.inf, np.inf)
        if values[0] > stated:
            widen_limits(model, a, values[0])
            given = model.actuator_forcerange[a] if limited else given
        model.actuator_forcerange[a] = np.clip(given, -most, most)
        model.actuator_forcelimited[a] = 1


def find_nominal_limit(model: "MjModel", actuator: int) -> float:
    """The largest torque [N m or N] that a model lets an actuator give; or infinity."""
    limits = _list_limits(model, actuator)
    return float(
        min([scale * np.abs(ends).max() for ends, scale in limits] or [np.inf])
    )


def widen_limits(model: "MjModel", actuator: int, limit: float) -> None:
    """Scale what a model states of an actuator's limits up to a larger one.

    Args:
        limit: torque [N m or N] that none of them may be below.
    """
    for ends, scale in _list_limits(model, actuator):
        ends[:] *= max(1.0, limit / (scale * np.abs(ends).max()))


def _list_limits(model: "MjModel", actuator: int) -> list[tuple[Floats, float]]:
    """Ranges (2) in a model that limit an actuator, and the torque of one of its unit.

    They are its force's, its one command's and its joint's.
    """
    gear = abs(float(model.actuator_gear[find_output(model, actuator), 0]))
    ranges = []
    if model.actuator_forcelimited[actuator]:
        ranges.append((model.actuator_forcerange[actuator], gear))
    if (control := _find_limited_control(model, actuator)) >= 0:
        gain = abs(float(model.actuator_gainprm[actuator, 0]))
        ranges.append((model.actuator_ctrlrange[control], gear * gain))
    if (joint := _find_limited_joint(model, actuator)) >= 0:
        ranges.append((model.jnt_actfrcrange[joint], 1.0))
    return ranges


def _find_limited_control(model: "MjModel", actuator: int) -> int:
    """Index into ctrl of a motor's one command with a ctrlrange; -1: there is none."""
    controls = find_controls(model, actuator)
    is_motor = (
        has_affine_force(model, actuator)
        and not model.actuator_biasprm[actuator].any()
        and model.actuator_gaintype[actuator] == 0
        and model.actuator_gainprm[actuator, 0] != 0
    )
    if not is_motor or len(controls) != 1:
        return -1
    (control,) = controls
    has_range = model.actuator_ctrllimited[control]
    return control if has_range and model.actuator_ctrlrange[control].any() else -1


def _find_limited_joint(model: "MjModel", actuator: int) -> int:
    """Id of an actuator's joint with an actuatorfrcrange; -1: there is none."""
    joint = int(model.actuator_trnid[actuator, 0])
    at_joint = model.actuator_trntype[actuator] in AT_JOINT
    if not at_joint or not model.jnt_actfrclimited[joint]:
        return -1
    return joint if model.jnt_actfrcrange[joint].any() else -1

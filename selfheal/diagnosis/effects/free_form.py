"""A joint torque of any smooth form, which shows how much an effect could explain."""

from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import Joint, RobotSummary
from .by_target import JointEffect
from .declaration import ParameterSpec, Proposal
from .places import JointPlace, Place
from .protocols import JointForce, StepState

BASIS = (
    "constant",
    "position",
    "position^2",
    "position^3",
    "velocity",
    "velocity |velocity|",
    "sign of velocity",
    "sign of velocity x position",
    "velocity x position",
)


@dataclass(frozen=True, kw_only=True)
class MovedPlace(JointPlace):
    """A joint, and how it moved.

    Attributes:
        range_center: of the positions seen [rad or m].
        range: of them, from end to end [rad or m].
        speed: root mean square of the velocity [rad/s or m/s].
    """

    range_center: float
    range: float
    speed: float


class FreeFormTorque(JointEffect, JointForce[MovedPlace]):
    """A joint torque that is a smooth function of position, velocity and load.

    It is no effect of the catalogue: the share of the error that it removes is what
    effects of the catalogue could explain.
    """

    name = "free_form"
    group = "unlisted"
    parameters = tuple(ParameterSpec(name, "N m", nominal=0.0) for name in BASIS)

    def list_places(self, robot: RobotSummary) -> list[tuple[Joint, Place]]:
        return [
            (
                joint,
                place.extend(
                    MovedPlace,
                    range_center=joint.range_center,
                    range=joint.range,
                    speed=joint.speed,
                ),
            )
            for joint, place in super().list_places(robot)
        ]

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        reach, scale = 3 * joint.torque, 0.1 * joint.torque
        parameters = [
            self.bound(x, (-reach, reach), scale=scale, at=joint) for x in BASIS
        ]
        return Proposal(tuple(parameters), ((0.0,) * len(BASIS),))

    def apply_forces(self, state: StepState, place: MovedPlace, values: Floats) -> None:
        """Add a weighted sum of the basis.

        Args:
            values: (N, p) weights [N m or N].
        """
        middle, range_ = place.range_center, place.range
        x = np.clip(2 * (state.qpos[:, place.qpos] - middle) / range_, -2, 2)
        v = np.clip(state.qvel[:, place.dof] / place.speed, -4, 4)
        dry = np.tanh(10 * v)
        basis = (np.ones_like(x), x, x**2, x**3, v, v * np.abs(v), dry, dry * x, v * x)
        state.applied_force[:, place.dof] += np.sum(values * np.stack(basis, 1), axis=1)

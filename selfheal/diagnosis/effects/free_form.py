"""What a torque of any form could still explain: the ceiling, and it has no name."""

import numpy as np

from ..data.robot_summary import RobotSummary
from .base import Effect, Parameter, Term


class FreeFormTorque(Effect):
    """A joint torque that is a smooth function of position, velocity and load."""

    name = "free_form"
    group = "unlisted"

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One at each joint."""
        return [
            Term(
                self,
                (f"joint:{j.name}",),
                ({"dof": j.dof, "qpos": j.qpos, "middle": j.range_center,
                  "range": j.range, "speed": j.speed},),
                tuple(
                    Parameter(name, j.force, 0.0, -3 * j.torque, 3 * j.torque,
                              0.1 * j.torque)
                    for name in BASIS
                ),
                ((0.0,) * len(BASIS),),
            )
            for j in robot.joints
        ]  # fmt: skip

    def apply_forces(self, state, place, values):
        x = 2 * (state.qpos[:, place["qpos"]] - place["middle"]) / place["range"]
        x = np.clip(x, -2, 2)
        v = np.clip(state.qvel[:, place["dof"]] / place["speed"], -4, 4)
        dry = np.tanh(10 * v)
        terms = (np.ones_like(x), x, x**2, x**3, v, v * np.abs(v), dry, dry * x, v * x)
        state.applied_force[:, place["dof"]] += np.sum(
            values * np.stack(terms, 1), axis=1
        )


BASIS = ("constant", "position", "position^2", "position^3", "velocity",
         "velocity |velocity|", "sign of velocity", "sign of velocity x position",
         "velocity x position")  # fmt: skip

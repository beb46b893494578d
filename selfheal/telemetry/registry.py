"""The checks of a log: their names, the faults that they find, their order."""

from collections.abc import Mapping
from typing import NamedTuple


class Check(NamedTuple):
    """A check: the name of its module in `checks`, and the kinds of faults it finds.

    Of each kind it is known whether physics is meaningless then.
    """

    name: str
    kinds: Mapping[str, bool]


COLUMNS = {"sign": True, "unit": True, "exchange": True}
# of single columns; the first two give the other checks a corrected recording
READINGS = (
    Check("zero_rows", {"zeros": True}),
    Check("common_units", {"unit": True}),
    Check("time_stamps", {"gap": False, "duplicate": False, "jitter": False}),
    Check("held_values", {"frozen": True, "saturated": False}),
    Check("repeated_readings", {"stale": False}),
)
# of the model: where one finds that physics is meaningless, no forces are looked at
SETUP = (
    Check("clock_drift", {"clock_drift": False}),
    Check(
        "model_setup",
        {"free_base": True, "actuator_type": True, "permanent_contact": False},
    ),
)
# of single episodes; the first that finds one decides
EPISODES = (
    Check("episode_columns", {"odd_episode": False}),
    Check("episode_torques", {"odd_episode": False}),
)
# of columns by kinematics, torques and simulations; each knows what those before found
MOTION = (
    Check("joint_columns", {**COLUMNS, "delay": False, "derivative": True}),
    Check("joint_torques", COLUMNS),
    Check("quaternion_orders", {"quaternion_order": True}),
    Check("joint_rollouts", COLUMNS),
    Check("bodies", {**COLUMNS, "sensor_frame": True}),
    Check("reported_torques", {**COLUMNS, "torque_is_command": False}),
    Check("ranges", {"joint_range": False, "command_range": False, "unit": True}),
    Check("missing_actuators", {"no_actuator": True}),
)
CHECKS = (*READINGS, *SETUP, *EPISODES, *MOTION)
KINDS: Mapping[str, bool] = {
    kind: meaningless for check in CHECKS for kind, meaningless in check.kinds.items()
}

"""Columns of ctrl: takes a model and the columns' names, gives whose commands they are.

A column is a control. MuJoCo's `nu` counts controls, and an actuator may have several,
as a <pid> has one for its position and one for its velocity, or none.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ..errors import RecordingError
from .data import Episode

if TYPE_CHECKING:
    import mujoco


class Control(NamedTuple):
    """One control of a model.

    Attributes:
        actuator: name of the actuator that it commands; empty: it has none.
        input: MuJoCo's name of what it commands there ("vel"); empty where it is the
            actuator's only control, or MuJoCo has no name.
    """

    actuator: str
    input: str

    @property
    def full_name(self) -> str:
        """What a column may be called beside the actuator's name."""
        return f"{self.actuator}_{self.input}" if self.input else self.actuator


def list_controls(model: "mujoco.MjModel") -> tuple[Control, ...]:
    """The controls (nu) of a model, in MuJoCo's order."""
    return tuple(
        Control(model.actuator(a).name, _find_input_name(model, a, k))
        for a in range(model.nactuator)
        for k in range(model.actuator_ctrlnum[a])
    )


def _find_input_name(model: "mujoco.MjModel", actuator: int, number: int) -> str:
    """MuJoCo's name of one of an actuator's controls, by its number among them."""
    import mujoco

    if model.actuator_ctrlnum[actuator] == 1:
        return ""
    return mujoco.mj_actuatorInputName(model, actuator, number) or ""


def find_controls(model: "mujoco.MjModel", actuator: int) -> tuple[int, ...]:
    """Indices into ctrl of an actuator's controls, by its id."""
    first, count = model.actuator_ctrladr[actuator], model.actuator_ctrlnum[actuator]
    return tuple(range(int(first), int(first + count)))


def find_joint(model: "mujoco.MjModel", actuator: int) -> int:
    """Id of the joint that an actuator drives, by its own id; -1: it drives none.

    What drives a tendon, a site or a body has the id of that where others have the id
    of a joint (MuJoCo, mjModel.actuator_trnid).
    """
    import mujoco

    kinds = mujoco.mjtTrn
    at_joint = (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)
    if kinds(model.actuator_trntype[actuator]) not in at_joint:
        return -1
    return int(model.actuator_trnid[actuator, 0])


def find_output(model: "mujoco.MjModel", actuator: int) -> int:
    """Index of an actuator's first force, by its id.

    It counts in actuator_force, actuator_length and actuator_gear: an actuator of a
    ball joint has three.
    """
    return int(model.actuator_outadr[actuator])


def assign_columns(names: Sequence[str], controls: Sequence[Control]) -> list[int]:
    """Number of the control that each column of ctrl is; -1: of none that is left.

    A column has the name of its actuator. Those of an actuator with several controls
    are in MuJoCo's order, or have its `full_name` each.

    `names` are those of the columns, `controls` those of the model.
    """
    left: dict[str, list[int]] = {}
    for i, control in enumerate(controls):
        left.setdefault(control.actuator, []).append(i)
    for i, control in enumerate(controls):
        left.setdefault(control.full_name, [i])
    return [left[name].pop(0) if left.get(name) else -1 for name in names]


def order_columns(names: Sequence[str], controls: Sequence[Control]) -> list[int]:
    """Column (nu) of each control; arguments as of `assign_columns`, and they fit."""
    assigned = assign_columns(names, controls)
    return [assigned.index(i) for i in range(len(controls))]


def reorder_commands(episode: Episode, model: "mujoco.MjModel") -> Episode:
    """The episode, which fits the model, with its columns in the order of the controls.

    Each is named by its `full_name`.
    """
    controls = list_controls(model)
    order = order_columns(episode.ctrl_names, controls)
    names = tuple(c.full_name for c in controls)
    return replace(episode, ctrl=episode.ctrl[:, order], ctrl_names=names)


def find_single_columns(
    names: Sequence[str], actuators: Sequence[str], where: str
) -> list[int]:
    """Columns of actuators that have one control each, whatever else there is.

    Raises:
        RecordingError: an actuator has no column, or several.
    """
    if missing := sorted(set(actuators) - set(names)):
        raise RecordingError(f"{where}: ctrl lacks {', '.join(missing)}")
    if several := sorted(a for a in actuators if names.count(a) > 1):
        raise RecordingError(
            f"{where}: ctrl has several columns for {', '.join(several)}; would fit: "
            "one each"
        )
    return [names.index(a) for a in actuators]

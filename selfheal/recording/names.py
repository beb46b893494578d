"""Names of a model: takes an MJCF or URDF, gives them and their units."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ModelError
from ..limited_reading import explain_dangerous
from ..mujoco_files import compile_file, explain_mesh, read_spec_file, refuse_xacro
from .controls import find_joint, list_controls
from .model import ModelNames, Target

if TYPE_CHECKING:
    import mujoco

_KNOWN = (".xml", ".urdf")  # ends of names, by which MuJoCo recognizes a file
# by MuJoCo's name of the sensor, without mjSENS_; a sensor that is not here may have
# any unit: MuJoCo does not say one
SENSOR_UNITS: Mapping[str, str] = {
    "ACCELEROMETER": "m/s^2",
    "BALLANGVEL": "rad/s",
    "BALLQUAT": "1",
    "CLOCK": "s",
    "FORCE": "N",
    "FRAMEANGACC": "rad/s^2",
    "FRAMEANGVEL": "rad/s",
    "FRAMELINACC": "m/s^2",
    "FRAMELINVEL": "m/s",
    "FRAMEPOS": "m",
    "FRAMEQUAT": "1",
    "FRAMEXAXIS": "1",
    "FRAMEYAXIS": "1",
    "FRAMEZAXIS": "1",
    "GEOMDIST": "m",
    "GYRO": "rad/s",
    "RANGEFINDER": "m",
    "SUBTREECOM": "m",
    "SUBTREELINVEL": "m/s",
    "TORQUE": "N m",
    "TOUCH": "N",
    "VELOCIMETER": "m/s",
}


def read_names(model: str | os.PathLike[str]) -> ModelNames:
    """The names, units and sizes of an MJCF or URDF file; errors as `load_model`."""
    return list_model_names(load_model(model))


def load_model(path: str | os.PathLike[str]) -> "mujoco.MjModel":
    """An MJCF or URDF file, compiled.

    Raises:
        ModelError: MuJoCo cannot load it; the message is MuJoCo's.
    """
    name = os.fspath(path)
    refuse_dangerous_model(name)
    try:
        model = compile_model(name)
    except (ValueError, OSError) as error:
        reason = " ".join(str(error).split()) or f"no reason was given for {name}"
        reason += explain_mesh(reason)
        raise ModelError(f"{name}: MuJoCo cannot load it: {reason}") from error
    if not 0 < (step := model.opt.timestep) < np.inf:
        raise ModelError(f"{name}: its timestep is {step:g} s; would fit: more than 0")
    return model


def refuse_dangerous_model(name: str) -> None:
    """Refuse macros of xacro, and a file whose reading ends or outlasts a process.

    Raises:
        ModelError: it is one.
    """
    refuse_xacro(name)
    if reason := explain_dangerous(name, f"{__name__}:compile_model", "mujoco"):
        raise ModelError(f"{name}: {reason}")


def compile_model(name: str) -> "mujoco.MjModel":
    """An MJCF or URDF file, compiled, whatever that does to the process.

    Raises:
        ValueError: MuJoCo's, of what it cannot read.
    """
    if name.endswith(_KNOWN):
        return compile_file(name)
    return read_spec(name).compile()


def read_spec(path: str | os.PathLike[str]) -> "mujoco.MjSpec":
    """An MJCF or URDF file, whatever its name ends in.

    Raises:
        ValueError: MuJoCo's, of what it cannot read.
    """
    name = os.fspath(path)
    if name.endswith(_KNOWN):
        return read_spec_file(name)
    beside = f"{name}.xml"  # the same text, from where the same files are found
    return read_spec_file(beside, include={beside: Path(name).read_bytes()})


def list_model_names(model: "mujoco.MjModel") -> ModelNames:
    """What a compiled model gives to command and to measure.

    Free and ball joints have no signal.
    """
    targets = {
        "joint": {
            model.joint(j).name: Target(units, range=_get_range(model, j))
            for j in range(model.njnt)
            if (units := _find_joint_units(model, j))
        },
        "actuator": {
            model.actuator(a).name: Target(
                _find_force_units(model, a),
                range=_get_range(model, find_joint(model, a)),
            )
            for a in range(model.nactuator)
        },
        "body": {model.body(b).name: Target({}) for b in range(model.nbody)},
        "sensor": {
            model.sensor(s).name: _describe_sensor(model, s)
            for s in range(model.nsensor)
        },
    }
    # what has no name cannot be referred to
    for things in targets.values():
        things.pop("", None)
    unnamed = model.nactuator - len(targets["actuator"])
    return ModelNames(targets, list_controls(model), unnamed, model.nq, model.nv)


def _get_range(model: "mujoco.MjModel", joint: int) -> tuple[float, float] | None:
    """Limits of a joint [rad or m]; None where it has none, or there is no joint."""
    if joint < 0 or not model.jnt_limited[joint]:
        return None
    low, high = (float(x) for x in model.jnt_range[joint])
    return low, high


def _find_joint_units(model: "mujoco.MjModel", joint: int) -> dict[str, str]:
    import mujoco

    kind = mujoco.mjtJoint(model.jnt_type[joint])
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        return {"joint_position": "rad", "joint_velocity": "rad/s"}
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return {"joint_position": "m", "joint_velocity": "m/s"}
    return {}


def _find_force_units(model: "mujoco.MjModel", actuator: int) -> dict[str, str]:
    joint = find_joint(model, actuator)
    units = _find_joint_units(model, joint) if joint >= 0 else {}
    force = {"rad": "N m", "m": "N"}.get(units.get("joint_position", ""))
    return {"joint_torque": force} if force else {}


def _describe_sensor(model: "mujoco.MjModel", sensor: int) -> Target:
    import mujoco

    kind = mujoco.mjtSensor(model.sensor_type[sensor]).name.removeprefix("mjSENS_")
    unit = SENSOR_UNITS.get(kind)
    if kind in ("JOINTPOS", "JOINTVEL"):
        units = _find_joint_units(model, model.sensor_objid[sensor])
        unit = units["joint_position" if kind == "JOINTPOS" else "joint_velocity"]
    width = int(model.sensor_dim[sensor])
    return Target({"sensor": unit} if unit else {}, 0 if width == 1 else width)

"""Sensors: takes fields of a batch of simulations, gives the true signals."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...recording import find_output
from ...recording.data import Floats
from ..data.robot_summary import Channel
from ..effects.base import Term
from ..effects.places import AddedJointPlace, SecondJointPlace
from .model_variants import ModelVariant

if TYPE_CHECKING:
    from mujoco import MjModel

STAGE_VELOCITY, STAGE_ACCELERATION = 2, 3  # mjtStage
CONTACTS_DISABLED = 1 << 4  # mjtDisableBit
NO_NOISE = np.zeros((3, 1))  # scatter, noise and autocorrelation of a true signal
Fields = Mapping[str, Floats]


class SensorReader:
    """Reads channels from the fields of a batch.

    Attributes:
        needs: names of the fields that it reads, beside qpos and qvel.
        width: how many columns all channels have.
        rates: indices into sensordata of what depends on velocities (a gyroscope).
        is_touching: whether contacts are looked for.
        accelerations: indices into sensordata of what depends on accelerations; none
            where things touch: contacts change these more than half a step does.
    """

    def __init__(
        self,
        variant: ModelVariant,
        channels: Sequence[Channel],
        terms: Sequence[Term] = (),
    ) -> None:
        """Find where the channels are in a model's fields.

        Args:
            variant: of the model that is simulated.
            terms: effects, of which one may say that an encoder sits behind a gap or a
                spring.
        """
        self.width = sum(c.width for c in channels)
        self.needs: set[str] = set()
        self._readers: list[tuple[slice, Callable[[Fields], Floats]]] = []
        model, link_joints = variant.model, _find_link_joints(variant, terms)
        sensors = [model.sensor(c.target).id for c in channels if c.kind == "sensor"]
        self.rates = _find_sensor_rows(model, sensors, STAGE_VELOCITY)
        self.is_touching = not model.opt.disableflags & CONTACTS_DISABLED
        self.accelerations = _find_sensor_rows(
            model, [] if self.is_touching else sensors, STAGE_ACCELERATION
        )
        for c in channels:
            needs, read = _make_reader(model, c, link_joints)
            self.needs |= needs
            self._readers.append((c.columns, read))

    def read_all(self, fields: Fields) -> Floats:
        """Read signals (A, B, width) [each channel's unit] of fields (A, B, ...).

        MuJoCo computes a step's other fields for the state before the step, so qpos and
        qvel must be of that state, too.
        """
        out = np.empty((*fields["qpos"].shape[:2], self.width))
        for columns, read in self._readers:
            out[..., columns] = read(fields)
        return out


def _find_sensor_rows(
    model: "MjModel", sensors: Sequence[int], stage: int
) -> np.ndarray:
    """Indices into sensordata of those sensors that need a stage of a step (mjtStage).

    None where the model delays sensors: these give what was some steps before.
    """
    if model.nhistory:
        return np.zeros(0, int)
    at_stage = [s for s in sensors if model.sensor_needstage[s] == stage]
    each = [model.sensor_adr[s] + np.arange(model.sensor_dim[s]) for s in at_stage]
    return np.concatenate([np.zeros(0, int), *each])


def make_added_joint_channels(places: Sequence[AddedJointPlace]) -> list[Channel]:
    """Make channels of the position and velocity of each place's added joint."""
    channels: list[Channel] = []
    for name in (place.added_name for place in places):
        for kind in ("joint_position", "joint_velocity"):
            first = len(channels)
            channels.append(
                Channel(name, kind, name, "", 1, first, 1.0, 1.0, 0.0, *NO_NOISE)
            )
    return channels


def _find_link_joints(variant: ModelVariant, terms: Sequence[Term]) -> dict[str, int]:
    """Added joint's id by the name of each joint whose encoder is at the link."""
    return {
        variant.model.joint(place.joint).name: place.added_joint
        for place in variant.list_added_joints(terms)
        if isinstance(place, SecondJointPlace) and place.is_read_behind
    }


def _make_reader(
    model: "MjModel", c: Channel, link_joints: Mapping[str, int]
) -> tuple[set[str], Callable]:
    """Fields that a channel needs, and what reads it (A, B, width) from them."""
    if c.kind in ("joint_position", "joint_velocity"):
        return set(), _make_joint_reader(model, c, link_joints)
    if c.kind == "joint_torque":
        out = find_output(model, model.actuator(c.target).id)
        gear = float(model.actuator_gear[out, 0])
        return {"actuator_force"}, lambda b: gear * b["actuator_force"][..., [out]]
    if c.kind == "sensor":
        s = model.sensor(c.target)
        rows = slice(int(s.adr[0]), int(s.adr[0]) + int(s.dim[0]))
        return {"sensordata"}, lambda b: b["sensordata"][..., rows]
    return _make_body_reader(model, c)


def _make_joint_reader(
    model: "MjModel", c: Channel, link_joints: Mapping[str, int]
) -> Callable:
    """What reads a joint: alone or, at the link, as the sum with the added joint."""
    joint = model.joint(c.target)
    field, address = (
        ("qpos", "qposadr") if c.kind == "joint_position" else ("qvel", "dofadr")
    )
    at = int(getattr(joint, address)[0])
    if c.target not in link_joints:
        return lambda b: b[field][..., [at]]
    extra = int(getattr(model.joint(link_joints[c.target]), address)[0])
    return lambda b: b[field][..., [at]] + b[field][..., [extra]]


def _make_body_reader(model: "MjModel", c: Channel) -> tuple[set[str], Callable]:
    """Fields that a body's channel needs, and what reads it from them.

    MuJoCo's cvel is (omega, v) in global axes, at the center of mass of the body's
    kinematic tree. A body's origin x moves with v + omega x (x - x_com).
    """
    i = model.body(c.target).id
    root = int(model.body_rootid[i])
    if c.kind == "body_position":
        return {"xpos"}, lambda b: b["xpos"][..., i, :]
    if c.kind == "body_orientation":
        return {"xquat"}, lambda b: b["xquat"][..., i, :]
    if c.kind == "body_angular_velocity":
        return {"cvel", "xmat"}, lambda b: np.einsum(
            "abji,abj->abi",
            b["xmat"][..., i, :].reshape(*b["xmat"].shape[:2], 3, 3),
            b["cvel"][..., i, :3],
        )
    return (
        {"cvel", "xpos", "subtree_com"},
        lambda b: (
            b["cvel"][..., i, 3:]
            + np.cross(
                b["cvel"][..., i, :3],
                b["xpos"][..., i, :] - b["subtree_com"][..., root, :],
            )
        ),
    )

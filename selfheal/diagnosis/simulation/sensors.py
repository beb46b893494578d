"""The true signals of a batch of simulations, in the columns of the channels."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import Channel
from ..effects.base import Term
from .model_variants import ModelVariant

NO_NOISE = np.zeros((3, 1))
Bound = Mapping[str, Floats]


class SensorReader:
    """Reads channels from a batch.

    Attributes:
        needs: fields of the batch that must be bound.
        width: columns of all channels.
        rates, accelerations: rows of sensordata that tell velocities (a gyroscope's),
            and accelerations.
    """

    def __init__(
        self, variant: ModelVariant, signals: Sequence[Channel], terms=()
    ) -> None:
        """`terms` may say that an encoder sits behind a gap or a spring."""
        self.width = sum(c.width for c in signals)
        self.needs: set[str] = set()
        self._readers: list[tuple[slice, Callable[[Bound], Floats]]] = []
        behind = _find_link_joints(variant, terms)
        own = [variant.model.sensor(c.target).id for c in signals if c.kind == "sensor"]
        self.rates, self.accelerations = (
            _find_sensor_rows(variant.model, own, stage)
            for stage in (2, 3)  # mjtStage
        )
        for c in signals:
            needs, read = _make_reader(variant, c, behind)
            self.needs |= needs
            self._readers.append((c.columns, read))

    def read_all(self, seen: Bound) -> Floats:
        """Signals (A, B, width) of fields (A, B, ...) of states.

        What a step computes is of the state before it, as its position and velocity are
        to be.
        """
        shape = next(iter(seen.values())).shape[:2]
        out = np.empty((shape[0] * shape[1], self.width))
        flat = {k: v.reshape(len(out), *v.shape[2:]) for k, v in seen.items()}
        for columns, read in self._readers:
            out[:, columns] = read(flat)
        return out.reshape(*shape, self.width)


def _find_sensor_rows(model, sensors: Sequence[int], stage: int) -> np.ndarray:
    """Rows of sensordata of those sensors that are computed at a stage of a step."""
    if model.nhistory:  # they tell what was
        return np.zeros(0, int)
    own = [s for s in sensors if model.sensor_needstage[s] == stage]
    each = [model.sensor_adr[s] + np.arange(model.sensor_dim[s]) for s in own]
    return np.concatenate([np.zeros(0, int), *each])


def make_second_joint_channels(variant: ModelVariant, places) -> list[Channel]:
    """Position and velocity of the second joint of each place, as signals."""
    found: list[Channel] = []
    for place in places:
        name = variant.model.joint(place["extra_jnt"]).name
        for kind in ("joint_position", "joint_velocity"):
            found.append(
                Channel(name, kind, name, "", 1, len(found), 1.0, 1.0, 0.0, *NO_NOISE)
            )
    return found


def _find_link_joints(variant: ModelVariant, terms: Sequence[Term]) -> dict[str, int]:
    """Second joint of each joint whose position is read behind it."""
    places = [variant.map_place(p) for t in terms for p in t.places if "suffix" in p]
    return {
        variant.model.joint(p["joint"]).name: p["extra_jnt"]
        for p in places
        if p["side"] == "link"
    }


def _make_reader(
    variant: ModelVariant, c: Channel, behind
) -> tuple[set[str], Callable]:
    model = variant.model
    if c.kind in ("joint_position", "joint_velocity"):
        return set(), _make_joint_reader(model, c, behind)
    if c.kind == "joint_torque":
        a = model.actuator(c.target).id
        gear = float(model.actuator_gear[a, 0])
        return {"actuator_force"}, lambda b: gear * b["actuator_force"][:, [a]]
    if c.kind == "sensor":
        s = model.sensor(c.target)
        rows = slice(int(s.adr[0]), int(s.adr[0]) + int(s.dim[0]))
        return {"sensordata"}, lambda b: b["sensordata"][:, rows]
    return _make_body_reader(model, c)


def _make_joint_reader(model, c: Channel, behind) -> Callable:
    joint = model.joint(c.target)
    field, address = (
        ("qpos", "qposadr") if c.kind == "joint_position" else ("qvel", "dofadr")
    )
    at = int(getattr(joint, address)[0])
    if c.target not in behind:
        return lambda b: b[field][:, [at]]
    extra = int(getattr(model.joint(behind[c.target]), address)[0])
    return lambda b: b[field][:, [at]] + b[field][:, [extra]]


def _make_body_reader(model, c: Channel) -> tuple[set[str], Callable]:
    i = model.body(c.target).id
    root = int(model.body_rootid[i])
    if c.kind == "body_position":
        return {"xpos"}, lambda b: b["xpos"][:, i]
    if c.kind == "body_orientation":
        return {"xquat"}, lambda b: b["xquat"][:, i]
    if c.kind == "body_angular_velocity":
        return {"cvel", "xmat"}, lambda b: np.einsum(
            "nji,nj->ni", b["xmat"][:, i].reshape(-1, 3, 3), b["cvel"][:, i, :3]
        )
    # cvel is of the point that coincides with the tree's center of mass
    return (
        {"cvel", "xpos", "subtree_com"},
        lambda b: (
            b["cvel"][:, i, 3:]
            + np.cross(b["cvel"][:, i, :3], b["xpos"][:, i] - b["subtree_com"][:, root])
        ),
    )

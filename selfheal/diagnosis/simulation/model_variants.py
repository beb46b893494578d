"""The model as a hypothesis has it: takes terms and values, gives compiled models."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...recording import load_model, read_spec
from ...recording.data import Floats
from ..effects.base import Term, implements

if TYPE_CHECKING:
    import mujoco

_RK4, _IMPLICITFAST = 1, 3  # mujoco.mjtIntegrator
# kept apart for joints and degrees of freedom: an added joint shifts what follows it
_JOINT_KEYS = ("joint",)
_DOF_KEYS = ("dof", "other_dof")
_QPOS_KEYS = ("qpos", "other_qpos")


@dataclass(frozen=True, eq=False)
class ModelVariant:
    """A compiled model with the joints that some terms add.

    Attributes:
        model: compiled; warnings do not reset a diverged state.
        dof: (nv of the given model) where its degrees of freedom are now.
        qpos: (nq of the given model) where its positions are now.
        joint: (njnt of the given model) where its joints are now.
    """

    model: "mujoco.MjModel"
    dof: np.ndarray
    qpos: np.ndarray
    joint: np.ndarray

    @property
    def is_single_stage(self) -> bool:
        """Whether a step has one stage, so that it can be read as a leapfrog's."""
        return bool(self.model.opt.integrator != _RK4)

    def map_place(self, place: Mapping[str, Any]) -> dict[str, Any]:
        """A term's place, as this model numbers it."""
        out = dict(place)
        for keys, new in (
            (_JOINT_KEYS, self.joint), (_DOF_KEYS, self.dof), (_QPOS_KEYS, self.qpos)
        ):  # fmt: skip
            for key in keys:
                if key in out and out[key] >= 0:
                    out[key] = int(new[out[key]])
        if "suffix" in out:
            name = self.model.joint(out["joint"]).name + out["suffix"]
            extra = self.model.joint(name)
            out |= {
                "extra_jnt": extra.id,
                "extra_dof": int(extra.dofadr[0]),
                "extra_qpos": int(extra.qposadr[0]),
            }
        return out

    def build_model(self, terms: Sequence[Term], values: Floats) -> "mujoco.MjModel":
        """The model in which the terms, with all their values in a row, are true."""
        return self.build_models(terms, values[None])[0]

    def build_models(
        self, terms: Sequence[Term], values: Floats
    ) -> list["mujoco.MjModel"]:
        """The same of several rows of values (n, P)."""
        import mujoco

        shares = split_values(terms, values)
        alike = [bool((s == s[0]).all()) for s in shares]
        same = alike.index(False) if False in alike else len(terms)
        base = self._edit_copy(self.model, terms[:same], [s[0] for s in shares[:same]])
        models = [
            self._edit_copy(base, terms[same:], own)
            for own in ([s[i] for s in shares[same:]] for i in range(len(values)))
        ]
        for model in models:
            mujoco.mj_setConst(model, self.scratch_data)
        return models

    def _edit_copy(self, model, terms: Sequence[Term], shares: Sequence[Floats]):
        """A copy of a model in which terms, each with its values, are true."""
        model = copy.copy(model)
        for term, part in zip(terms, shares, strict=True):
            if implements(term.effect, "edit_model"):
                for place in term.places:
                    term.effect.edit_model(model, self.map_place(place), part)
        return model

    @cached_property
    def scratch_data(self) -> "mujoco.MjData":
        """Room for computations about the model."""
        import mujoco

        return mujoco.MjData(self.model)

    @cached_property
    def nominal_fields(self) -> dict[str, bytes]:
        """What the model says in each field that an edit may change."""
        from mujoco.batch import MODEL_FIELDS

        key = ("actuator_", "body_", "dof_", "geom_", "jnt_", "qpos", "site_", "opt.")
        said = {
            f: read_model_field(self.model, f)
            for f in MODEL_FIELDS
            if f.startswith(key)
        }
        return {f: v.tobytes() for f, v in said.items() if v is not None and v.size}


def read_model_field(model, name: str):
    """A field of a compiled model by its name in `mujoco.batch`; None if missing."""
    if name.startswith("opt."):
        return np.array(getattr(model.opt, name[4:]))
    return getattr(model, name, None)


def split_values(terms: Sequence[Term], values: Floats) -> list[Floats]:
    """Values (..., P) of all terms, parted into each one's (..., p)."""
    ends = np.cumsum([len(t.parameters) for t in terms], dtype=int)
    return np.split(values, ends, axis=-1)[:-1]


@dataclass(frozen=True, eq=False)
class ModelCompiler:
    """Compiles variants of one model; the same structure is compiled once.

    Attributes:
        path: of the MJCF or URDF.
        nominal: the model as given, compiled.

    Raises:
        ModelError: MuJoCo cannot load the model.
    """

    path: str
    nominal: "mujoco.MjModel" = field(init=False)
    _compiled: dict[tuple, ModelVariant] = field(
        init=False, default_factory=dict, compare=False
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "nominal", load_model(self.path))

    def compile_variant(
        self, terms: Sequence[Term], *, leaping: bool = False
    ) -> ModelVariant:
        """A model with the joints that these terms need.

        Args:
            terms: of a hypothesis.
            leaping: whether a four-stage integrator is to become a one-stage one;
                not where joints' velocities bear on each other.
        """
        adds = [t for t in terms if implements(t.effect, "edit_spec")]
        given = self.nominal
        leaping = leaping and given.opt.integrator == _RK4 and given.nv == 1
        key = (leaping, *((t.effect.name, t.targets) for t in adds))
        if key not in self._compiled:
            self._compiled[key] = self._compile(adds)
            if leaping:
                self._compiled[key].model.opt.integrator = _IMPLICITFAST
        return self._compiled[key]

    def _compile(self, adds: Sequence[Term]) -> ModelVariant:
        import mujoco

        from ...body.mjcf import ignore_warnings

        ignore_warnings()
        spec = read_spec(self.path)
        given = self.nominal
        # the last joint first: an added one shifts what follows it
        sites = [(t.effect, place) for t in adds for place in t.places]
        for effect, place in sorted(sites, key=lambda s: -s[1]["joint"]):
            effect.edit_spec(spec, place)
        _disable_simple_bodies(spec)
        model = spec.compile()
        model.opt.disableflags |= int(
            mujoco.mjtDisableBit.mjDSBL_AUTORESET
            | mujoco.mjtDisableBit.mjDSBL_MIDPHASE  # its boxes do not follow an edit
        )
        joint = np.array(_match_joints(given, model), int)
        dof, qpos = np.zeros(given.nv, int), np.zeros(given.nq, int)
        for old, new in enumerate(joint):
            width = {0: (7, 6), 1: (4, 3)}.get(int(given.jnt_type[old]), (1, 1))
            a, b = given.jnt_qposadr[old], model.jnt_qposadr[new]
            qpos[a : a + width[0]] = np.arange(b, b + width[0])
            a, b = given.jnt_dofadr[old], model.jnt_dofadr[new]
            dof[a : a + width[1]] = np.arange(b, b + width[1])
        return ModelVariant(model, dof, qpos, joint)


def _match_joints(given, model) -> list[int]:
    """Where each joint of the given model is in the new one."""
    own = {given.joint(j).name for j in range(given.njnt)}
    return [j for j in range(model.njnt) if model.joint(j).name in own]


def _disable_simple_bodies(spec) -> None:
    """Keep room for inertia off the diagonal, so that a center of mass can be moved."""
    for body in spec.bodies[1:]:
        body.simple = 0

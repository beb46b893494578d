"""Model variants: takes terms and values, gives compiled models of hypotheses."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...mujoco_files import delete_unused_meshes, list_visual_meshes
from ...recording import load_model, read_spec
from ...recording.data import Floats
from ..effects.base import Term
from ..effects.places import AddedJointPlace, JointPlace, Numbering
from ..effects.protocols import JointAddition, ModelEdit

if TYPE_CHECKING:
    import mujoco

_RK4, _IMPLICITFAST = 1, 3  # mujoco.mjtIntegrator
INERTIA_POSES = 8  # in which joints' inertia is looked at; chosen
# what fields of MjModel begin with that effects edit, or that follow from an edit
_EDITED_FIELDS = (
    "actuator_",
    "body_",
    "dof_",
    "eq_",
    "geom_",
    "jnt_",
    "qpos",
    "site_",
    "tendon_",
    "opt.",
)
# those of them that go by what is a mesh, and that no edit changes
_MESH_FIELDS = "geom_type", "geom_dataid", "geom_aabb", "body_bvhadr", "body_bvhnum"


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelVariant(Numbering):
    """A compiled model with the joints that some terms add.

    Attributes:
        twin: the same with boxes in place of meshes, to copy and to edit; it touches
            otherwise.
    """

    twin: "mujoco.MjModel"

    @property
    def is_single_stage(self) -> bool:
        """Whether the integrator has one stage, so that a step can be a leapfrog's."""
        return bool(self.model.opt.integrator != _RK4)

    def list_added_joints(self, terms: Sequence[Term]) -> list[AddedJointPlace]:
        """Where terms add joints, as this model numbers them."""
        places = [place for term in terms for place in term.places]
        return [p.renumber(self) for p in places if isinstance(p, AddedJointPlace)]

    def build_model(self, terms: Sequence[Term], values: Floats) -> "mujoco.MjModel":
        """Build the model of one hypothesis, with values (P) of all terms."""
        return self.build_models(terms, values[None])[0]

    def build_models(
        self, terms: Sequence[Term], values: Floats
    ) -> list["mujoco.MjModel"]:
        """Build the models of n hypotheses, with values (n, P) of all terms.

        They are copies of the twin. Terms before the first whose values differ are
        edited once for all of them.
        """
        import mujoco

        term_values = split_values(terms, values)
        is_common = [bool((v == v[0]).all()) for v in term_values]
        common = is_common.index(False) if False in is_common else len(terms)
        base = self._edit_copy(
            self.twin, terms[:common], [v[0] for v in term_values[:common]]
        )
        models = [
            self._edit_copy(base, terms[common:], [v[i] for v in term_values[common:]])
            for i in range(len(values))
        ]
        for model in models:
            mujoco.mj_setConst(model, self.scratch_data)
        return models

    def _edit_copy(
        self,
        model: "mujoco.MjModel",
        terms: Sequence[Term],
        term_values: Sequence[Floats],
    ) -> "mujoco.MjModel":
        """Copy a model and edit the copy by terms, each with its values (p)."""
        model = copy.copy(model)
        for term, values in zip(terms, term_values, strict=True):
            if isinstance(term.effect, ModelEdit):
                for place in term.places:
                    term.effect.edit_model(model, place.renumber(self), values)
        return model

    @cached_property
    def scratch_data(self) -> "mujoco.MjData":
        """An MjData for computations about the model; its content means nothing."""
        import mujoco

        return mujoco.MjData(self.model)

    @cached_property
    def inverse_inertias(self) -> Floats:
        """(k, nv, nv) of the joints in k poses; see `compute_inverse_inertias`."""
        return compute_inverse_inertias(self.model)

    @cached_property
    def nominal_fields(self) -> dict[str, bytes]:
        """Bytes of each field of the twin that an effect's edit may change."""
        values = {name: read_model_field(self.twin, name) for name in _list_edited()}
        if self.twin is not self.model:
            values |= dict.fromkeys(_MESH_FIELDS)
        return {k: v.tobytes() for k, v in values.items() if v is not None and v.size}


def compute_inverse_inertias(model: "mujoco.MjModel") -> Floats:
    """(k, nv, nv) inverse of the joints' inertia matrix, in k poses."""
    import mujoco

    data, rng, found = mujoco.MjData(model), np.random.default_rng(0), []
    for size in (0.0, *(INERTIA_POSES - 1) * [1.0]):
        data.qpos[:] = model.qpos0
        offset = size * rng.normal(size=model.nv)
        mujoco.mj_integratePos(model, data.qpos, offset, 1.0)
        mujoco.mj_fwdPosition(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        found.append(np.linalg.inv(inertia))
    return np.array(found)


def _list_edited() -> list[str]:
    """Names in `mujoco.batch` of the fields that effects may edit."""
    from mujoco.batch import MODEL_FIELDS

    return [name for name in MODEL_FIELDS if name.startswith(_EDITED_FIELDS)]


def read_model_field(model: "mujoco.MjModel", name: str) -> np.ndarray | None:
    """Read a field of a compiled model by its name in `mujoco.batch`; None: missing."""
    if name.startswith("opt."):
        return np.array(getattr(model.opt, name[4:]))
    return getattr(model, name, None)


def split_values(terms: Sequence[Term], values: Floats) -> list[Floats]:
    """Split values (..., P) of all terms into those (..., p) of each."""
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

    def compile_variant(self, terms: Sequence[Term]) -> ModelVariant:
        """Compile the model with the joints that terms add."""
        return self._find_variant(terms, leaping=False, touching=True)

    def compile_leapfrog(
        self, terms: Sequence[Term], *, touching: bool
    ) -> ModelVariant:
        """Compile the model with the joints that terms add, for a leapfrog.

        The RK4 of a single joint, whose velocity acts on no other, becomes a one-stage
        integrator.

        Args:
            touching: whether contacts are looked for, which may take half of the time.
        """
        return self._find_variant(terms, leaping=True, touching=touching)

    def _find_variant(
        self, terms: Sequence[Term], *, leaping: bool, touching: bool
    ) -> ModelVariant:
        """The variant of these terms and options; compiled where it is not yet."""
        import mujoco

        given = self.nominal
        leaping = leaping and given.opt.integrator == _RK4 and given.nv == 1
        adding = [
            (t.effect, place)
            for t in terms
            for place in t.places
            if isinstance(t.effect, JointAddition)
            and isinstance(place, AddedJointPlace)
        ]
        key = (leaping, touching, *((e.name, p.added_name) for e, p in adding))
        if key not in self._compiled:
            variant = self._compiled[key] = self._compile(adding)
            for options in (variant.model.opt, variant.twin.opt):
                if leaping:
                    options.integrator = _IMPLICITFAST
                if not touching:
                    options.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        return self._compiled[key]

    def _compile(
        self, adding: Sequence[tuple[JointAddition, AddedJointPlace]]
    ) -> ModelVariant:
        """Compile the model with the joints of effects that edit its MjSpec."""
        import mujoco

        spec = read_spec(self.path)
        given = self.nominal
        _replace_visual_meshes(spec, given)
        # the last joint first: an added one shifts what follows it
        for effect, place in sorted(adding, key=lambda each: -_find_joint(each[1])):
            effect.edit_spec(spec, place)
        _prepare_bodies(spec)
        spec.option.disableflags |= int(
            mujoco.mjtDisableBit.mjDSBL_AUTORESET
            | mujoco.mjtDisableBit.mjDSBL_MIDPHASE  # its boxes do not follow an edit
        )
        model = spec.compile()
        if not model.nmesh:  # what MuJoCo keeps of the given one's is read no more
            mujoco.mj_clearCache(mujoco.mj_getCache())
        model.body_gravcomp[:] = given.body_gravcomp
        twin = _compile_twin(spec, model)
        joint = np.array(_match_joints(given, model), int)
        dof, qpos = np.zeros(given.nv, int), np.zeros(given.nq, int)
        for old, new in enumerate(joint):
            # sizes in qpos and qvel of mjtJoint: free, ball; slide and hinge
            nq, nv = {0: (7, 6), 1: (4, 3)}.get(int(given.jnt_type[old]), (1, 1))
            a, b = given.jnt_qposadr[old], model.jnt_qposadr[new]
            qpos[a : a + nq] = np.arange(b, b + nq)
            a, b = given.jnt_dofadr[old], model.jnt_dofadr[new]
            dof[a : a + nv] = np.arange(b, b + nv)
        return ModelVariant(model=model, twin=twin, dof=dof, qpos=qpos, joint=joint)


def _find_joint(place: AddedJointPlace) -> int:
    """Id of the joint behind which another one is added; -1: it is added to a body."""
    return place.joint if isinstance(place, JointPlace) else -1


def _replace_visual_meshes(spec: "mujoco.MjSpec", given: "mujoco.MjModel") -> None:
    """Put boxes in place of meshes that are only seen: each model copies all vertices.

    All geoms keep their ids.
    """
    geoms = spec.geoms
    for g in list_visual_meshes(spec):
        _become_box(geoms[g], given, g)
    delete_unused_meshes(spec)


def _become_box(geom: "mujoco.MjsGeom", compiled: "mujoco.MjModel", g: int) -> None:
    """Make a mesh a box, where the g-th geom of a compiled model has it."""
    import mujoco

    geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_BOX, ""
    geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    geom.pos, geom.quat = compiled.geom_pos[g], compiled.geom_quat[g]
    geom.size = compiled.geom_size[g]


def _compile_twin(spec: "mujoco.MjSpec", model: "mujoco.MjModel") -> "mujoco.MjModel":
    """A model with boxes in place of meshes, whose copies are small.

    All that an effect may edit is as in the model.
    """
    import mujoco

    if not model.nmesh or model.nskin or model.nflex or (model.geom_plugin >= 0).any():
        return model
    for g, geom in enumerate(spec.geoms):
        if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH:
            _become_box(geom, model, g)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    twin = spec.compile()
    for name in _list_edited():
        value = read_model_field(twin, name)
        if not (name.startswith("opt.") or name in _MESH_FIELDS or value is None):
            value[...] = read_model_field(model, name)
    return twin


def _match_joints(given: "mujoco.MjModel", model: "mujoco.MjModel") -> list[int]:
    """Ids in a new model of the given model's joints, in their order."""
    names = {given.joint(j).name for j in range(given.njnt)}
    return [j for j in range(model.njnt) if model.joint(j).name in names]


def _prepare_bodies(spec: "mujoco.MjSpec") -> None:
    """Make MuJoCo compute full inertias and carried weight, which effects change."""
    for body in spec.bodies[1:]:
        body.simple = 0
        body.gravcomp = 1.0  # a model in which none has any skips it

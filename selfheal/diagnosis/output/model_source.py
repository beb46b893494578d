"""A model's text as MuJoCo reads it: takes its path, gives what its elements state."""

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias
from uuid import uuid4

import numpy as np

from ...errors import ModelError
from ...mjcf.edit import Edit, apply_edits, format_number, list_tags
from ...mjcf.xml_text import encode_text
from ...mujoco_files import read_spec_file
from ...recording.data import Floats

if TYPE_CHECKING:
    from mujoco import MjModel, MjsBody, MjsFrame, MjsGeom, MjsOrientation, MjSpec
    from numpy.typing import ArrayLike

    Element: TypeAlias = MjsBody | MjsFrame | MjsGeom

INERTIA_FROM_GEOM = 1  # mjtInertiaFromGeom: true
QUATERNION = 0  # mjtOrientation
# relative change, and size of a value, below which two values are one; chosen: the
# last digits that a text has
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 1e-9, 1e-6

Attributes = dict[str, str | None]  # None takes one away


class ModelSource:
    """What the text of a model states and a compiled model does not.

    Attributes:
        spec: of the text.
        degree: whether the text has angles of hinges in degrees.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """`path`: of the MJCF or URDF."""
        self.spec = compile_patched(path, ())
        self.degree = bool(self.spec.compiler.degree)
        self._actuators = list_tags(path, "actuator")

    def actuator_tag(self, name: str, index: int) -> str:
        """The tag of an actuator ("position"), by its name or else its id."""
        named = [tag for n, tag in self._actuators if name and n == name]
        unnamed = [tag for _, tag in self._actuators[index : index + 1]]
        return (named or unnamed or ["general"])[0]

    def states_inertia(self, body: int) -> bool:
        """Whether a body, by its id, has an <inertial>."""
        return bool(self.spec.bodies[body].explicitinertial)

    @property
    def overrides_masses(self) -> bool:
        """Whether the compiler replaces the masses that the bodies state."""
        always = int(self.spec.compiler.inertiafromgeom) == INERTIA_FROM_GEOM
        return always or self.scales_masses

    @property
    def scales_masses(self) -> bool:
        """Whether the compiler scales all masses to a total."""
        return bool(self.spec.compiler.settotalmass > 0)

    def resolve_orientation(self, quat: Floats, alt: "MjsOrientation") -> Floats:
        """The quaternion (4) of an element by its `quat` (4), or its other form."""
        if int(alt.type) == QUATERNION:
            return np.array(quat) / np.linalg.norm(quat)
        compiler = self.spec.compiler
        turned = self.spec.resolve_orientation(
            degree=compiler.degree, sequence=compiler.eulerseq, orientation=alt
        )
        return np.array(turned)

    def resolve_frame(self, element: "Element") -> tuple[Floats, Floats]:
        """Position (3) [m] and quaternion (4) of the <frame>s around an element."""
        import mujoco

        place, turn = np.zeros(3), np.array([1.0, 0, 0, 0])
        while element.frame is not None:
            element = element.frame
            its = self.resolve_orientation(element.quat, element.alt)
            mujoco.mju_rotVecQuat(place, place.copy(), its)
            place += element.pos
            mujoco.mju_mulQuat(turn, its, turn.copy())
        return place, turn


def compile_patched(path: str | os.PathLike[str], changes: Sequence[Edit]) -> "MjSpec":
    """The edited text, compiled, so that its elements have ids.

    Args:
        path: of the MJCF or URDF.

    Raises:
        ModelError: an edit speaks of what has no text, or MuJoCo refuses the new one.
    """
    with tempfile.TemporaryDirectory() as folder:
        # a name that no file has which the text attaches: it would attach itself
        new = Path(folder) / f"{uuid4().hex}.xml"
        text = apply_edits(path, changes, folder)  # of a URDF its MJCF
        new.write_bytes(encode_text(text))
        try:
            spec = read_spec_file(new)
            spec.compile()
        except ValueError as error:
            said = " ".join(str(error).split())
            raise ModelError(f"MuJoCo refuses the patch: {said}") from error
    return spec


def is_same_model(one: "MjSpec", other: "MjSpec") -> bool:
    """Whether two specifications compile to the same numbers and names."""
    import mujoco

    saved = []
    for spec in (one, other):
        model = spec.compile()
        numbers = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, numbers)
        saved.append(numbers.tobytes())
    return saved[0] == saved[1]


def differs(old: "ArrayLike", new: "ArrayLike") -> bool:
    """Whether two values or arrays of the same shape differ by more than rounding."""
    a, b = np.asarray(old, float), np.asarray(new, float)
    limit = RELATIVE_TOLERANCE * (ABSOLUTE_TOLERANCE + np.abs(a) + np.abs(b))
    return bool((np.abs(a - b) > limit).any())


def edit_attributes(
    old: "MjModel", new: "MjModel", i: int, fields: Mapping[str, str]
) -> Attributes:
    """Attributes of an element, by fields whose i-th rows differ between two models.

    Args:
        fields: names of attributes, by those of the compiled models' fields.
    """
    return {
        attribute: format_number(getattr(new, field)[i])
        for field, attribute in fields.items()
        if differs(getattr(old, field)[i], getattr(new, field)[i])
    }


def name_or_id(accessor: Callable, index: int) -> str | int:
    """What an edit calls an element; `accessor` is a model's (`model.joint`)."""
    return accessor(index).name or int(index)

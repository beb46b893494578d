"""A model's text as MuJoCo reads it: takes its path, gives what its elements state."""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ModelError
from ...mjcf.edit import Edit, apply_edits, list_tags
from ...recording.data import Floats


class ModelSource:
    """What the text of a model says and a compiled one does not.

    Attributes:
        spec: as MuJoCo reads the text.
        degree: whether hinges' angles are written in degrees.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """`path`: of the MJCF or URDF."""
        self.spec = compile_patched(path, ())
        self.degree = bool(self.spec.compiler.degree)
        self._actuators = list_tags(path, "actuator")
        self._inertials = {name for name, _ in list_tags(path, "inertial")}

    def actuator_tag(self, name: str, index: int) -> str:
        """The tag of an actuator."""
        named = [tag for n, tag in self._actuators if name and n == name]
        unnamed = [tag for _, tag in self._actuators[index : index + 1]]
        return (named or unnamed or ["general"])[0]

    def states_inertia(self, body: str) -> bool:
        """Whether a body has an <inertial>."""
        return body in self._inertials

    @property
    def overrides_masses(self) -> bool:
        """Whether masses and inertias are not those that the bodies state."""
        compiler, always = self.spec.compiler, 1  # mjINERTIAFROMGEOM_TRUE
        return int(compiler.inertiafromgeom) == always or compiler.settotalmass > 0

    def resolve_orientation(self, quat: Floats, alt: Any) -> Floats:
        """How something is turned (4), whichever way the spec says so."""
        if int(alt.type) == 0:  # mjORIENTATION_QUAT
            return np.array(quat) / np.linalg.norm(quat)
        how = self.spec.compiler
        turned = self.spec.resolve_orientation(
            degree=how.degree, sequence=how.eulerseq, orientation=alt
        )
        return np.array(turned)

    def resolve_frame(self, element: Any) -> tuple[Floats, Floats]:
        """Place (3) and turn (4) of the <frame>s around an element of the spec."""
        import mujoco

        place, turn = np.zeros(3), np.array([1.0, 0, 0, 0])
        while element.frame is not None:
            element = element.frame
            its = self.resolve_orientation(element.quat, element.alt)
            mujoco.mju_rotVecQuat(place, place.copy(), its)
            place += element.pos
            mujoco.mju_mulQuat(turn, its, turn.copy())
        return place, turn


def compile_patched(path: str | os.PathLike[str], changes: Sequence[Edit]) -> Any:
    """The edited text as MuJoCo's spec, whose bodies are numbered as in a model.

    Raises:
        ModelError: an edit speaks of what has no text, or MuJoCo refuses the new one.
    """
    import mujoco

    with tempfile.TemporaryDirectory() as folder:
        new = Path(folder) / "model.xml"
        new.write_bytes(apply_edits(path, changes, folder).encode())  # MJCF of a URDF
        try:
            spec = mujoco.MjSpec.from_file(str(new))
            spec.compile()
        except ValueError as error:
            said = " ".join(str(error).split())
            raise ModelError(f"MuJoCo refuses the patch: {said}") from error
    return spec


def differs(a, b) -> bool:
    a, b = np.asarray(a, float), np.asarray(b, float)
    return bool((np.abs(a - b) > 1e-9 * (1e-6 + np.abs(a) + np.abs(b))).any())


def name_or_id(thing, index: int):
    return thing(index).name or int(index)

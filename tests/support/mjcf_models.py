"""A small MJCF of an arm, and what edits change in a model and its text."""

import re
from pathlib import Path

import mujoco
import numpy as np

from selfheal.mjcf.edit import apply_edits, unified_diff

ARM = """<?xml version="1.0"?>
<!-- an arm; not <joint name="knee"/> -->
<mujoco model="arm">
  <compiler angle="radian"/>
  <default>
    <joint damping="0.5"/>
    <default class="soft">
      <joint stiffness='3'/>
    </default>
  </default>

  <worldbody>
    <geom type="plane" size="1 1 1"/>  <!-- the floor -->
    <body name="upper" pos="0 0 1">
      <!-- it swings -->
      <joint   name = "hip"  axis="0 1 0"
               armature="0.01"/>  <!-- hip -->
      <geom name='bone' size="0.10" mass="1"/>
      <body name="lower" pos="0 0 -0.5"><joint name="knee" axis='0 1 0'/>
        <geom size=".1"/>
      </body>
      <geom name="cap" size="0.05"/>
    </body>
    <body name="ball"><freejoint name="free"/><geom size="0.2"/>
      <site name="top"/></body>
  </worldbody>
  <![CDATA[ <joint name="hip"/> ]]>
  <actuator>
    <position name="servo" joint="hip" kp="10"/>
    <motor joint="knee"/>
  </actuator>
  <sensor>
    <jointpos name="angle" joint="hip"/>
  </sensor>
</mujoco>
"""
CUBE = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def write_file(path: Path, text: str | bytes) -> Path:
    """A file of this text, its folders made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def compile_edited(path: Path, edits=(), folder: str = "") -> mujoco.MjModel:
    """The model after the edits, written into a folder beside it, in MuJoCo."""
    place = path.parent / folder
    new = place / "patched.xml"
    write_file(new, apply_edits(path, edits, place))
    return mujoco.MjModel.from_xml_path(str(new))


def list_changed_fields(one: mujoco.MjModel, other: mujoco.MjModel) -> set[str]:
    """The fields, options included, in which two models differ."""
    names = set()
    for prefix, a, b in (("", one, other), ("opt.", one.opt, other.opt)):
        for field in dir(a):
            value = getattr(a, field) if field[0] != "_" else None
            if isinstance(value, np.ndarray | int | float | bytes):
                same = np.array_equal(value, getattr(b, field))
                names |= set() if same else {prefix + field}
    return names - {"paths", "signature"}


def list_edited_fields(path: Path, edits=(), folder: str = "") -> set[str]:
    """The fields that differ once edits are written into a folder beside the model."""
    return list_changed_fields(load_model(path), compile_edited(path, edits, folder))


def list_changed_lines(given: str, new: str) -> list[str]:
    """The lines that a diff removes and adds."""
    diff = unified_diff(given, new, "model.xml").splitlines()
    return [line for line in diff if re.match(r"[-+](?![-+]{2} )", line)]


def load_model(path: Path) -> mujoco.MjModel:
    """The file in MuJoCo."""
    return mujoco.MjModel.from_xml_path(str(path))

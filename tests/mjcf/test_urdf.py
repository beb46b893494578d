"""A URDF becomes an MJCF of the same robot."""

import numpy as np
import pytest

from selfheal.errors import ModelError
from selfheal.mjcf.edit import Insert, Set, apply_edits
from tests.support.mjcf_models import CUBE, compile_edited, load_model, write_file

URDF = """<robot name="r">
  <mujoco><compiler meshdir="meshes" discardvisual="false"/></mujoco>
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><mesh filename="c.obj"/></geometry></collision></link>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
</robot>
"""


def test_a_urdf_becomes_an_mjcf(tmp_path):
    write_file(tmp_path / "meshes/c.obj", CUBE.format(1))
    path = write_file(tmp_path / "r.urdf", URDF)
    edits = [
        Set("joint", "elbow", {"frictionloss": "0.1"}),
        Insert("actuator", "", '<motor name="m" joint="elbow"/>'),
    ]
    after = compile_edited(path, edits, "out")
    assert (after.dof_frictionloss[0], after.nu, after.nmesh) == (0.1, 1, 1)
    before = load_model(path)
    for field in ("body_mass", "body_inertia", "jnt_range", "mesh_vert"):
        np.testing.assert_allclose(
            getattr(before, field), getattr(after, field), atol=1e-6
        )


@pytest.mark.parametrize("text", ["<robot><link/></robot>", "<sdf/>"])
def test_what_mujoco_cannot_turn_into_an_mjcf_is_refused(text, tmp_path):
    path = write_file(tmp_path / "r.urdf", text)
    with pytest.raises(ModelError, match=r"r\.urdf: (MuJoCo cannot read|<sdf>)"):
        apply_edits(path, [], tmp_path)

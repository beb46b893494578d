"""Variants of a model are the model, but for what is only seen."""

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.simulation.model_variants import ModelCompiler

MESHES = """<mujoco>
  <asset>
    <mesh name="shell" vertex="0 0 0  .3 0 0  0 .2 0  0 0 .1"/>
    <mesh name="foot" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="leg" pos="0 0 1"><freejoint/>
      <geom name="seen" type="mesh" mesh="shell" pos=".1 .2 .3" euler="1 2 3" {seen}/>
      <geom name="sole" type="mesh" mesh="foot"/>
      <body name="toe" pos="0 0 -.2"><joint name="j" axis="0 1 0"/>
        <inertial pos="0 0 .1" mass="1" diaginertia="1 2 2"/>
        <geom type="mesh" mesh="shell" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize(
    ("seen", "is_only_seen"),
    [
        ('contype="0" conaffinity="0" density="0"', True),
        ('contype="0" conaffinity="0"', False),  # it gives inertia
        ('density="0"', False),  # it touches
    ],
)
def test_meshes_that_are_only_seen_are_left_out(tmp_path, seen, is_only_seen):
    path = tmp_path / "model.xml"
    path.write_text(MESHES.format(seen=seen))
    compiler = ModelCompiler(str(path))
    given, model = compiler.nominal, compiler.compile_variant([]).model
    assert given.nmesh == 2 and model.nmesh == (1 if is_only_seen else 2)
    assert model.geom("sole").id == given.geom("sole").id
    for field in ("body_mass", "body_inertia", "body_ipos", "geom_pos", "geom_quat"):
        np.testing.assert_allclose(
            getattr(model, field), getattr(given, field), atol=1e-12
        )
    states = []
    for m in (given, model):
        data = mujoco.MjData(m)
        mujoco.mj_step(m, data, 500)
        states.append(data.qpos.copy())
    np.testing.assert_array_equal(*states)


def test_contacts_are_not_looked_for_where_nothing_touches(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(MESHES.format(seen=""))
    compiler, touched = ModelCompiler(str(path)), []
    for touching in (True, False):
        model = compiler.compile_variant([], touching=touching).model
        data = mujoco.MjData(model)
        data.qpos[2] = 0.0
        mujoco.mj_forward(model, data)
        touched.append(data.ncon > 0)
    assert touched == [True, False]

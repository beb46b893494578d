"""Variants of a model are the model, but for what is only seen."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.simulation import model_variants, rollout
from selfheal.diagnosis.simulation.batch import make_batch
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from tests.support.problems import list_nominal_terms
from tests.support.recorded_robots import Robot, bench

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
        model = compiler.compile_leapfrog([], touching=touching).model
        data = mujoco.MjData(model)
        data.qpos[2] = 0.0
        mujoco.mj_forward(model, data)
        touched.append(data.ncon > 0)
    assert touched == [True, False]


CRANK = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="crank"><joint name="hinge" axis="0 1 0" damping=".01"/>
      <geom type="capsule" fromto="0 0 0 .1 0 0" size=".02"/>
      <body name="rod" pos=".1 0 0"><joint name="pin" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".01"/>
      </body>
    </body>
    <body name="piston" pos=".4 0 0"><joint name="piston" type="slide" axis="1 0 0"/>
      <geom type="box" size=".02 .02 .02"/>
    </body>
  </worldbody>
  <equality><connect body1="rod" body2="piston" anchor=".3 0 0"/></equality>
</mujoco>"""


def _give_each_a_model(hypotheses, initial):
    """As `make_batch`, which shares the model."""
    every, count = make_batch(hypotheses, initial), len(initial.qpos)
    batch = Batch(hypotheses.variant.model, count, nthread=1)
    segments = count // len(hypotheses.models)
    batch.set_models([m for m in hypotheses.models for _ in range(segments)])
    for name in ("qpos", "qvel"):
        batch.bind(name)[:] = every.bind(name)
    return batch


@pytest.mark.parametrize(
    ("xml", "body", "positions"),
    [
        (MESHES.format(seen=""), "leg", [0, 0, 0.3, 1, 0, 0, 0, 0.0]),
        (CRANK, "piston", [0.0, 0, 0]),
    ],
)
def test_a_shared_model_moves_as_one_of_each_hypothesis(
    xml, body, positions, tmp_path, monkeypatch
):
    robot = Robot(
        xml,
        {body: ("body_position", body, "m")},
        lambda t, rng: np.zeros((len(t), 0)),
        lambda rng: (
            np.array(positions),
            np.full(mujoco.MjModel.from_xml_string(xml).nv, 0.1),
        ),
    )
    predicted = []
    for is_own in (False, True):
        if is_own:
            monkeypatch.setattr(model_variants, "_compile_twin", lambda spec, m: m)
            monkeypatch.setattr(rollout, "make_batch", _give_each_a_model)
        b = bench(robot, tmp_path, episodes=1, seconds=1.0)
        terms = list_nominal_terms(b)
        values = 1 + 0.1 * np.eye(sum(len(t.parameters) for t in terms))
        segments = cut_segments(b.simulator.episodes, 150)
        predicted.append(b.simulator.simulate(terms, values, segments))
    np.testing.assert_array_equal(*predicted)
    assert np.ptp(predicted[0], axis=0).max() > 1e-3

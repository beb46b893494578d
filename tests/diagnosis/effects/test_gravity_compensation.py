"""A controller that carries the robot's weight: where it could be, and what it does."""

from dataclasses import replace

import mujoco
import numpy as np

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.controller.gravity_compensation import (
    find_compensated_bodies,
)
from tests.support.effect_robots import (
    compile_patched,
    make_effect_bench,
    make_pendulum,
)
from tests.support.recorded_robots import ROBOTS

EFFECT = find_effect("gravity_compensation")


def _hold(model) -> np.ndarray:
    """Accelerations of a robot at rest, whose motors are off."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0.4
    model.actuator_biasprm[:] = 0
    mujoco.mj_forward(model, data)
    return np.array(data.qacc)


def test_a_robot_whose_weight_is_carried_stays_where_it_is(benches):
    b = benches["arm"]
    (term,) = EFFECT.propose_terms(b.robot)
    assert term.targets == ("world",) and term.initial_values == ((1.0,),)
    variant = b.simulator.compiler.compile_variant([term])
    falling, held = (
        _hold(variant.build_model([term], np.array([share]))) for share in (0.0, 1.0)
    )
    assert np.abs(falling).max() > 1 and np.abs(held).max() < 1e-10


def test_a_stated_value_is_the_one_that_may_be_wrong(tmp_path):
    b = make_pendulum(tmp_path, **{'<body name="rod"': '<body gravcomp="1" name="rod"'})
    (term,) = EFFECT.propose_terms(b.robot)
    assert term.parameters[0].nominal == 1 and term.initial_values == ((0.0,),)


def test_bodies_with_another_value_than_most_of_the_mass_keep_it():
    xml = ROBOTS["arm"].xml.replace(
        '<body name="lower"', '<body gravcomp="1" name="lower"'
    )
    model = mujoco.MjModel.from_xml_string(xml)
    assert find_compensated_bodies(model) == (1,)


def test_the_patch_states_it_at_every_body_that_hangs_on_a_joint(tmp_path):
    xml = ROBOTS["arm"].xml.replace(
        "<worldbody>", '<worldbody><body name="base"><geom size="0.01"/></body>'
    )
    b = make_effect_bench(replace(ROBOTS["arm"], xml=xml), tmp_path)
    (term,) = EFFECT.propose_terms(b.robot)
    new = compile_patched(b, [term], [0.8])
    each = {new.body(i).name: new.body_gravcomp[i] for i in range(1, new.nbody)}
    assert each == {"base": 0, "upper": 0.8, "lower": 0.8}

"""Models that a patch makes, against those that were meant."""

from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np

from selfheal.diagnosis.effects.base import Term
from selfheal.diagnosis.effects.inertia import spatial_inertia
from selfheal.diagnosis.output.build_result import build_patch
from selfheal.diagnosis.simulation.build import build_simulator, summarize_robot
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from tests.support.recorded_robots import Robot, record

FIELDS = [
    "body_pos",
    "body_quat",
    "body_mass",
    "body_ipos",
    "jnt_range",
    "qpos_spring",
    "jnt_stiffness",
    "dof_damping",
    "dof_frictionloss",
    "dof_armature",
    "geom_pos",
    "geom_size",
    "site_pos",
    "actuator_dyntype",
    "actuator_gaintype",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_ctrlrange",
    "actuator_actrange",
    "actuator_forcerange",
]


def make_case(model: Path, robot: Robot) -> SimpleNamespace:
    """What a diagnosis has of a model by which a robot was recorded."""
    recording = record(robot, episodes=1, seconds=0.3)
    simulator = build_simulator(ModelCompiler(str(model)), [recording])
    return SimpleNamespace(
        compiler=simulator.compiler,
        training=simulator,
        robot=summarize_robot(simulator),
    )


def compile_patch(
    case: SimpleNamespace, terms: Iterable[Term], values: np.ndarray, folder: Path
) -> mujoco.MjModel:
    """The compiled patch with terms of these values, beside the model."""
    text, *_ = build_patch(case, tuple(terms), values)
    (folder / "patched.xml").write_text(text)
    return mujoco.MjModel.from_xml_path(str(folder / "patched.xml"))


def check_patch(
    case: SimpleNamespace, terms: Iterable[Term], values: np.ndarray, folder: Path
) -> mujoco.MjModel:
    """The compiled patch, after the assertion that it is what the terms say."""
    new = compile_patch(case, terms, values, folder)
    meant = case.compiler.compile_variant(terms).build_model(terms, values)
    check_same_robot(new, meant)
    return new


def check_same_robot(new: mujoco.MjModel, meant: mujoco.MjModel) -> None:
    """Assert that two models are one, to the digits of a text."""
    for field in FIELDS:
        both = [getattr(m, field) for m in (new, meant)]
        np.testing.assert_allclose(*both, atol=1e-6, err_msg=field)
    for body in range(1, new.nbody):
        both = [spatial_inertia(m, body) for m in (new, meant)]
        np.testing.assert_allclose(*both, rtol=1e-5, atol=1e-9)

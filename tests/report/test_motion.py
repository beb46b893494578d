"""The drawn animation: bodies stand where MuJoCo puts them."""

import numpy as np
import pytest

from selfheal.body.mjcf import build_spec
from selfheal.report.motion import pose_skeleton
from selfheal.robot.actions import load_published_body

BODY = load_published_body()


def test_a_posed_body_is_where_mujoco_puts_it():
    import mujoco

    rng = np.random.default_rng(1)
    model = build_spec(BODY).compile()
    data = mujoco.MjData(model)
    turn = rng.normal(size=4)
    data.qpos[:7] = [0.1, 0.2, 0.3, *(turn / np.linalg.norm(turn))]
    angles = rng.uniform(-1, 1, 8)
    for joint, angle in zip(BODY.anatomy.joints, angles, strict=True):
        data.joint(joint).qpos = angle
    mujoco.mj_kinematics(model, data)
    seen = pose_skeleton(BODY, data.qpos[:3], data.qpos[3:7], angles)
    for i, part in enumerate(BODY.anatomy.parts):
        body = data.body(part)
        tip = body.xpos + body.xmat.reshape(3, 3)[:, 0] * BODY.length[0, i]
        assert seen[i] == pytest.approx(np.array([body.xpos, tip]), abs=1e-9)

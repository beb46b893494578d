"""What the noise of the readings of 2006 allows, and what their model lacks."""

from typing import Any

import mujoco
import numpy as np

from benchmarks.writer import Section
from selfheal.body.mjcf import Physics, build_spec
from selfheal.engine.arrays import pack_bodies
from selfheal.engine.mujoco import HOLD, RAMP
from selfheal.engine.readings import compute_readings
from selfheal.engine.statics import Statics
from selfheal.robot.actions import load_published_body

_SAME_POSE = 0.05  # [deg, mm] poses predicted this alike are one
_BELLIES = {"square, 41 mm (as published)": 0.0, "round, 46 mm": 0.046,
            "round, 51 mm": 0.051, "round, 56 mm": 0.056}  # fmt: skip


def measure_lack_of_fit(
    actions: np.ndarray, measured: np.ndarray
) -> tuple[Section, Any]:
    """Pure error of replicates, and errors with a round belly and softer servos.

    Args:
        actions: (A, P) joint targets [rad].
        measured: (A, 3) channels.
    """
    floor, count = measure_pure_error(actions, measured)
    data: dict[str, Any] = {"pure_error": floor, "replicates": count}
    rows = []
    for name, radius in _BELLIES.items():
        for softer in (1, 10):
            seen, kp = simulate_belly(actions, radius, softer), Physics().kp / softer
            error = np.abs(seen - measured)
            pair = float(error[:, :2].sum(axis=1).mean()), float(error[:, 2].mean())
            data[f"{name}, {kp:g}"] = pair
            rows.append([name, f"{kp:g}", *(f"{x:.3f}" for x in pair)])
    text = (
        f"{count} of the 36 readings are of poses that the model takes for the same as "
        "another one's (an upper leg down, alone or with a lower one that stays in the "
        "air). Among these the tilts differ from their mean by "
        f"{floor:.2f} deg an action: that much is noise, and no model can be better "
        "than that. The rest is lack of fit. Nothing is fitted below; `mujoco`, the "
        "published body, its belly a cylinder instead of a box, servos as stiff as "
        "ever and a tenth of it."
    )
    head = ["belly", "kp [N m/rad]", "tilt error", "clearance error [mm]"]
    return Section("What the noise allows", text, head, rows), data


def measure_pure_error(actions: np.ndarray, measured: np.ndarray) -> tuple[float, int]:
    """Mean deviation of tilts from the mean of replicates [deg], and their number.

    It is |left/right| + |forward/back|, as a tilt error is, scaled by sqrt(n / (n - 1))
    as a variance's divisor is. Poses flat on the belly are left out: all readings of
    theirs are zero.
    """
    body = load_published_body()[np.zeros(len(actions), int)]
    seen = Statics().simulate(body, actions).channels
    found: list[float] = []
    for row in range(len(seen)):
        same = np.flatnonzero((np.abs(seen - seen[row]) < _SAME_POSE).all(axis=1))
        if len(same) > 1 and np.abs(seen[row]).max() > 1:
            gap = np.abs(measured[row, :2] - measured[same, :2].mean(axis=0)).sum()
            found.append(float(gap * np.sqrt(len(same) / (len(same) - 1))))
    return float(np.mean(found)), len(found)


def simulate_belly(actions: np.ndarray, radius: float, softer: float) -> np.ndarray:
    """(A, 3) channels of the published body with a round belly; 0: as it is.

    Args:
        actions: (A, P) joint targets [rad].
        radius: of the belly [m].
        softer: by how much the servos are softer [1].
    """
    body = load_published_body()
    stiff = Physics()
    soft = Physics(kp=stiff.kp / softer, kv=stiff.kv / softer)
    spec = build_spec(body, 0, soft)
    if radius:
        torso = next(geom for geom in spec.geoms if geom.name == "torso")
        torso.type = mujoco.mjtGeom.mjGEOM_CYLINDER
        torso.size = [radius, body.anatomy.torso_half[2], 0]
    model = spec.compile()
    steps = round((RAMP + HOLD) / model.opt.timestep)
    rest = []
    for target in actions:
        data = mujoco.MjData(model)
        for k in range(steps):
            data.ctrl[:] = target * min((k + 1) * model.opt.timestep / RAMP, 1)
            mujoco.mj_step(model, data)
        torso = data.body("torso")  # its rows of xmat: the world's axes in its frame
        rest.append([*torso.xmat.reshape(3, 3)[2], torso.xpos[2]])
    up, height = np.array(rest)[:, :3], np.array(rest)[:, 3]
    bodies, tips = body[np.zeros(len(rest), int)], np.zeros((len(rest), 0))
    inputs = pack_bodies(bodies)
    return compute_readings(bodies, inputs, up, height, tips, actions).channels

"""A process of its own that renders: models and poses in, pictures out.

    MUJOCO_GL=egl python _gl.py FOLDER

OpenGL is chosen when mujoco is imported, and a bad driver ends the process that asks
it: so `render.py` runs this file and does without it where it fails. FOLDER holds for
each scene k a compiled model_k.mjb with a camera named `CAMERA`, and scene_k.npz. That
has `size` (height, width) [px] and `poses` (F, B, 7): origin [m] and quaternion of each
body but the world. It may have `paint` (ngeom, 4), colors of geoms. It may have `ghost`
(F, B, 7), where the robot stands a second time, with its `ghost_paint` (ngeom, 4).
pictures_k.npy is (F, height, width, 3) uint8.
"""

import os
import sys
from collections.abc import Mapping

import mujoco
import numpy as np

CAMERA = "selfheal film"


def render_scene(
    model: "mujoco.MjModel", inputs: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Pictures (F, height, width, 3) uint8 of a model in each pose."""
    data, height, width = mujoco.MjData(model), *map(int, inputs["size"])
    mujoco.mj_kinematics(model, data)
    option = _choose_visible(model)
    pictures = np.empty((len(inputs["poses"]), height, width, 3), np.uint8)
    with mujoco.Renderer(model, height, width) as renderer:
        for f, picture in enumerate(pictures):
            _place_bodies(model, data, inputs["poses"][f])
            renderer.update_scene(data, camera=CAMERA, scene_option=option)
            scene, count = renderer.scene, renderer.scene.ngeom
            if "paint" in inputs:
                _paint(scene, range(count), inputs["paint"])
            if "ghost" in inputs:
                _place_bodies(model, data, inputs["ghost"][f])
                dynamic = int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
                mujoco.mjv_addGeoms(
                    model, data, option, mujoco.MjvPerturb(), dynamic, scene
                )
                _paint(scene, range(count, scene.ngeom), inputs["ghost_paint"])
            renderer.render(out=picture)
    return pictures


def _choose_visible(model: "mujoco.MjModel") -> "mujoco.MjvOption":
    """The geoms that MuJoCo shows; where that would be no body's, all."""
    option = mujoco.MjvOption()
    for group in ("site", "tendon", "joint", "actuator", "skin", "flex"):
        getattr(option, f"{group}group")[:] = 0
    option.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = 0
    groups = model.geom_group[model.geom_bodyid > 0]
    if not option.geomgroup[groups].any():
        option.geomgroup[:] = 1
    return option


def _place_bodies(
    model: "mujoco.MjModel", data: "mujoco.MjData", poses: np.ndarray
) -> None:
    """Put bodies, and what is on them, into poses (B, 7)."""
    data.xpos[1:], data.xquat[1:] = poses[:, :3], poses[:, 3:]
    for matrix, quaternion in zip(data.xmat, data.xquat, strict=True):
        mujoco.mju_quat2Mat(matrix, quaternion)
    turns = data.xmat.reshape(-1, 3, 3)[model.geom_bodyid]
    data.geom_xpos[:] = data.xpos[model.geom_bodyid]
    data.geom_xpos += (turns @ model.geom_pos[..., None])[..., 0]
    own = np.empty((model.ngeom, 9))
    for matrix, quaternion in zip(own, model.geom_quat, strict=True):
        mujoco.mju_quat2Mat(matrix, quaternion)
    data.geom_xmat[:] = (turns @ own.reshape(-1, 3, 3)).reshape(-1, 9)
    mujoco.mj_camlight(model, data)


def _paint(scene: "mujoco.MjvScene", which: range, paint: np.ndarray) -> None:
    """Give geoms of a scene colors; those that are NaN keep their own."""
    for i in which:
        geom = scene.geoms[i]
        if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
            color = paint[geom.objid]
            if np.isfinite(color).all():
                geom.matid, geom.rgba[:] = -1, color
                geom.transparent = color[3] < 1


def main(folder: str) -> None:
    """Render all scenes of a folder."""
    for k in range(sum(name.endswith(".mjb") for name in os.listdir(folder))):
        model = mujoco.MjModel.from_binary_path(f"{folder}/model_{k}.mjb")
        with np.load(f"{folder}/scene_{k}.npz") as inputs:
            np.save(f"{folder}/pictures_{k}.npy", render_scene(model, dict(inputs)))


if __name__ == "__main__":
    main(*sys.argv[1:])
    os._exit(0)  # drivers were seen to fail when they are taken down

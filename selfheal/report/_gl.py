"""A process of its own that renders: models and poses in, pictures out.

    MUJOCO_GL=egl python _gl.py SCENES.npz PICTURES.npy

OpenGL is chosen when mujoco is imported, and a bad driver ends the process that asks
it: so `render.py` runs this file and does without it where it fails. SCENES.npz holds
`size` (height, width) [px] and for each lane k xml_k and qpos_k (F, nq);
PICTURES.npy is (lanes, F, height, width, 3) uint8.
"""

import os
import sys

import mujoco
import numpy as np


def render_lane(xml: str, poses: np.ndarray, height: int, width: int) -> np.ndarray:
    """Render a model as its first camera sees it in each pose.

    Args:
        xml: MJCF of the model.
        poses: (F, nq) joint positions, in MuJoCo's order [m or rad].
        height: of a picture [px].
        width: of a picture [px].

    Returns:
        (F, height, width, 3) uint8 pictures.
    """
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    pictures = np.empty((len(poses), height, width, 3), np.uint8)
    with mujoco.Renderer(model, height, width) as renderer:
        for pose, picture in zip(poses, pictures, strict=True):
            data.qpos = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            renderer.update_scene(data, camera=0)
            renderer.render(out=picture)
    return pictures


def main(scenes: str, pictures: str) -> None:
    """Render all lanes of a file into another."""
    with np.load(scenes) as told:
        lanes = sum(name.startswith("qpos") for name in told)
        height, width = map(int, told["size"])
        shown = [
            render_lane(str(told[f"xml_{k}"]), told[f"qpos_{k}"], height, width)
            for k in range(lanes)
        ]
    np.save(pictures, np.stack(shown))


if __name__ == "__main__":
    main(*sys.argv[1:])
    os._exit(0)  # drivers were seen to fail when they are taken down

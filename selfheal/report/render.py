"""Walks rendered by MuJoCo where there is OpenGL: lanes in, pictures or None out."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats
from ..body.mjcf import build_spec
from .motion import Lane, pose_skeleton

if TYPE_CHECKING:
    from mujoco import MjSpec

_WIDTH = 720  # [px]; chosen
_FLATTEST, _STEEPEST = 0.2, 0.45  # height of a picture by its width; chosen
_ELEVATION = np.radians(28)  # of the camera above the ground; chosen
_AWAY = 3.0  # the camera's distance by the width that it sees; chosen
_MARGIN = 1.06  # round what has to be seen; chosen
SQUARE = 0.25  # [m] of the floor's pattern; chosen
_SHADOW, _SAMPLES = 1024, 2  # [px], in a pixel; a software driver's time is in these
_LONGEST = 120.0  # [s] until a driver that does not answer is given up; chosen
_TORSO = (0.6, 0.64, 0.68, 1.0)


@dataclass(frozen=True)
class _View:
    """A camera that stands still.

    Attributes:
        middle: (3) of what it sees [m].
        wide: [m] of what it sees.
        place: (3) [m].
        turn: (4) quaternion.
        fovy: vertical angle [degrees].
        aspect: height of the picture by its width.
    """

    middle: Floats
    wide: float
    place: Floats
    turn: Floats
    fovy: float
    aspect: float


def render_lanes(
    lanes: Sequence[Lane], heading: float, rows: Sequence[int]
) -> np.ndarray | None:
    """All lanes as one camera sees them, which stands still, the way to the right.

    It is done in a process of its own, with EGL or else OSMesa; with `MUJOCO_GL` alone
    where that is set, so `MUJOCO_GL=disable` keeps from rendering.

    Args:
        lanes: walks.
        heading: direction that is to the right [rad].
        rows: which rows of the lanes to render.

    Returns:
        (L, F, height, width, 3) uint8 of L lanes and F rows; None where nothing can
        render.
    """
    chosen = os.environ.get("MUJOCO_GL")
    scenes = _build_scenes(lanes, heading, rows)
    for backend in (chosen,) if chosen else ("egl", "osmesa"):
        pictures = _run_renderer(scenes, backend)
        if pictures is not None:
            return pictures
    return None


def _run_renderer(scenes: dict[str, np.ndarray], backend: str) -> np.ndarray | None:
    """What a process with this OpenGL renders; None if it does not."""
    with tempfile.TemporaryDirectory() as folder:
        told, shown = Path(folder, "scenes.npz"), Path(folder, "pictures.npy")
        np.savez(told, **scenes)  # type: ignore[arg-type]
        script = str(Path(__file__).with_name("_gl.py"))
        # -P: names of this folder's files would hide those of packages
        command = [sys.executable, "-P", script, str(told), str(shown)]
        environment = os.environ | {"MUJOCO_GL": backend}
        try:
            done = subprocess.run(command, env=environment, cwd=folder,
                                  capture_output=True, timeout=_LONGEST)  # fmt: skip
        except (OSError, subprocess.TimeoutExpired):
            return None
        if done.returncode or not shown.is_file():
            return None
        pictures = np.load(shown)
    # an OpenGL that draws nothing answers with one color
    return pictures if np.ptp(pictures) else None


def _build_scenes(
    lanes: Sequence[Lane], heading: float, rows: Sequence[int]
) -> dict[str, np.ndarray]:
    """What `_gl.py` reads."""
    view = _find_view(lanes, heading, rows)
    scenes = {"size": np.array([round(_WIDTH * view.aspect), _WIDTH])}
    for k, lane in enumerate(lanes):
        spec = _furnish_scene(lane, heading, view)
        model = spec.compile()
        poses = np.zeros((len(rows), model.nq))
        poses[:, :3], poses[:, 3:7] = lane.position[rows], lane.orientation[rows]
        at = [model.joint(j).qposadr[0] for j in lane.body.anatomy.joints]
        poses[:, at] = lane.angles[rows]
        scenes |= {f"xml_{k}": np.array(spec.to_xml()), f"qpos_{k}": poses}
    return scenes


def _find_view(lanes: Sequence[Lane], heading: float, rows: Sequence[int]) -> _View:
    """A camera that sees all of all walks, from the right of the way and above."""
    from scipy.spatial.transform import Rotation

    points = np.concatenate([
        pose_skeleton(lane.body, lane.position[k], lane.orientation[k], lane.angles[k])
        for lane in lanes for k in rows
    ])  # fmt: skip
    right = np.array([np.cos(heading), np.sin(heading), 0.0])
    level = np.array([right[1], -right[0], 0.0])
    toward = np.cos(_ELEVATION) * level + np.sin(_ELEVATION) * np.array([0, 0, 1])
    axes = np.array([right, np.cross(toward, right), toward])
    seen = points.reshape(-1, 3) @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    seen -= middle
    away = _AWAY * float(np.ptp(seen[:, 0]))
    spread = np.abs(seen[:, :2] / (away - seen[:, 2:])).max(axis=0)
    half, high = _MARGIN * spread  # tangents
    aspect = float(np.clip(high / half, _FLATTEST, _STEEPEST))
    return _View(
        middle=middle @ axes,
        wide=away / _AWAY,
        place=(middle + [0, 0, away]) @ axes,
        turn=Rotation.from_matrix(axes.T).as_quat(scalar_first=True),
        fovy=float(np.degrees(2 * np.arctan(max(high, half * aspect)))),
        aspect=aspect,
    )


def _furnish_scene(lane: Lane, heading: float, view: _View) -> "MjSpec":
    """A lane's body in its color, on a floor with squares, in the light, in view."""
    import mujoco

    spec = build_spec(lane.body)
    _paint_body(spec, lane)
    _add_floor(spec)
    half = heading / 2
    spec.worldbody.add_geom(  # where it starts
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.006, 0.3, 0.0005],
        quat=[np.cos(half), 0, 0, np.sin(half)], rgba=[0.1, 0.12, 0.14, 1],
    )  # fmt: skip
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = [0.35] * 3
    spec.visual.headlight.specular = [0.05] * 3
    light = spec.lights[0]
    light.pos = [*view.middle[:2], 2]  # shadows fall about it
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.dir, light.diffuse, light.specular = [0, 0, -1], [0.5] * 3, [0.1] * 3
    spec.visual.quality.shadowsize = _SHADOW
    spec.visual.quality.offsamples = _SAMPLES
    visual = spec.visual.global_
    visual.offheight, visual.offwidth = round(_WIDTH * view.aspect), _WIDTH
    spec.stat.center, spec.stat.extent = view.middle, view.wide
    spec.worldbody.add_camera(pos=view.place, quat=view.turn, fovy=view.fovy)
    return spec


def _paint_body(spec: "MjSpec", lane: Lane) -> None:
    """Color a body, and let beams carry its legs, as the drawn one has."""
    import mujoco
    from matplotlib.colors import to_rgba

    body, torso = lane.body, spec.body("torso")
    for part in body.anatomy.parts:
        for geom in spec.body(part).geoms:
            geom.rgba = to_rgba(lane.color)
    for hip in body.anchor[0][body.parent[0] == 0]:
        torso.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.006, 0, 0],
                       fromto=[0, 0, 0, *hip], mass=0)  # fmt: skip
    for geom in torso.geoms:
        geom.rgba = _TORSO


def _add_floor(spec: "MjSpec") -> None:
    """White above, and squares below."""
    import mujoco

    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=16, height=96,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT, rgb1=[1, 1, 1], rgb2=[1, 1, 1],
    )  # fmt: skip
    spec.add_texture(
        name="squares", type=mujoco.mjtTexture.mjTEXTURE_2D, width=256, height=256,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.93, 0.94, 0.95], rgb2=[0.84, 0.86, 0.88],
    )  # fmt: skip
    textures = [""] * mujoco.mjtTextureRole.mjNTEXROLE
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "squares"
    # a plane shows half of a repeat, one square, in a unit of this
    spec.add_material(name="squares", textures=textures, texuniform=True,
                      texrepeat=[1 / SQUARE] * 2)  # fmt: skip
    floor = spec.geom("floor")
    floor.material, floor.size = "squares", [20, 20, 0.1]

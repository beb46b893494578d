"""Moving pictures: walks in, rendered by MuJoCo where there is OpenGL, else drawn."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats
from ..body.mjcf import build_spec
from ..engine.poses import pose_bodies
from .motion import (
    FRAME,
    Lane,
    count_common_rows,
    draw_animation,
    embed_animation,
    encode_frames,
    pose_skeleton,
)
from .page import Html
from .picture import INK, PAPER

if TYPE_CHECKING:
    from mujoco import MjModel, MjSpec
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

_WIDTH = 720  # [px]; chosen
_FLATTEST, _STEEPEST = 0.2, 0.45  # height of a picture by its width; chosen
_ELEVATION = np.radians(28)  # of the camera above the ground; chosen
_AWAY = 3.0  # the camera's distance by the width that it sees; chosen
_THINNEST = 1e-4  # [m] of what is seen; chosen: not zero
_MARGIN = 1.06  # round what has to be seen; chosen
SQUARE = 0.25  # [m] of the floor's pattern; chosen
_SHADOW, _SAMPLES = 1024, 2  # [px], in a pixel; a software driver's time is in these
_LONGEST = 120.0  # [s] until a driver that does not answer is given up; chosen
_TORSO = (0.6, 0.64, 0.68, 1.0)
_QUALITY = 60  # of a WebP, of 100; chosen
_LETTERS, _BAND = 15, 26  # [px] of titles, and what they stand on; chosen


@dataclass(frozen=True)
class View:
    """A camera that stands still.

    Attributes:
        middle: (3) of what it sees [m].
        wide: [m] of what it sees.
        axes: (3, 3) to its right, up, and toward it.
        away: from the middle [m].
        fovy: vertical angle [degrees].
        aspect: height of the picture by its width.
    """

    middle: Floats
    wide: float
    axes: Floats
    away: float
    fovy: float
    aspect: float

    def project(self, points: Floats) -> Floats:
        """Where in a picture (N, 2) points (N, 3) [m] are, by its width, from above."""
        seen = (points - self.middle) @ self.axes.T
        high = 2 * np.tan(np.radians(self.fovy) / 2)
        flat = seen[:, :2] / (self.away - seen[:, 2:]) / high * self.aspect
        return np.array([0.5, 0.5 * self.aspect]) + flat * [1, -1]


@dataclass(frozen=True, eq=False)
class Scene:
    """A model in several poses; as `_gl.py` has them.

    Attributes:
        model: compiled, with lights and a camera, by `furnish`.
        size: height and width of a picture [px].
        poses: (F, B, 7) of all bodies.
        more: `paint`, `ghost` and `ghost_paint`, as far as they are wanted.
    """

    model: "MjModel"
    size: tuple[int, int]
    poses: Floats
    more: Mapping[str, np.ndarray] = field(default_factory=dict)


def render_scenes(scenes: Sequence[Scene]) -> list[np.ndarray] | None:
    """Pictures (F, height, width, 3) uint8 of each scene; None where nothing can.

    It is done in a process of its own, with EGL or else OSMesa; with `MUJOCO_GL` alone
    where that is set, so `MUJOCO_GL=disable` keeps from rendering. macOS has its own.
    """
    own = "cgl" if sys.platform == "darwin" else "egl"
    chosen = os.environ.get("MUJOCO_GL")
    for backend in (chosen,) if chosen else (own, "osmesa"):
        pictures = _run_renderer(scenes, backend)
        if pictures is not None:
            return pictures
    return None


def _run_renderer(scenes: Sequence[Scene], backend: str) -> list[np.ndarray] | None:
    """What a process with this OpenGL renders; None if it does not."""
    import mujoco

    with tempfile.TemporaryDirectory() as folder:
        for k, scene in enumerate(scenes):
            mujoco.mj_saveModel(scene.model, f"{folder}/model_{k}.mjb")
            arrays = {"size": np.array(scene.size), "poses": scene.poses, **scene.more}
            np.savez(f"{folder}/scene_{k}.npz", **arrays)  # type: ignore[arg-type]
        script = str(Path(__file__).with_name("_gl.py"))
        # -P: names of this folder's files would hide those of packages
        command = [sys.executable, "-P", script, folder]
        environment = os.environ | {"MUJOCO_GL": backend}
        try:
            done = subprocess.run(
                command,
                check=False,
                env=environment,
                cwd=folder,
                capture_output=True,
                timeout=_LONGEST,
            )
            shown = [np.load(f"{folder}/pictures_{k}.npy") for k in range(len(scenes))]
        except (OSError, subprocess.TimeoutExpired):
            return None
    # an OpenGL that draws nothing answers with one color
    return None if done.returncode or not all(map(np.ptp, shown)) else shown


def render_lanes(
    lanes: Sequence[Lane], heading: float, rows: Sequence[int]
) -> np.ndarray | None:
    """All lanes as one camera sees them, which stands still, the heading to the right.

    Args:
        heading: direction that is to the right [rad].
        rows: which rows of the lanes to render.

    Returns:
        (L, F, height, width, 3) uint8 of L lanes and F rows; None where nothing can
        render.
    """
    skeletons = [
        pose_skeleton(lane.body, lane.position[k], lane.orientation[k], lane.angles[k])
        for lane in lanes
        for k in rows
    ]
    view = find_view(
        np.reshape(skeletons, (-1, 3)), heading, _ELEVATION, _FLATTEST, _STEEPEST
    )
    size = round(_WIDTH * view.aspect), _WIDTH
    scenes = []
    for lane in lanes:
        model = _build_lane(lane, heading, view, size)
        poses = np.zeros((len(rows), model.nq))
        poses[:, :3], poses[:, 3:7] = lane.position[rows], lane.orientation[rows]
        at = [model.joint(j).qposadr[0] for j in lane.body.anatomy.joints]
        poses[:, at] = lane.angles[rows]
        scenes.append(Scene(model, size, pose_bodies(model, poses)))
    shown = render_scenes(scenes)
    return None if shown is None else np.stack(shown)


def find_view(
    points: Floats, heading: float, elevation: float, flattest: float, steepest: float
) -> View:
    """A camera that sees all points.

    Args:
        points: (N, 3) [m].
        heading: horizontal direction that is to the right [rad].
        elevation: of the camera above the horizon [rad].
        flattest: least height of the picture by its width.
    """
    right = np.array([np.cos(heading), np.sin(heading), 0.0])
    level = np.array([right[1], -right[0], 0.0])
    toward = np.cos(elevation) * level + np.sin(elevation) * np.array([0, 0, 1])
    axes = np.array([right, np.cross(toward, right), toward])
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    seen = np.vstack([seen - middle, _THINNEST * np.eye(3)])
    away = _AWAY * float(np.ptp(seen, axis=0).max())
    spread = np.abs(seen[:, :2] / (away - seen[:, 2:])).max(axis=0)
    half, high = _MARGIN * spread  # tangents
    aspect = float(np.clip(high / half, flattest, steepest))
    return View(
        middle=middle @ axes,
        wide=away / _AWAY,
        axes=axes,
        away=away,
        fovy=float(np.degrees(2 * np.arctan(max(high, half * aspect)))),
        aspect=aspect,
    )


def furnish(spec: "MjSpec", view: View, size: tuple[int, int]) -> None:
    """Give a model white above, soft light, and the camera of a view.

    Args:
        size: height and width of its pictures [px].
    """
    import mujoco
    from scipy.spatial.transform import Rotation

    from ._gl import CAMERA

    if not any(t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for t in spec.textures):
        sky = spec.add_texture(name=f"{CAMERA} sky", width=16, height=96)
        sky.type = mujoco.mjtTexture.mjTEXTURE_SKYBOX
        sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
        sky.rgb1 = sky.rgb2 = [1, 1, 1]
    bright = 0.35 if spec.lights else 0.6
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = [bright] * 3
    spec.visual.headlight.specular = [0.05] * 3
    spec.visual.quality.shadowsize = _SHADOW
    spec.visual.quality.offsamples = _SAMPLES
    spec.visual.global_.offheight, spec.visual.global_.offwidth = size
    spec.stat.center, spec.stat.extent = view.middle, view.wide
    spec.worldbody.add_camera(
        name=CAMERA,
        pos=view.middle + view.away * view.axes[2],
        quat=Rotation.from_matrix(view.axes.T).as_quat(scalar_first=True),
        fovy=view.fovy,
    )


def _build_lane(
    lane: Lane, heading: float, view: View, size: tuple[int, int]
) -> "MjModel":
    """A lane's body in its color, on a floor with squares, in the light, in view."""
    import mujoco

    spec = build_spec(lane.body)
    _paint_body(spec, lane)
    _add_floor(spec)
    furnish(spec, view, size)
    half = heading / 2
    spec.worldbody.add_geom(  # where it starts
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.006, 0.3, 0.0005],
        quat=[np.cos(half), 0, 0, np.sin(half)],
        rgba=[0.1, 0.12, 0.14, 1],
    )
    light = spec.lights[0]
    light.pos = [*view.middle[:2], 2]  # shadows fall about it
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.dir, light.diffuse, light.specular = [0, 0, -1], [0.5] * 3, [0.1] * 3
    return spec.compile()


def _paint_body(spec: "MjSpec", lane: Lane) -> None:
    """Color a body, and let beams carry its legs, as the drawn one has."""
    import mujoco
    from matplotlib.colors import to_rgba

    body, torso = lane.body, spec.body("torso")
    for part in body.anatomy.parts:
        for geom in spec.body(part).geoms:
            geom.rgba = to_rgba(lane.color)
    for hip in body.anchor[0][body.parent[0] == 0]:
        beam = torso.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.006, 0, 0])
        beam.fromto, beam.mass = [0, 0, 0, *hip], 0
    for geom in torso.geoms:
        geom.rgba = _TORSO


def _add_floor(spec: "MjSpec") -> None:
    """Squares below."""
    import mujoco

    squares = spec.add_texture(name="squares", width=256, height=256)
    squares.type = mujoco.mjtTexture.mjTEXTURE_2D
    squares.builtin = mujoco.mjtBuiltin.mjBUILTIN_CHECKER
    squares.rgb1, squares.rgb2 = [0.93, 0.94, 0.95], [0.84, 0.86, 0.88]
    textures = [""] * mujoco.mjtTextureRole.mjNTEXROLE
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "squares"
    # a plane shows half of a repeat, one square, in a unit of this
    spec.add_material(
        name="squares", textures=textures, texuniform=True, texrepeat=[1 / SQUARE] * 2
    )
    floor = spec.geom("floor")
    floor.material, floor.size = "squares", [20, 20, 0.1]


def make_film(
    lanes: Sequence[Lane], heading: float, caption: str, *, sample: float
) -> Html:
    """Walks below each other, every fifth of a second at double speed.

    Args:
        heading: direction that is shown to the right [rad].
        caption: below; also what a screen reader says.
        sample: seconds between the rows of a lane.
    """
    from PIL import features

    rows = range(0, count_common_rows(lanes), max(1, round(FRAME / sample)))
    shown = render_lanes(lanes, heading, rows) if features.check("webp") else None
    if shown is None:
        return draw_animation(lanes, heading, caption, sample=sample)
    squares = f" Rendered by MuJoCo; squares of {SQUARE} m, the dark line is the start."
    frames = join_strips([lane.title for lane in lanes], shown, beside=False)
    return embed_animation(
        encode_webp(frames, duration=FRAME / 2), "webp", caption + squares
    )


def join_strips(
    titles: Sequence[str], shown: np.ndarray, *, beside: bool
) -> list["Image"]:
    """Pictures of several strips, each below its title.

    Args:
        shown: (strips, frames, height, width, 3) uint8.
        beside: whether strips are beside each other, instead of below.
    """
    from PIL import Image, ImageDraw

    font, frames = _load_font(), []
    count, _, height, width = shown.shape[:4]
    columns, rows = (count, 1) if beside else (1, count)
    for strips in shown.swapaxes(0, 1):
        image = Image.new("RGB", (columns * width, rows * (_BAND + height)), PAPER)
        draw = ImageDraw.Draw(image)
        for k, (title, strip) in enumerate(zip(titles, strips, strict=True)):
            left, top = (k * width, 0) if beside else (0, k * (_BAND + height))
            draw.text((left + 4, top + 4), title, fill=INK, font=font)
            image.paste(Image.fromarray(strip), (left, top + _BAND))
        frames.append(image)
    return frames


def encode_webp(frames: Sequence["Image"], *, duration: float = 1.0) -> bytes:
    """One picture, or several as a moving one, each shown for a duration [s]."""
    return encode_frames(frames, "WEBP", duration=duration, quality=_QUALITY, method=2)


def _load_font() -> "FreeTypeFont":
    """The letters that matplotlib carries with it."""
    import matplotlib
    from PIL import ImageFont

    path = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(str(path), _LETTERS)

"""The robot of a diagnosis: poses and findings in, its film and its picture out."""

import base64
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats
from ..diagnosis.output.result import Diagnosis, PoseTrace
from ..recording import read_spec
from .marks import Mark, find_marks
from .motion import embed_animation
from .page import Html, Section, join_markup, make_figure
from .picture import BLUE, COLORS, GREEN, MUTED, shorten_label
from .render import (
    Scene,
    View,
    encode_webp,
    find_view,
    furnish,
    join_strips,
    render_scenes,
)

if TYPE_CHECKING:
    from mujoco import MjModel
    from numpy.typing import ArrayLike

_WIDTH = 480  # of each picture [px]; chosen: two of them fill the page
_FLATTEST, _STEEPEST = 0.45, 1.0  # height of a picture by its width; chosen
_ELEVATION = np.radians(20)  # of the camera above the horizon; chosen
_GHOST = 0.5  # opacity of the measured robot; chosen
_PLAIN = (0.72, 0.75, 0.78, 1.0)  # of a body without a finding; chosen
_SHORTEST = 4.0  # [s] that a film takes; chosen: what was faster is slowed down
_FARTHEST = 1e4  # [m] of a body, beyond which a model counts as diverged; chosen
_LINE = 0.045  # of names beside a picture, by its width; chosen
TITLE = "The robot"
NO_SHAPE = "There is no film of the robot: no body that moves has a geom."
NOTHING_RENDERS = (
    "There is no film and no picture of the robot: MuJoCo could not render here. It "
    "needs OpenGL by EGL or OSMesa (Debian: apt install libegl1 libgl1-mesa-dri), and "
    "MUJOCO_GL must not be 'disable'."
)


def make_robot_sections(diagnosis: Diagnosis) -> list[Section]:
    """The film of the worst stretch, and the robot with its findings lit.

    None of a diagnosis without poses.
    """
    if diagnosis.poses is None:
        return []
    poses = _hold_where_diverged(diagnosis.poses)
    built = _build_model(diagnosis.model, poses)
    if built is None:
        return [Section(TITLE, (NO_SHAPE,))]
    model, view = built
    marks, elsewhere = find_marks(model, diagnosis)
    scenes = _make_film_scenes(model, view, poses)
    scenes.append(_make_picture_scene(model, view, poses, marks))
    shown = render_scenes(scenes)
    if shown is None:
        return [Section(TITLE, (NOTHING_RENDERS,))]
    film = _embed_film(poses, np.stack(shown[:2]), bool(diagnosis.document["findings"]))
    if not marks:
        return [Section(TITLE, (film,))]
    picture = _embed_picture(shown[2][0], view, poses, marks, elsewhere)
    return [Section(TITLE, (picture, film))]


def _hold_where_diverged(poses: PoseTrace) -> PoseTrace:
    """The same poses, but for models that diverged: they stand still from then on."""

    def hold(given: Floats) -> Floats:
        near = np.abs(given[..., :3]) < _FARTHEST  # NaN is not
        known = int(np.logical_and.accumulate(near.all(axis=(1, 2))).sum())
        stands = given[known - 1] if known else poses.measured[0]
        after = np.repeat([stands], len(given) - known, axis=0)
        return np.concatenate([given[:known], after])

    return replace(poses, given=hold(poses.given), patched=hold(poses.patched))


def _build_model(path: str, poses: PoseTrace) -> tuple["MjModel", View] | None:
    """The model as given, compiled with light and a camera that sees the robot.

    None where the robot has no shape.
    """
    spec = read_spec(path)
    bare = spec.compile()
    geoms = np.flatnonzero(bare.body_weldid[bare.geom_bodyid])
    if not geoms.size:
        return None
    shown = np.concatenate([poses.measured, poses.patched])
    centers = np.stack([_follow_geom(bare, g, shown) for g in geoms.tolist()])
    apart = bare.geom_rbound[geoms, None, None] * np.vstack([np.eye(3), -np.eye(3)])
    corners = (centers[..., None, :] + apart[:, None]).reshape(-1, 3)
    heading = _find_motion(centers[..., :2])
    view = find_view(corners, heading, _ELEVATION, _FLATTEST, _STEEPEST)
    furnish(spec, view, _size_picture(view))
    return spec.compile(), view


def _follow_geom(model: "MjModel", geom: int, poses: Floats) -> Floats:
    """Where a geom's center is (F, 3) [m] when bodies are in poses (F, B, 7)."""
    from scipy.spatial.transform import Rotation

    pose = poses[:, model.geom_bodyid[geom] - 1]
    turn = Rotation.from_quat(pose[:, 3:], scalar_first=True)
    return pose[:, :3] + turn.apply(model.geom_pos[geom])


def _find_motion(places: Floats) -> float:
    """The horizontal direction [rad] along which geoms (G, F, 2) move most."""
    apart = (places - places.mean(axis=1, keepdims=True)).reshape(-1, 2)
    _, axes = np.linalg.eigh(apart.T @ apart)
    along = axes[:, -1] if apart.any() else np.array([1.0, 0.0])
    return float(np.arctan2(*(along * (1 if along[0] >= 0 else -1))[::-1]))


def _size_picture(view: View) -> tuple[int, int]:
    """Height and width [px]."""
    return round(_WIDTH * view.aspect), _WIDTH


def _paint_robot(model: "MjModel", color: "ArrayLike") -> Floats:
    """Colors (ngeom, 4) in which all bodies have one and the world its own."""
    paint = np.full((model.ngeom, 4), np.nan)
    paint[model.body_weldid[model.geom_bodyid] > 0] = color
    return paint


def _make_film_scenes(model: "MjModel", view: View, poses: PoseTrace) -> list[Scene]:
    """The model as given and the patched one, the measured robot over each."""
    from matplotlib.colors import to_rgba

    paint = _paint_robot(model, to_rgba(GREEN, _GHOST))
    ghost = {"ghost": poses.measured, "ghost_paint": paint}
    size, pairs = _size_picture(view), ((poses.given, MUTED), (poses.patched, BLUE))
    return [
        Scene(
            model, size, predicted, ghost | {"paint": _paint_robot(model, to_rgba(c))}
        )
        for predicted, c in pairs
    ]


def _make_picture_scene(
    model: "MjModel", view: View, poses: PoseTrace, marks: Iterable[Mark]
) -> Scene:
    """The measured robot at the stretch's begin, with marked bodies in color."""
    from matplotlib.colors import to_rgba

    paint = _paint_robot(model, _PLAIN)
    for mark, color in _color_marks(marks):
        paint[model.geom_bodyid == mark.body] = to_rgba(color)
    return Scene(model, _size_picture(view), poses.measured[:1], {"paint": paint})


def _color_marks(marks: Iterable[Mark]) -> list[tuple[Mark, str]]:
    """Each mark with the color of its body."""
    marks = list(marks)
    bodies = list(dict.fromkeys(mark.body for mark in marks))
    return [(m, COLORS[bodies.index(m.body) % len(COLORS)]) for m in marks]


def _embed_film(poses: PoseTrace, shown: np.ndarray, is_named: bool) -> Html:
    """The two pictures beside each other, moving."""
    titles = (
        "the model as given",
        "with the findings" if is_named else "with stated values re-fitted",
    )
    took = float(np.ptp(poses.time))
    takes = max(took, _SHORTEST)
    slower = f" ({takes / took:.2g} times slower)" if takes > 1.05 * took else ""
    caption = (
        f"Green: the robot as measured, over what each model predicts, in the held-out "
        f"stretch in which it was worst: {took:.3g} s of episode {poses.episode} from "
        f"{poses.time[0]:.3g} s, shown in {takes:.3g} s{slower}. Rendered by MuJoCo."
    )
    if poses.unread:
        names = ", ".join(map(shorten_label, poses.unread[:3]))
        more = ", ..." if len(poses.unread) > 3 else ""
        caption += (
            f" Nothing reads {names}{more}: there the green robot moves as the model "
            "as given."
        )
    frames = join_strips(titles, shown, beside=True)
    film = encode_webp(frames, duration=takes / len(frames))
    return embed_animation(film, "webp", caption)


def _embed_picture(
    shown: np.ndarray,
    view: View,
    poses: PoseTrace,
    marks: list[Mark],
    elsewhere: list[str],
) -> Html:
    """The picture of the robot, with lines from its lit places to their names.

    Args:
        shown: (height, width, 3) uint8.
        poses: of which the first measured ones are shown.
        elsewhere: findings that are nowhere on the robot.
    """
    from PIL import Image
    from scipy.spatial.transform import Rotation

    pose = poses.measured[0, [mark.body - 1 for mark in marks]]
    turn = Rotation.from_quat(pose[:, 3:], scalar_first=True)
    points = pose[:, :3] + turn.apply([mark.point for mark in marks])
    at = _WIDTH * view.project(points)
    step, colored = _LINE * _WIDTH, _color_marks(marks)
    height = max(shown.shape[0], step * (len(marks) + 1))
    lines: list[Html] = []
    top = step
    for i in np.argsort(at[:, 1], kind="stable"):
        y = max(top, float(at[i, 1]))
        y = min(y, height - step * (len(marks) - len(lines) - 0.5))
        top = y + step
        lines.append(_draw_mark(colored[i], at[i], y))
    caption = "What the findings are about, on the robot as measured."
    if elsewhere:
        caption += f" Not of one part: {', '.join(elsewhere)}."
    still = base64.b64encode(encode_webp([Image.fromarray(shown)])).decode("ascii")
    picture = Html(
        '<svg role="img" aria-label="{}" viewBox="0 0 {} {:.0f}"><image width="{}" '
        'height="{}" href="data:image/webp;base64,{}"/>{}</svg>'
    ).format(
        caption,
        2 * _WIDTH,
        height,
        _WIDTH,
        shown.shape[0],
        Html(still),
        join_markup(*lines),
    )
    return make_figure(picture, caption=caption)


def _draw_mark(colored: tuple[Mark, str], place: Floats, y: float) -> Html:
    """A mark's name at a height beside the picture, and a line to its place (2)."""
    (mark, color), (x, end), size = colored, place, 0.7 * _LINE * _WIDTH
    return Html(
        '<path d="M{x:.1f} {end:.1f}L{left:.1f} {y:.1f}" stroke="{color}" '
        'stroke-width="1.5" fill="none"/><circle cx="{x:.1f}" cy="{end:.1f}" r="4" '
        'fill="{color}"/><text x="{right}" y="{base:.1f}" font-size="{size:.1f}" '
        'fill="var(--ink)">{name}</text>'
    ).format(
        x=x,
        end=end,
        left=_WIDTH,
        right=_WIDTH + 6,
        y=y,
        base=y + size / 3,
        size=size,
        color=color,
        name=mark.name,
    )

"""A walk as a drawn animation: where a body was over time in, a GIF on the page out."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Bodies, Floats
from .page import Html, make_figure
from .picture import INK, LINE, MUTED, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

FRAME = 0.2  # [s] of a walk from picture to picture, shown in half of it; chosen
_DEPTH = 0.3  # of what lies across, seen from the side and above; chosen
_DPI = 72
_TORSO = "#98a2ad"


@dataclass(frozen=True)
class Lane:
    """One walk to draw.

    Attributes:
        title: above it.
        color: of the legs.
        body: a batch of one.
        position: (S, 3) of the torso [m].
        orientation: (S, 4) quaternion.
        angles: (S, P) of the joints [rad].
    """

    title: str
    color: str
    body: Bodies
    position: Floats
    orientation: Floats
    angles: Floats


def _build_rotation(quat: Floats) -> Floats:
    """(3, 3) of a unit quaternion w x y z."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(quat, scalar_first=True).as_matrix()


def pose_skeleton(
    body: Bodies, position: Floats, orientation: Floats, angles: Floats
) -> Floats:
    """Where a posed body's parts are.

    Args:
        position: (3) of the torso [m].
        orientation: (4) of the torso, quaternion.
        angles: (P) of the joints [rad].

    Returns:
        (P, 2, 3) joint and tip of each part [m], world frame.
    """
    from scipy.spatial.transform import Rotation

    heading = Rotation.from_rotvec(body.heading[0][:, None] * [0.0, 0, 1])
    bend = Rotation.from_rotvec(body.axis[0] * np.asarray(angles)[:, None])
    own = (heading * bend).as_matrix()
    turns, spots = [_build_rotation(orientation)], [np.asarray(position, float)]
    ends = []
    for i in range(body.anatomy.size):
        up = int(body.parent[0, i])
        turns.append(turns[up] @ own[i])
        spots.append(spots[up] + turns[up] @ body.anchor[0, i])
        ends.append([spots[-1], spots[-1] + turns[-1][:, 0] * body.length[0, i]])
    return np.array(ends)


def _project_points(points: Floats, heading: float) -> Floats:
    """(..., 2) world points seen from the right of the heading, a little above."""
    c, s = np.cos(heading), np.sin(heading)
    along = c * points[..., 0] + s * points[..., 1]
    across = c * points[..., 1] - s * points[..., 0]
    return np.stack([along, points[..., 2] + _DEPTH * across], axis=-1)


def draw_animation(
    lanes: Sequence[Lane], heading: float, caption: str, *, sample: float
) -> Html:
    """Walks below each other, drawn every fifth of a second at double speed.

    Args:
        heading: direction that is drawn to the right [rad].
        caption: below; also what a screen reader says.
        sample: seconds between the rows of a lane.
    """
    frames = _draw_frames(lanes, heading, max(1, round(FRAME / sample)))
    film = encode_frames(frames, "GIF", duration=FRAME / 2, optimize=True)
    return embed_animation(film, "gif", caption)


def encode_frames(
    frames: Sequence["Image"], kind: str, *, duration: float, **how: object
) -> bytes:
    """One picture, or several as a moving one.

    Args:
        frames: at least one.
        kind: "GIF" or "WEBP".
        duration: that each is shown [s].
        how: to write that kind, as Pillow takes it.
    """
    buffer, (first, *others) = io.BytesIO(), frames
    how |= {"save_all": True, "append_images": others, "loop": 0}
    first.save(buffer, kind, duration=round(1000 * duration), **how)
    return buffer.getvalue()


def embed_animation(picture: bytes, kind: str, caption: str) -> Html:
    """A moving picture with its caption, inline.

    Args:
        kind: "gif" or "webp".
    """
    coded = base64.b64encode(picture).decode("ascii")
    shown = Html('<img alt="{}" src="data:image/{};base64,{}">')
    return make_figure(shown.format(caption, kind, Html(coded)), caption=caption)


def count_common_rows(lanes: Sequence[Lane]) -> int:
    """How many rows all lanes have."""
    return min(len(lane.position) for lane in lanes)


def _draw_frames(lanes: Sequence[Lane], heading: float, every: int) -> list["Image"]:
    """The pictures, with few colors so that they stay small."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL.Image import frombytes

    paths = [_project_points(lane.position * [1, 1, 0], heading) for lane in lanes]
    low, bottom = np.min([path.min(axis=0) for path in paths], axis=0) - [0.3, 0.18]
    high, top = np.add(np.max([p.max(axis=0) for p in paths], axis=0), [0.3, 0.32])
    high = max(high, low + 1.2)
    size = WIDTH, WIDTH * (top - bottom) / (high - low) * len(lanes)
    fig = Figure(figsize=size, dpi=_DPI, facecolor="white")
    canvas, frames = FigureCanvasAgg(fig), []
    axes = fig.subplots(len(lanes), 1, squeeze=False)[:, 0]
    fig.subplots_adjust(0, 0, 1, 1, hspace=0)
    for k in range(0, count_common_rows(lanes), every):
        for ax, lane in zip(axes, lanes, strict=True):
            ax.clear()
            ax.set_xlim(low, high)
            ax.set_ylim(bottom, top)
            ax.set_axis_off()
            _draw_walk(ax, lane, k, heading, (low, high, top))
        canvas.draw()
        drawn = bytes(canvas.buffer_rgba())
        image = frombytes("RGBA", canvas.get_width_height(), drawn)
        frames.append(image.convert("RGB").quantize(32))
    return frames


def _draw_walk(
    ax: "Axes", lane: Lane, k: int, heading: float, ends: tuple[float, float, float]
) -> None:
    """One walk at one time, in a window from left to right, its top last."""
    ax.plot(ends[:2], (0, 0), color=LINE, lw=1, zorder=0)
    for mark in np.arange(0, ends[1], 0.5):
        ax.plot((mark, mark), (-0.02, 0.0), color=MUTED, lw=0.8, zorder=0)
        ticks = {"color": MUTED, "fontsize": 7, "ha": "center", "va": "top"}
        ax.text(mark, -0.03, f"{mark:.1f} m", ticks)
    ax.text(ends[0] + 0.02, ends[2] - 0.05, lane.title, color=INK, fontsize=10)
    path = _project_points(lane.position[: k + 1] * [1, 1, 0], heading)
    ax.plot(*path.T, color=lane.color, lw=0.8, alpha=0.5, zorder=1)
    _draw_legs(ax, lane, k, heading)


def _draw_legs(ax: "Axes", lane: Lane, k: int, heading: float) -> None:
    """The torso and the parts, far ones first."""
    from matplotlib.patches import Polygon
    from scipy.spatial import ConvexHull

    place, turn = lane.position[k], lane.orientation[k]
    parts = pose_skeleton(lane.body, place, turn, lane.angles[k])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = place + (signs * lane.body.anatomy.torso_half) @ _build_rotation(turn).T
    flat = _project_points(corners, heading)
    hull = flat[ConvexHull(flat).vertices]
    away = parts[..., 1].mean(axis=1) * np.cos(heading)
    away = away - parts[..., 0].mean(axis=1) * np.sin(heading)
    middle = place[1] * np.cos(heading) - place[0] * np.sin(heading)
    ax.add_patch(Polygon(hull, facecolor=_TORSO, edgecolor=MUTED, lw=0.6, zorder=3))
    for hip in parts[lane.body.parent[0] == 0, 0]:
        beam = _project_points(np.array([place, hip]), heading)
        ax.plot(*beam.T, color=_TORSO, lw=3, zorder=2)
    for i in np.argsort(-away, kind="stable"):
        seen = _project_points(parts[i], heading)
        thick = 6 * min(1.0, float(lane.body.thickness[0, i]) + 0.2)
        alpha, zorder = (0.55, 2) if away[i] > middle else (1.0, 4)
        (part,) = ax.plot(*seen.T, color=lane.color, lw=thick, alpha=alpha)
        part.set(solid_capstyle="round", zorder=zorder)

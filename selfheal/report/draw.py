"""Bodies drawn in 3-D at zero joint angles: body and camera in, polygons on axes out.

Convex pieces, back faces left out, the far ones drawn first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Bodies, Floats, part_points, planar_frames
from .picture import BLUE, INK, LINE, MUTED, ORANGE, PAPER, bare

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RIGHT, WRONG, NEUTRAL = BLUE, ORANGE, "#4f86b0"
_TORSO = "#98a2ad"
_LIGHT = np.array([-0.35, 0.5, 0.8]) / np.linalg.norm([-0.35, 0.5, 0.8])
_SIDES = 6  # of the prism that stands for a capsule
# corners of a face of [-1, 1]^3, counterclockwise seen from outside, for +x, +y, +z
_QUAD = np.array([[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]], float)
_CUBE = [np.roll(_QUAD, k, axis=1) for k in range(3)]
_CUBE += [-face[::-1] for face in _CUBE]


@dataclass(frozen=True)
class Camera:
    """Where a body is looked at from; the picture's plane goes through the target.

    Attributes:
        azimuth: of the camera about z, from the torso's x [rad]; pi = from behind.
        elevation: above the horizon [rad].
        distance: from the target [m].
        target: (3) what it looks at, in the torso's frame [m].
    """

    azimuth: float
    elevation: float
    distance: float
    target: Floats = field(default_factory=lambda: np.zeros(3))

    @property
    def axes(self) -> Floats:
        """(3, 3) rows: right, up, toward the camera."""
        a, e = self.azimuth, self.elevation
        toward = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        right = [-np.sin(a), np.cos(a), 0.0]
        return np.array([right, np.cross(toward, right), toward])

    def project(self, points: Floats) -> Floats:
        """(..., 3) right, up and depth (near is large) of points (..., 3) [m]."""
        seen = (points - self.target) @ self.axes.T
        seen[..., :2] *= self.distance / (self.distance - seen[..., 2:])
        return seen


PLAN = Camera(np.pi, np.pi / 2, 4.0)
PERSPECTIVE = Camera(np.radians(212), np.radians(38), 1.6)


def _box(bodies: Bodies) -> tuple[Floats, Floats]:
    """Middle (N, 3) and half sides (N, 2) of the floor plan of N bodies [m]."""
    origin, tips = planar_frames(bodies)[0], part_points(bodies, 1.0)
    torso = np.ones((len(bodies), 1, 2)) * bodies.anatomy.rim[:2]
    points = [torso, -torso, origin[:, 1:, :2], tips[..., :2]]
    flat = np.concatenate(points, axis=1)
    low, high = flat.min(axis=1), flat.max(axis=1)
    middle = np.column_stack([(low + high) / 2, np.zeros(len(bodies))])
    return middle, (high - low) / 2


def reach(bodies: Bodies) -> float:
    """Half the width of a picture that holds any of these bodies [m]."""
    return float(np.linalg.norm(_box(bodies)[1], axis=1).max())


def draw(
    ax: "Axes",
    bodies: Bodies,
    row: int = 0,
    *,
    camera: Camera,
    colors: Sequence[str],
    half: float,
    numbers: bool = False,
) -> None:
    """Draw one body, its middle in the middle.

    Args:
        ax: takes the drawing, and nothing else.
        bodies: a batch.
        row: which of them.
        camera: see `Camera`.
        colors: of each part.
        half: half the width of what is seen [m], as `reach` gives it.
        numbers: whether parts carry their numbers, from 1.
    """
    from matplotlib.collections import PolyCollection

    camera = replace(camera, target=_box(bodies[row : row + 1])[0][0])
    faces, paints = _faces(bodies, row, colors)
    seen = [camera.project(face) for face in faces]
    front = [k for k, face in enumerate(seen) if _area(face) > 0]
    front.sort(key=lambda k: seen[k][:, 2].mean())
    _rim(ax, bodies, camera)
    ax.add_collection(
        PolyCollection(
            [seen[k][:, :2] for k in front],
            facecolors=[_shaded(paints[k], faces[k]) for k in front],
            edgecolors=[_shaded(paints[k], faces[k], 0.72) for k in front],
            linewidths=0.3,
            joinstyle="round",
            zorder=2,
        )
    )
    if numbers:
        _numbers(ax, bodies, row, camera, colors)
    bare(ax)
    ax.set_xlim(-1.06 * half, 1.06 * half)
    high = 1.06 * half * max(np.sin(camera.elevation), 0.62)
    ax.set_ylim(-high, high)


def _faces(
    bodies: Bodies, row: int, colors: Sequence[str]
) -> tuple[list[Floats], list[str]]:
    """Outlines (k, 3) [m] of a body's faces, and their colors."""
    a = bodies.anatomy
    origin, heading = (x[row] for x in planar_frames(bodies))
    faces = [c * a.torso_half for c in _CUBE]
    paints = [_TORSO] * len(faces)
    for i in range(a.size):
        c, s = np.cos(heading[i + 1]), np.sin(heading[i + 1])
        turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        local = _part(bodies, row, i)
        faces += [face @ turn + origin[i + 1] for face in local]
        paints += [colors[i]] * len(local)
    return faces, paints


def _part(bodies: Bodies, row: int, i: int) -> list[Floats]:
    """A part's faces in its own frame: its housing, and its rod beyond the housing."""
    a, scale = bodies.anatomy, bodies.thickness[row, i]
    half, center = a.block_half[i] * scale, a.block_center[i] * scale
    length, radius = bodies.length[row, i], a.radius[i] * scale
    faces, start = [], 0.0
    if a.block_mass[i] > 0:
        faces = [c * half + [center, 0, 0] for c in _CUBE]
        start = max(0.0, center + half[0])
    return faces + (_rod(start, length, radius) if length > start else [])


def _rod(start: float, end: float, radius: float) -> list[Floats]:
    """Faces of a prism round the x axis."""
    angle = np.pi / _SIDES + 2 * np.pi * np.arange(_SIDES + 1) / _SIDES
    y, z = radius * np.cos(angle), radius * np.sin(angle)
    ends = [np.column_stack([np.full(_SIDES + 1, x), y, z]) for x in (start, end)]
    near, far = ends
    sides = [
        np.array([near[k], far[k], far[k + 1], near[k + 1]]) for k in range(_SIDES)
    ]
    return [*(side[::-1] for side in sides), far[:-1], near[:-1][::-1]]


def _area(face: Floats) -> float:
    """Twice the signed area of a projected outline; positive if it faces the camera."""
    x, y = face[:, 0], face[:, 1]
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _shaded(color: str, face: Floats, factor: float = 1.0) -> tuple[float, ...]:
    """A face's color in the light."""
    from matplotlib.colors import to_rgb

    normal = np.cross(face[1] - face[0], face[2] - face[1])
    normal /= max(float(np.linalg.norm(normal)), 1e-12)
    bright = factor * (0.72 + 0.34 * max(0.0, float(normal @ _LIGHT)))
    return tuple(min(1.0, bright * c) for c in to_rgb(color))


def _rim(ax: "Axes", bodies: Bodies, camera: Camera) -> None:
    """The rectangle where parts attach to the torso, and an arrow forward."""
    x, y, z = bodies.anatomy.rim
    corners = np.array([[x, y, z], [x, -y, z], [-x, -y, z], [-x, y, z], [x, y, z]])
    seen = camera.project(corners)
    ax.plot(seen[:, 0], seen[:, 1], color=MUTED, lw=0.7, ls=(0, (3, 2)), zorder=1)
    top = float(bodies.anatomy.torso_half[2])
    size = 0.6 * float(bodies.anatomy.torso_half[:2].min())
    arrow = np.array([[size, 0, top], [-size / 2, size / 2, top],
                      [-size / 2, -size / 2, top]])  # fmt: skip
    seen = camera.project(arrow)
    ax.fill(seen[:, 0], seen[:, 1], color=LINE, lw=0, zorder=3)


def _numbers(
    ax: "Axes", bodies: Bodies, row: int, camera: Camera, colors: Sequence[str]
) -> None:
    """Each part's number on its middle."""
    origin, heading = (x[row] for x in planar_frames(bodies))
    for i in range(bodies.anatomy.size):
        along = np.array([np.cos(heading[i + 1]), np.sin(heading[i + 1]), 0])
        middle = origin[i + 1] + 0.62 * bodies.length[row, i] * along
        x, y, _ = camera.project(middle)
        badge = {"boxstyle": "circle,pad=0.22", "fc": PAPER, "ec": colors[i], "lw": 1}
        ax.text(x, y, str(i + 1), ha="center", va="center", fontsize=7.5, color=INK,
                bbox=badge, zorder=4)  # fmt: skip

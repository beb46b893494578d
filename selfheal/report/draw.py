"""Bodies drawn in 3-D at zero joint angles: body and camera in, polygons on axes out.

Convex pieces, back faces left out, the far ones drawn first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Bodies, Floats, compute_part_points, compute_rest_frames
from .picture import BLUE, INK, LINE, MUTED, ORANGE, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RIGHT, WRONG, NEUTRAL = BLUE, ORANGE, "#4f86b0"
_TORSO = "#98a2ad"
_LIGHT = np.array([-0.35, 0.5, 0.8]) / np.linalg.norm([-0.35, 0.5, 0.8])
_MARGIN = 1.07  # round a body, for the thickness of its parts; chosen
_AWAY = 5.0  # times a body's farthest point: a camera's distance; chosen
_SIDES = 6  # of the prism that stands for a capsule


def _pad_faces(faces: list[Floats]) -> Floats:
    """(F, _SIDES, 3) faces of fewer corners with their last one repeated."""
    last = [np.repeat(f[-1:], _SIDES - len(f), axis=0) for f in faces]
    return np.array([np.concatenate(pair) for pair in zip(faces, last, strict=True)])


def _build_cube() -> Floats:
    """(6, _SIDES, 3) faces of [-1, 1]^3, counterclockwise seen from outside."""
    face = np.array([[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]], float)
    faces = [np.roll(face, k, axis=1) for k in range(3)]
    return _pad_faces([*faces, *(-f[::-1] for f in faces)])


def _build_prism() -> Floats:
    """(_SIDES + 2, _SIDES, 3) faces of a prism of radius 1 round x, from x = 0 to 1."""
    angle = 2 * np.pi * (np.arange(_SIDES + 1) + 0.5) / _SIDES
    near = np.column_stack([0 * angle, np.cos(angle), np.sin(angle)])
    far = np.add(near, [1, 0, 0])
    sides = np.stack([near[1:], far[1:], far[:-1], near[:-1]], axis=1)
    return _pad_faces([*sides, far[:-1], near[:-1][::-1]])


@dataclass(frozen=True)
class Camera:
    """Where a body is looked at from; the picture's plane goes through the target.

    Attributes:
        azimuth: of the camera about z, from the torso's x [rad]; pi = from behind.
        elevation: above the horizon [rad].
        distance: from the target [m].
        target: (3) what it looks at, in the torso's frame [m].
        at: (3) where that is in the picture; the last is 0.
    """

    azimuth: float
    elevation: float
    distance: float
    target: Floats = field(default_factory=lambda: np.zeros(3))
    at: Floats = field(default_factory=lambda: np.zeros(3))

    @property
    def axes(self) -> Floats:
        """(3, 3) rows: right, up, toward the camera."""
        a, e = self.azimuth, self.elevation
        toward = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        right = [-np.sin(a), np.cos(a), 0.0]
        return np.array([right, np.cross(toward, right), toward])

    def move(self, x: float, y: float) -> "Camera":
        """This view with its target at another place of the picture."""
        return replace(self, at=np.array([x, y, 0.0]))

    def project(self, points: Floats) -> Floats:
        """(..., 3) right, up and depth (near is large) of points (..., 3) [m]."""
        seen = (points - self.target) @ self.axes.T
        seen[..., :2] *= self.distance / (self.distance - seen[..., 2:])
        return seen + self.at


def _list_corners(bodies: Bodies, row: int) -> Floats:
    """(M, 3) corners of the torso and of its rim, joints and tips of one body [m]."""
    a = bodies.anatomy
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    rim = np.array([1.0, 1, 0]) * a.rim
    ends = compute_rest_frames(bodies)[0][row], compute_part_points(bodies, 1.0)[row]
    return np.concatenate([signs * a.torso_half, signs * rim, *ends])


def _find_middle(bodies: Bodies, row: int) -> Floats:
    """(3) middle of one body's floor plan, at the height of the torso's center [m]."""
    points = _list_corners(bodies, row)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle * [1, 1, 0]


def _find_distance(bodies: Bodies) -> float:
    """How far a camera stands from any of these bodies' middle [m]."""
    apart = [
        _list_corners(bodies, row) - _find_middle(bodies, row)
        for row in range(len(bodies))
    ]
    return _AWAY * float(np.linalg.norm(apart, axis=-1).max())


def look_from_above(bodies: Bodies) -> Camera:
    """A camera that sees any of these bodies in plan, forward up."""
    return Camera(np.pi, np.pi / 2, _find_distance(bodies))


def look_from_behind(bodies: Bodies) -> Camera:
    """A camera that sees any of these bodies from behind, on the right and above."""
    return Camera(np.radians(212), np.radians(38), _find_distance(bodies))


def measure_window(bodies: Bodies, camera: Camera) -> Floats:
    """(2) half the width and height [m] of a view that holds any of these bodies."""
    seen = []
    for row in range(len(bodies)):
        aimed = replace(camera, target=_find_middle(bodies, row))
        seen.append(aimed.project(_list_corners(bodies, row))[:, :2])
    return _MARGIN * np.abs(seen).max(axis=(0, 1))


def draw_body(
    ax: "Axes", body: Bodies, *, camera: Camera, colors: Sequence[str]
) -> None:
    """Draw one body, its middle where the camera has it, a meter as one unit.

    Args:
        camera: its target is moved to the body's middle.
        colors: of each part.
    """
    camera = replace(camera, target=_find_middle(body, 0))
    _draw_rim(ax, body, camera)
    _draw_faces(ax, camera, *_build_faces(body, 0, colors))


def draw_pale(ax: "Axes", bodies: Bodies, behind: Bodies, camera: Camera) -> None:
    """Draw bodies pale behind another one, with its torso."""
    camera = replace(camera, target=_find_middle(behind, 0))
    for row in range(len(bodies)):
        faces = _build_faces(bodies, row, [LINE] * bodies.anatomy.size)
        _draw_faces(ax, camera, *faces, zorder=0)


def _draw_faces(
    ax: "Axes", camera: Camera, faces: Floats, paints: Floats, zorder: float = 2
) -> None:
    """Draw faces (F, _SIDES, 3) [m] in their colors (F, 3)."""
    from matplotlib.collections import PolyCollection

    seen = camera.project(faces)
    front = np.flatnonzero(_compute_normals(seen)[:, 2] > 0)
    front = front[np.argsort(seen[front, :, 2].mean(axis=1), kind="stable")]
    shaded = _shade_colors(paints[front], _compute_normals(faces)[front])
    ax.add_collection(
        PolyCollection(
            [_trim_face(face[:, :2]) for face in seen[front]],
            facecolors=shaded,
            edgecolors=0.75 * shaded,
            linewidths=0.3,
            joinstyle="round",
            zorder=zorder,
        ),
        autolim=False,
    )


def _build_faces(
    bodies: Bodies, row: int, colors: Sequence[str]
) -> tuple[Floats, Floats]:
    """(F, _SIDES, 3) faces of a body in the torso's frame [m], (F, 3) their colors."""
    from matplotlib.colors import to_rgb

    a = bodies.anatomy
    origin, frame = (x[row] for x in compute_rest_frames(bodies))
    faces, paints = [_build_cube() * a.torso_half], [_TORSO] * 6
    for i in range(a.size):
        local = _build_part(bodies, row, i)
        faces.append(local @ frame[i + 1].T + origin[i + 1])
        paints += [colors[i]] * len(local)
    return np.concatenate(faces), np.array([to_rgb(p) for p in paints])


def _build_part(bodies: Bodies, row: int, i: int) -> Floats:
    """(F, _SIDES, 3) a part's faces in its frame: housing, rod beyond it [m]."""
    a, scale = bodies.anatomy, bodies.thickness[row, i]
    length, radius = bodies.length[row, i], a.radius[i] * scale
    faces, start = [], 0.0
    if a.block_mass[i] > 0:
        half, center = a.block_half[i] * scale, a.block_center[i] * scale
        faces.append(_build_cube() * half + [center, 0, 0])
        start = max(0.0, center + half[0])
    if length > start or not faces:
        faces.append(_build_prism() * [length - start, radius, radius] + [start, 0, 0])
    return np.concatenate(faces)


def _compute_normals(faces: Floats) -> Floats:
    """(F, 3) normals of faces (F, k, 3), as long as twice their area (Newell)."""
    following = np.roll(faces, -1, axis=1)
    return np.cross(faces, following).sum(axis=1)


def _trim_face(face: Floats) -> Floats:
    """A face without the corners that `_padded` repeated."""
    new = np.append(True, (face[1:] != face[:-1]).any(axis=1))
    return face[new]


def _shade_colors(paints: Floats, normals: Floats) -> Floats:
    """(F, 3) colors of faces in the light."""
    size = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    bright = 0.72 + 0.34 * np.maximum(0.0, normals @ _LIGHT / size)
    return np.clip(bright[:, None] * paints, 0, 1)


def _draw_rim(ax: "Axes", bodies: Bodies, camera: Camera) -> None:
    """The rectangle where parts attach to the torso, and an arrow forward."""
    x, y, z = bodies.anatomy.rim
    corners = np.array([[x, y, z], [x, -y, z], [-x, -y, z], [-x, y, z], [x, y, z]])
    seen = camera.project(corners)
    ax.plot(seen[:, 0], seen[:, 1], color=MUTED, lw=0.7, ls=(0, (3, 2)), zorder=1)
    top = float(bodies.anatomy.torso_half[2])
    size = 0.6 * float(bodies.anatomy.torso_half[:2].min())
    arrow = np.array(
        [[size, 0, top], [-size / 2, size / 2, top], [-size / 2, -size / 2, top]]
    )
    seen = camera.project(arrow)
    ax.fill(seen[:, 0], seen[:, 1], color=LINE, lw=0, zorder=3)


def write_numbers(
    ax: "Axes", body: Bodies, camera: Camera, colors: Sequence[str]
) -> None:
    """Write each part's number, from 1, on its middle, ringed in the part's color."""
    camera = replace(camera, target=_find_middle(body, 0))
    points = compute_part_points(body, 0.62)[0]
    for i, middle in enumerate(points):
        x, y, _ = camera.project(middle)
        badge = {"boxstyle": "circle,pad=0.22", "fc": PAPER, "ec": colors[i], "lw": 1}
        text = ax.text(x, y, str(i + 1), fontsize=7.5, color=INK, bbox=badge, zorder=4)
        text.set(ha="center", va="center")

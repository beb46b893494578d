"""Inertias that no body can have: takes a spec, makes the nearest ones that one can."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..printable import quote_name
from ..recording.data import Floats

if TYPE_CHECKING:
    import mujoco

# share of the largest second moment of mass that every one has: of a body that is a
# thousand times longer than thick; chosen
_LEAST_SHARE = 1e-6
_FULL = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])  # MJCF's order of a full inertia


def mend_inertias(spec: "mujoco.MjSpec") -> Iterator[str]:
    """Change stated inertias that break A + B >= C; what was done."""
    for body in spec.bodies:
        if not body.explicitinertial:
            continue
        is_full = bool(np.isfinite(body.fullinertia[0]))
        stated = np.diag(np.array(body.inertia))
        if is_full:
            stated = np.zeros((3, 3))
            stated[_FULL] = body.fullinertia
            stated = stated + np.triu(stated, 1).T
        possible = find_possible_inertia(stated)
        if np.allclose(possible, stated, rtol=1e-9, atol=0):
            continue
        if is_full:
            body.fullinertia = possible[_FULL]
        else:
            body.inertia = np.diag(possible)
        yield (
            f"link {quote_name(body.name)}: its inertia is of no body (A + B < C); "
            "replaced by the nearest one that is possible"
        )


def find_possible_inertia(inertia: Floats) -> Floats:
    """The nearest inertia that a body can have, to one (3, 3) [kg m^2].

    Its second moments of mass, tr(I)/2 - I, are positive (Wensing, Kim and Slotine
    2018, IEEE RA-L 3).
    """
    moments, axes = np.linalg.eigh(np.trace(inertia) / 2 * np.eye(3) - inertia)
    moments = np.maximum(moments, _LEAST_SHARE * moments.max())
    return axes @ (moments.sum() * np.eye(3) - np.diag(moments)) @ axes.T

"""Engines: bodies and joint targets in, readings at rest out, at three fidelities."""

from typing import TYPE_CHECKING

from ..errors import UnknownNameError

if TYPE_CHECKING:
    from .readings import Engine

ENGINES = {
    "auto": "statics for the search, mjx to confirm rivals, mujoco to check the result",
    "statics": "quasi-static: tipped from contact to contact, the fastest",
    "mjx": "one free body whose parts follow its servos, batched by MJX",
    "mujoco": "the articulated body in native MuJoCo, the reference",
}


def make_engine(name: str) -> "Engine":
    """The engine "statics", "mjx" or "mujoco".

    Raises:
        UnknownNameError: no such engine.
    """
    if name == "statics":
        from .statics import Statics

        return Statics()
    if name == "mjx":
        from .mjx import Mjx

        return Mjx()
    if name == "mujoco":
        from .mujoco import MuJoCo

        return MuJoCo()
    raise UnknownNameError("engine", name, ENGINES)

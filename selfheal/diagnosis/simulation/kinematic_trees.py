"""Kinematic trees: takes a robot and terms, gives what belongs to which tree.

Trees that nothing couples, as the legs of a robot whose trunk is held, move each by
its own values. MuJoCo numbers them (`body_treeid`).
"""

from collections.abc import Sequence

import numpy as np

from ..data.robot_summary import Channel
from ..effects.base import Term
from .simulator import Simulator

NO_TREE = -1  # of what is in several trees, or in none


def find_trees(
    simulator: Simulator, terms: Sequence[Term]
) -> tuple[np.ndarray, np.ndarray]:
    """The tree of each parameter (P) of terms, and of each column (C) of readings.

    Args:
        simulator: of the robot.
        terms: P parameters in all.

    Returns:
        Numbers of trees, `NO_TREE` of what is in several.
    """
    model = simulator.compiler.compile_variant(terms).model
    of_channel = {c.name: _find_tree_of_channel(model, c) for c in simulator.channels}
    of_column = np.concatenate(
        [np.full(c.width, of_channel[c.name]) for c in simulator.channels]
    )
    of_value = []
    for term in terms:
        trees = {
            of_channel.get(name, NO_TREE)
            if kind == "sensor"
            else _find_tree(model, kind, name)
            for kind, _, name in (
                target.partition("/")[0].partition(":") for target in term.targets
            )
        }
        tree = trees.pop() if len(trees) == 1 else NO_TREE
        of_value += [tree] * len(term.parameters)
    return np.array(of_value, int), of_column


def _find_tree_of_channel(model, channel: Channel) -> int:
    """The tree that a signal is read in."""
    return _find_tree(model, channel.kind.partition("_")[0], channel.target)


def _find_tree(model, kind: str, name: str) -> int:
    """The tree of the body that an element of the model moves, by its kind and name."""
    import mujoco

    if kind not in ("joint", "body", "geom", "actuator"):
        return NO_TREE
    which = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
    i = mujoco.mj_name2id(model, which, name)
    if i < 0:
        return NO_TREE
    if kind == "actuator":
        if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT:
            return NO_TREE
        kind, i = "joint", model.actuator_trnid[i, 0]
    bodies = {"joint": model.jnt_bodyid, "geom": model.geom_bodyid}
    return int(model.body_treeid[bodies[kind][i] if kind in bodies else i])

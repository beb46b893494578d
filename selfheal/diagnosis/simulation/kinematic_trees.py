"""Kinematic trees: takes a robot and terms, gives the tree of what they have.

Trees that nothing couples, as the legs of a robot whose trunk is held, move each by
its own values. MuJoCo numbers them (`body_treeid`).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Term
from .simulator import Simulator

if TYPE_CHECKING:
    from mujoco import MjModel

NO_TREE = -1  # of what is in several trees, or in none


def find_column_trees(simulator: Simulator, terms: Sequence[Term]) -> np.ndarray:
    """(C) the tree of each column of readings, `NO_TREE` of what is read in several.

    Args:
        terms: of a hypothesis, which may add joints.
    """
    of_channel = _find_channel_trees(simulator, terms)
    widths = [c.width for c in simulator.channels]
    return np.repeat([of_channel[c.name] for c in simulator.channels], widths)


def find_state_trees(simulator: Simulator, terms: Sequence[Term]) -> np.ndarray:
    """(2 nv) the tree of each initial state: positions, then velocities.

    Args:
        terms: of a hypothesis, which may add joints.
    """
    variant = simulator.compiler.compile_variant(terms)
    return np.tile(variant.model.dof_treeid[variant.dof], 2)


def find_value_trees(simulator: Simulator, terms: Sequence[Term]) -> np.ndarray:
    """(P) the tree of each parameter, `NO_TREE` of what acts in several."""
    counts = [len(t.parameters) for t in terms]
    return np.repeat(find_term_trees(simulator, terms), counts)


def find_term_trees(simulator: Simulator, terms: Sequence[Term]) -> np.ndarray:
    """(T) the tree of each term, `NO_TREE` of what acts in several.

    Args:
        terms: T of them, of one hypothesis.
    """
    model = simulator.compiler.compile_variant(terms).model
    of_channel = _find_channel_trees(simulator, terms)
    of_term = []
    for term in terms:
        trees = {
            of_channel.get(name, NO_TREE)
            if kind == "sensor"
            else _find_tree(model, kind, name)
            for kind, _, name in (
                at.partition("/")[0].partition(":") for at in _list_elements(term)
            )
        }
        of_term.append(trees.pop() if len(trees) == 1 else NO_TREE)
    return np.array(of_term, int)


def _list_elements(term: Term) -> list[str]:
    """Its targets, and what else of the model it is between."""
    beside = [str(x) for x in term.finding_fields.values()]
    return [*term.targets, *(x for x in beside if ":" in x)]


def _find_channel_trees(simulator: Simulator, terms: Sequence[Term]) -> dict[str, int]:
    """The tree that each signal is read in, by its name."""
    model = simulator.compiler.compile_variant(terms).model
    return {
        c.name: _find_tree(model, c.kind.partition("_")[0], c.target)
        for c in simulator.channels
    }


def _find_tree(model: "MjModel", kind: str, name: str) -> int:
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

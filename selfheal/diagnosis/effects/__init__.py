"""The catalogue of effects: those of the modules below, and of other packages.

Other packages name theirs by entry points of the group `selfheal.effects`.
"""

import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from inspect import isabstract
from pkgutil import walk_packages

from ...errors import InputError, UnknownNameError
from .base import Effect
from .declaration import PLACEHOLDERS, TARGET_KINDS
from .protocols import CommandFilter, JointForce, ModelEdit, SensorMap

GROUPS = ("friction", "transmission", "actuator", "body", "world", "measurement")


@cache
def load_catalogue() -> dict[str, Effect]:
    """Every effect that can be named, by name, in the order of the contract.

    Raises:
        InputError: an effect's declaration contradicts itself.
    """
    others = entry_points(group="selfheal.effects")
    effects = [*_load_own(), *(entry.load()() for entry in others)]
    for effect in effects:
        check_declaration(effect)
    order = {name: i for i, name in enumerate(GROUPS)}
    effects.sort(key=lambda e: (order.get(e.group, len(order)), e.name))
    return {effect.name: effect for effect in effects}


def _load_own() -> Iterator[Effect]:
    """An effect of each class in the modules of this room that is of a group."""
    for found in walk_packages(__path__, f"{__name__}."):
        for kind in vars(import_module(found.name)).values():
            if not (isinstance(kind, type) and issubclass(kind, Effect)):
                continue
            is_own = kind.__module__ == found.name and not isabstract(kind)
            if is_own and kind.name and kind.group in GROUPS:
                yield kind()


def find_effect(name: str) -> Effect:
    """The effect of that name.

    Raises:
        UnknownNameError: there is none.
    """
    effects = load_catalogue()
    if name not in effects:
        raise UnknownNameError("effect", name, effects)
    return effects[name]


def check_declaration(effect: Effect) -> None:
    """Refuse an effect whose declaration contradicts itself.

    Raises:
        InputError: the first contradiction, and what would fit.
    """
    who = f"effect {effect.name or type(effect).__name__!r}"
    for key in ("name", "group", "description", "equation", "source"):
        if not getattr(effect, key):
            raise InputError(f"{who} has no {key}; would fit: a text")
    kinds = effect.target_kinds
    if not kinds or not set(kinds) <= set(TARGET_KINDS):
        fits = ", ".join(TARGET_KINDS)
        raise InputError(f"{who}: target_kinds is {kinds!r}; would fit some of: {fits}")
    if not isinstance(effect, ModelEdit | CommandFilter | JointForce | SensorMap):
        fits = "a method of effects.protocols, edit_model perhaps"
        raise InputError(f"{who} acts in no way; would fit: {fits}")
    names = [p.name for p in effect.parameters]
    fits = ", ".join((*names, *PLACEHOLDERS))
    for name in re.findall(r"{(\w+)}", effect.phrase):
        if name not in (*names, *PLACEHOLDERS):
            raise InputError(f"{who}: its phrase names {name!r}; would fit: {fits}")
    for name in sorted({n for each in effect.parameter_sets for n in each} - {*names}):
        fits = ", ".join(names)
        raise InputError(f"{who}: parameter_sets has {name!r}; would fit: {fits}")

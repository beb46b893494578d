"""The catalogue of effects, as entry points name them.

One module holds a group of them; other packages add theirs by entry point.
"""

import re
from functools import cache
from importlib.metadata import entry_points

from ...errors import InputError, UnknownNameError
from .base import Effect
from .declaration import PLACEHOLDERS, TARGET_KINDS

GROUPS = ("friction", "transmission", "actuator", "body", "world", "measurement")


@cache
def load_catalogue() -> dict[str, Effect]:
    """Every effect that can be named, by name, in the order of the contract.

    Raises:
        InputError: an effect's declaration contradicts itself.
    """
    effects = [entry.load()() for entry in entry_points(group="selfheal.effects")]
    for effect in effects:
        check_declaration(effect)
    order = {name: i for i, name in enumerate(GROUPS)}
    effects.sort(key=lambda e: (order.get(e.group, len(order)), e.name))
    return {effect.name: effect for effect in effects}


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
    names = [p.name for p in effect.parameters]
    fits = ", ".join((*names, *PLACEHOLDERS))
    for name in re.findall(r"{(\w+)}", effect.phrase):
        if name not in (*names, *PLACEHOLDERS):
            raise InputError(f"{who}: its phrase names {name!r}; would fit: {fits}")
    for name in sorted({n for each in effect.parameter_sets for n in each} - {*names}):
        fits = ", ".join(names)
        raise InputError(f"{who}: parameter_sets has {name!r}; would fit: {fits}")

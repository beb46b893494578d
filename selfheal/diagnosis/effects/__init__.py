"""The catalogue of effects, as entry points name them.

One module holds a group of them; other packages add theirs by entry point.
"""

from functools import cache
from importlib.metadata import entry_points

from ...errors import UnknownNameError
from .base import Effect
from .declaration import check_declaration

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

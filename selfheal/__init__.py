"""A robot finds out what its body is; importing this takes and loads nothing."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import Recording, diagnose, heal, identify, recover

__all__ = ["Recording", "__version__", "diagnose", "heal", "identify", "recover"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """What Python users call, loaded when it is first used."""
    if name in __all__:
        from . import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """What Python users call, loaded yet or not."""
    return sorted(__all__)

"""Replace what a module holds, in a process of its own."""


def replace_attribute(module: object, name: str, value: object) -> None:
    """Set an attribute that is there; one that is not is a mistake of the test."""
    if not hasattr(module, name):
        raise AttributeError(f"{module!r} has no {name!r}")
    setattr(module, name, value)

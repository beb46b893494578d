"""Examples to try: takes a name, gives a model, a log of its robot and a recording."""

from .pendulum import make_pendulum_example

__all__ = ["make_pendulum_example"]

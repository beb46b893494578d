"""Examples to try: takes a name, gives a model, a log of its robot and a recording."""

from .make import EXAMPLES, Example, make_example

__all__ = ["EXAMPLES", "Example", "make_example"]

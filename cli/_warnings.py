"""Warnings of libraries, as a user reads them: a line each on standard error."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from selfheal.printable import make_printable

from ._print import print_line


@contextmanager
def say_warnings() -> Iterator[None]:
    """Say each warning once, without the place in the code that it comes from.

    Python's warnings (MuJoCo's of a model among them), and what libraries log where
    nobody listens (matplotlib's of a home that cannot be written).
    """
    said = set()

    def say(message: Warning | str, *_: object) -> None:
        if (text := str(message)) not in said:
            said.add(text)
            print_line(f"selfheal: warning: {text}", is_error=True)

    log = logging.lastResort
    assert log  # nobody here takes it away
    formatter = log.formatter
    log.setFormatter(_LineFormatter())
    try:
        with warnings.catch_warnings():
            warnings.showwarning = say  # type: ignore[assignment]
            yield
    finally:
        log.setFormatter(formatter)


class _LineFormatter(logging.Formatter):
    """A line for what was logged; a traceback, where there is one, below."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The line."""
        said = f"selfheal: {record.levelname.lower()}: {record.message}"
        return make_printable(said)

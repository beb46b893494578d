"""Warnings of libraries, as a user reads them: a line each on standard error."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from selfheal.printable import make_printable

from ._print import print_error


@contextmanager
def say_warnings() -> Iterator[None]:
    """Say each warning once, without the place in the code that it comes from.

    Python's warnings (MuJoCo's of a model among them) are said at the end of a command
    that did its work: one that refused its input has said why. Those of arithmetic
    are not said: what is not finite is looked for where it matters. What libraries
    log where nobody listens is said at once (matplotlib's of a home without room).
    """
    heard = dict[str, None]()

    def hear(message: Warning | str, *_: object) -> None:
        heard[str(message)] = None

    log = logging.lastResort
    assert log  # nobody here takes it away
    formatter = log.formatter
    log.setFormatter(_LineFormatter())
    try:
        with warnings.catch_warnings():
            warnings.showwarning = hear  # type: ignore[assignment]
            # behind whatever filters there are: tests make errors of warnings
            warnings.filterwarnings("ignore", category=RuntimeWarning, append=True)
            try:
                yield
            except SystemExit as ended:
                if ended.code:
                    heard.clear()
                raise
            finally:
                for text in heard:
                    print_error(f"selfheal: warning: {text}")
    finally:
        log.setFormatter(formatter)


class _LineFormatter(logging.Formatter):
    """A line for what was logged; a traceback, where there is one, below."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The line."""
        said = f"selfheal: {record.levelname.lower()}: {record.message}"
        return make_printable(said)

"""The exceptions a user can meet, as one tree.

SelfhealError
 +-- InputError            what was given cannot be used; exit code 2
 |    +-- UnknownNameError a name that is not on the list; the message has the list
 |    +-- RecordingError   a recording file that breaks the contract
 |    +-- RunFileError     a run file that cannot be read, resumed or written
 |    |    +-- RunLockError a run file that this process cannot keep to itself
 |    +-- ModelError       a body or MJCF that does not make sense
 +-- EngineError           an engine could not do its work at all
"""

from collections.abc import Iterable

from .printable import join_names, make_printable, quote_name


class SelfhealError(Exception):
    """Base of everything this package raises on purpose.

    Its message is one line that any terminal can print, whatever names are in it.
    """

    def __init__(self, message: str = "") -> None:
        """Say `message`, made printable."""
        super().__init__(make_printable(message))


class InputError(SelfhealError):
    """What was given cannot be used; the message says what would be right."""


class UnknownNameError(InputError):
    """A name that is not on the list of valid ones."""

    def __init__(self, what: str, name: str, valid: Iterable[str]) -> None:
        """Say that `name` is no `what`, and list what is."""
        fits = join_names(sorted(valid))
        super().__init__(f"unknown {what} {quote_name(name)}; valid: {fits}")


class RecordingError(InputError):
    """A recording that breaks the contract (section 1)."""


class RunFileError(InputError):
    """A run file that cannot be read, resumed or written."""


class RunLockError(RunFileError):
    """A run file that this process cannot keep to itself."""


class ModelError(InputError):
    """A body or an MJCF that does not make sense."""


class EngineError(SelfhealError):
    """An engine could not do its work at all."""


def check_seed(seed: int) -> None:
    """Refuse one that a random generator would not take."""
    if seed < 0:
        raise InputError(f"the seed must not be negative; not {seed}")

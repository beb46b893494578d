"""MuJoCo's readers of model files, and its own messages kept from a user's screen."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco


def silence_mujoco() -> None:
    """Keep MuJoCo from writing MUJOCO_LOG.TXT here; what diverged shows as NaN."""
    import mujoco

    mujoco.set_mju_user_warning(lambda message: None)


def read_spec_file(
    path: str | os.PathLike[str], include: Mapping[str, bytes] | None = None
) -> "mujoco.MjSpec":
    """MuJoCo's mujoco.MjSpec of an MJCF or URDF file.

    Args:
        path: ends in .xml or .urdf.
        include: contents of files that are not on disk, by their paths.

    Raises:
        ValueError: MuJoCo's, of what it cannot read; or a value is NaN.
    """
    import mujoco

    with _listen():
        files = {os.fsencode(name): text for name, text in (include or {}).items()}
        return mujoco.MjSpec.from_file(os.fsencode(path), include=files or None)


def compile_file(path: str | os.PathLike[str]) -> "mujoco.MjModel":
    """The compiled model of an MJCF or URDF file; errors as of `read_spec_file`."""
    import mujoco

    with _listen():
        return mujoco.MjModel.from_xml_path(os.fsencode(path))


@contextmanager
def _listen() -> Iterator[None]:
    """Hear what MuJoCo warns of while it reads a file; it is silent from then on.

    Paths are given to it as bytes: it takes any, while a text has to be UTF-8.
    """
    import mujoco

    heard: list[str] = []
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield
    except UnicodeDecodeError as error:  # MuJoCo's words, about a path that is no UTF-8
        raise ValueError(error.object.decode(errors="replace")) from error
    finally:
        silence_mujoco()
    if any("'NaN'" in message for message in heard):
        # it counts as not given, or makes the simulation NaN
        raise ValueError("a value in it is NaN; would fit: a number")

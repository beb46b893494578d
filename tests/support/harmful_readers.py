"""Readers that end well, or do to a process what HDF5 and MuJoCo do on some files."""

import os
from pathlib import Path

import numpy as np


def read(path: str) -> bytes:
    """Read it."""
    return Path(path).read_bytes()


def refuse(path: str) -> None:
    """Find fault with it."""
    raise ValueError(path)


def crash_on_content(path: str) -> None:
    """End the process by a signal, unless the file is empty."""
    if Path(path).read_bytes():
        os.abort()


def hang(path: str) -> None:
    """Never end."""
    while True:
        pass


def crash(path: str) -> None:
    """End the process by a signal."""
    os.abort()


def leave(path: str) -> None:
    """End the process by itself."""
    os._exit(7)


def fill(path: str) -> None:
    """Ask for more memory than there is leave for."""
    np.ones(10**10)


def fail_to_allocate(path: str) -> None:
    """Say what MuJoCo says."""
    raise ValueError("Could not allocate memory for texture")

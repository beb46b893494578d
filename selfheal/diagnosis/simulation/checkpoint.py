"""Checkpoints: takes what a computation depends on, gives its arrays of before."""

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from ...files import atomic_path
from .digest import Digester, digest_programs

Arrays = tuple[np.ndarray, ...]


class Checkpoint:
    """Keeps arrays on disk, each file named by all that they were computed from.

    A run that computes the same in the same order comes to the same end, whether it
    computes or finds the arrays: a diagnosis goes on where it was killed. What another
    version of the programs computed is not found, for the name depends on their source.

    Attributes:
        folder: of the files; None: nothing is kept.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str] | None = None,
        programs: bytes | None = None,
    ) -> None:
        """`programs`: digest of the code that computes; None: of this package's."""
        self.folder = None if folder is None else Path(folder)
        self._programs = programs
        self._digester = Digester()

    def load_or_compute(self, inputs: object, compute: Callable[[], Arrays]) -> Arrays:
        """Give the arrays of a computation; computed if no file of them can be read.

        Args:
            inputs: all that the arrays depend on, in any form that `Digester` takes.

        Raises:
            TypeError: no digest can be made of the inputs.
        """
        if not self.folder:
            return compute()
        if self._programs is None:
            self._programs = digest_programs()
        key = self._digester.digest((self._programs, inputs))
        path = self.folder / f"{key.hex()}.npy"
        try:
            with path.open("rb") as file:
                return tuple(np.load(file) for _ in range(int(np.load(file))))
        except (OSError, ValueError, TypeError, EOFError):
            pass
        arrays = compute()
        self.folder.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            # what is no file is written in parts, and says why it cannot be
            target = SimpleNamespace(write=file.write)
            for array in (np.array(len(arrays)), *arrays):
                np.save(target, array)
        return arrays

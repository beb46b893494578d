"""What a killed run had worked out: takes a question, gives the answer of before."""

import hashlib
import os
import zipfile
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ...files import atomic_path
from ...recording import Recording
from ..effects.base import Term
from .model_variants import ModelCompiler

Arrays = tuple[np.ndarray, ...]


class Checkpoint:
    """Answers by everything that they depend on; without a folder nothing is kept.

    A run that asks the same questions in the same order comes to the same end, whether
    it works out an answer or finds it: a diagnosis goes on where it was killed.
    """

    def __init__(
        self, folder: str | os.PathLike[str] | None = None, about: bytes = b""
    ) -> None:
        """Answers are kept in `folder`; `about` is what all questions are about."""
        self.folder, self.about = None if folder is None else Path(folder), about

    def load_or_compute(
        self, question: Sequence[Any], work_out: Callable[[], Arrays]
    ) -> Arrays:
        """The answer, worked out if it is not there or cannot be read."""
        if not self.folder:
            return work_out()
        path = self.folder / f"{_digest((self.about, *question)).hex()}.npz"
        try:
            with path.open("rb") as file, np.load(file) as kept:
                return tuple(kept[f"arr_{i}"] for i in range(len(kept.files)))
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            pass
        answer = work_out()
        self.folder.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary, temporary.open("wb") as new:
            np.savez(new, *answer)
        return answer


def digest_inputs(compiler: ModelCompiler, recordings: Sequence[Recording]) -> bytes:
    """A digest of a model, recordings, and the programs that make answers of them."""
    model = compiler.nominal
    raw = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, raw)
    said: list[Any] = [*map(version, ("selfheal", "mujoco", "numpy")), raw]
    for recording in recordings:
        for name, e in recording.episodes.items():
            said += [recording.file, name, e.time, e.ctrl, e.qpos0, e.qvel0]
            said += [(k, s.values, s.kind, s.target) for k, s in e.signals.items()]
    return _digest(said)


def _digest(said: Any) -> bytes:
    """Of numbers, texts, arrays, terms, and sequences of them."""
    state = hashlib.sha256()
    if isinstance(said, np.ndarray):
        state.update(repr((said.shape, said.dtype.str)).encode())
        state.update(np.ascontiguousarray(said).tobytes())
    elif isinstance(said, bytes):
        state.update(said)
    elif isinstance(said, Term):
        of_it = repr((said.key, said.initial_values, said.onset))
        state.update(_digest((of_it, said.low, said.high)))
    elif isinstance(said, tuple | list):
        for part in said:
            state.update(_digest(part))
    else:
        state.update(repr(said).encode())
    return state.digest()

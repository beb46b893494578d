"""Programs that JAX has traced, kept from one run to the next.

What is kept is what JAX exports, no machine code; XLA's own cache has that. Tracing
and lowering again would take a run longer than its simulations.
"""

import hashlib
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from ..body.body import GRAVITY
from ..errors import SelfhealError
from ..files import atomic_path
from ._jax import prepare_jax

if TYPE_CHECKING:
    from jax.export import Exported

# what a program is traced from, beside its key
_SOURCES = ("mjx.py", "_mjx_step.py", "_mjx_body.py")
_LIBRARIES = ("jax", "jaxlib", "mujoco", "mujoco-mjx", "numpy")


def read_exported(key: tuple) -> "Exported | None":
    """The program that was kept under a key; None where there is none to use."""
    path = _find_path(key)
    if path is None or not path.exists():
        return None
    from jax import export

    try:
        return export.deserialize(bytearray(path.read_bytes()))
    except Exception:  # of flatbuffers, MLIR or JAX, where the file is damaged
        return None


def keep_exported(key: tuple, program: "Exported") -> "Exported":
    """Keep a program that JAX exported under a key, and return it."""
    path = _find_path(key)
    if path is not None:
        content = program.serialize()
        # on a full disk, say: the next run traces again
        with suppress(SelfhealError), atomic_path(path) as temporary:
            temporary.write_bytes(content)
    return program


def _find_path(key: tuple) -> Path | None:
    """Where a program lies that depends on a key; None where nothing can be kept."""
    folder = prepare_jax().config.values["jax_compilation_cache_dir"]
    if folder is None:
        return None
    digest = hashlib.sha256(repr((tuple(key), GRAVITY)).encode())
    for name in _SOURCES:
        digest.update(Path(__file__).with_name(name).read_bytes())
    for name in _LIBRARIES:
        digest.update(version(name).encode())
    return Path(folder) / f"traced-{digest.hexdigest()}.bin"

"""The one place that sets JAX up; everything that imports jax calls `prepare_jax`."""

import os
import sys
from pathlib import Path
from types import ModuleType

from ..errors import InputError
from ..files import check_writable_folder
from ..machine import count_cores
from ._compiler_cache import warn_uncached

_DEVICES = "--xla_force_host_platform_device_count"
_MOST_DEVICES = 8  # chosen: every device takes a share of each batch


def prepare_jax() -> ModuleType:
    """Import jax with this machine's traps avoided; later calls cost nothing.

    Two settings have to stand before the first import (engines.md). One host device for
    each core, because XLA runs a vmapped loop on about one core. And never an XLA pool
    of exactly two threads, on which batched Cholesky factors wait for each other
    forever (`NPROC`). A user's own settings of the same things stay. After an import by
    somebody else only the compilation cache is set.
    """
    if "jax" not in sys.modules:
        _set_environment()
    import jax

    if jax.config.values["jax_compilation_cache_dir"] is None:
        try:
            folder = check_writable_folder(find_cache_folder())
        except (InputError, RuntimeError):  # RuntimeError: there is no home folder
            warn_uncached("JAX", "some 15 s", "JAX_COMPILATION_CACHE_DIR")
        else:
            jax.config.update("jax_compilation_cache_dir", str(folder))
    return jax


def _set_environment() -> None:
    """Environment variables that XLA reads when it starts."""
    count = count_cores()
    if count == 2:
        os.environ.setdefault("NPROC", "3")
    flags = os.environ.get("XLA_FLAGS", "")
    if _DEVICES not in flags:
        devices = f"{_DEVICES}={min(count, _MOST_DEVICES)}"
        os.environ["XLA_FLAGS"] = f"{flags} {devices}".strip()


def find_cache_folder() -> Path:
    """Where compiled programs are kept from one run to the next."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "selfheal" / "jax"

"""Compiled programs from one run to the next: where none can be kept, says so once."""

import functools
import logging
import multiprocessing


@functools.cache
def warn_uncached(compiler: str, cost: str, variable: str) -> None:
    """Say once, and not in worker processes, that a compiler finds no folder to use.

    Args:
        compiler: its name, "numba" say.
        cost: what each run takes longer.
        variable: of the environment, that names a folder to use.
    """
    if multiprocessing.parent_process() is None:
        logging.getLogger(__name__).warning(
            "selfheal: %s cannot write into its cache folders, so that every run "
            "compiles anew, which takes %s; %s=FOLDER names another folder",
            *(compiler, cost, variable),
        )

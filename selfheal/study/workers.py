"""Where runs are done: a user's words in, a Dask client with workers behind it out."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, UnknownNameError
from ..extras import import_extra
from ..machine import count_cores, list_cores

if TYPE_CHECKING:
    from distributed import Client, LocalCluster, SpecCluster

# name -> class of dask_jobqueue
CLUSTERS = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
}
# of a cluster's job, where its Dask configuration says nothing; chosen
_MEMORY = "2 GB"
_ANY_PORT = ":0"  # of Dask's own pages: several studies may run on a machine
# Of one run: so many workers may die under it before it counts as failed. Chosen: many
# die of other causes on a cluster, and a run that kills its worker must end some time.
DEATHS = 10


@dataclass(frozen=True)
class Workplace:
    """Where runs are to be done.

    Attributes:
        workers: how many processes; 0 = as many as cores.
        scheduler: address of a Dask scheduler that is there already, "" if none.
        cluster: a name of `CLUSTERS`, "" for this machine.
    """

    workers: int = 0
    scheduler: str = ""
    cluster: str = ""

    def __post_init__(self) -> None:
        """Refuse a place that makes no sense, before anything is started."""
        if self.cluster and self.cluster not in CLUSTERS:
            raise UnknownNameError("cluster", self.cluster, CLUSTERS)
        if self.scheduler and (self.cluster or self.workers):
            raise InputError(
                "--scheduler names workers that are there already; leave out --cluster "
                "and --workers"
            )
        if self.workers < 0:
            raise InputError(f"workers must be positive; not {self.workers}")
        if self.cluster and not self.workers:
            raise InputError("--cluster needs --workers N, the jobs to ask it for")


@contextmanager
def connect_workers(place: Workplace, logs: Path) -> Iterator["Client"]:
    """A client of workers at a place, which are let go of in the end.

    Args:
        logs: folder for what jobs of a cluster say; made only for them.

    Raises:
        InputError: there is no scheduler at the address, or the cluster's tools or its
            extra are missing.
    """
    import dask
    from distributed import Client

    from .worker import PinnedWorker

    settings = {
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.logging.distributed": "error",
    }
    with dask.config.set(settings), ExitStack() as stack:
        if place.scheduler:
            client = stack.enter_context(_reach_scheduler(place.scheduler))
            own: tuple[int, ...] = ()
        else:
            made = _start_cluster(place, logs) if place.cluster else _start_local(place)
            client = stack.enter_context(Client(stack.enter_context(made)))
            own = () if place.cluster else list_cores()
        try:
            client.register_plugin(PinnedWorker(own))
        except Exception as error:  # whatever they raise when they load it
            raise InputError(f"the workers cannot load selfheal: {error}") from error
        yield client


def _start_local(place: Workplace) -> "LocalCluster":
    """Worker processes on this machine."""
    import logging

    from distributed import LocalCluster

    return LocalCluster(
        n_workers=place.workers or count_cores(),
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=_ANY_PORT,
        silence_logs=logging.CRITICAL,
    )


def _start_cluster(place: Workplace, logs: Path) -> "SpecCluster":
    """Jobs of a batch system, one worker on one core each; lost ones are replaced."""
    import dask

    jobqueue = import_extra("dask_jobqueue", "cluster", "--cluster")

    set_by_user = dask.config.get(f"jobqueue.{place.cluster}", {})
    wanted = {"cores": 1, "processes": 1, "memory": _MEMORY, "log_directory": str(logs)}
    more = {
        k: v for k, v in wanted.items() if set_by_user.get(k.replace("_", "-")) is None
    }
    pages = {"dashboard_address": _ANY_PORT}
    try:
        made = getattr(jobqueue, CLUSTERS[place.cluster])(
            scheduler_options=pages, **more
        )
        made.adapt(minimum_jobs=place.workers, maximum_jobs=place.workers)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"--cluster {place.cluster}: {error}") from error
    return made


def _reach_scheduler(address: str) -> "Client":
    """A client of a scheduler that is there already."""
    from distributed import Client

    try:
        return Client(address)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {address}: {error}") from error

"""Tables of runs: groups of records in, a row each, by columns of a name each."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median

from .plan import Record, Table
from .statistics import format_mean_std, format_share

Column = Callable[[Sequence[Record]], str]  # the cell of a group of runs
Groups = Iterable[tuple[Sequence[str], Sequence[Record]]]  # first cells, and runs


def extract_column(records: Sequence[Record], name: str) -> list[float]:
    """An outcome's entry of each finished run; of a list its last one."""
    values = [record["outcome"][name] for record in records]
    return [v[-1] if isinstance(v, list) else v for v in values]


def count_runs(records: Sequence[Record]) -> str:
    """The number of runs."""
    return f"{len(records):,}"


def take_median_seconds(records: Sequence[Record]) -> str:
    """The median time of a run."""
    return f"{median(record['seconds'] for record in records):.1f}"


def average(name: str, digits: int = 2) -> Column:
    """Mean and standard deviation of an outcome's entry."""
    return lambda records: format_mean_std(extract_column(records, name), digits)


def share(name: str) -> Column:
    """How many outcomes have an entry that is true."""
    return lambda records: format_share(
        int(sum(extract_column(records, name))), len(records)
    )


def tabulate(
    title: str,
    text: str,
    groups: Groups,
    head: Sequence[str],
    columns: Mapping[str, Column],
) -> Table:
    """A table with a row for each group of runs.

    Args:
        head: names of the first columns, which the groups fill.
        columns: what follows them.
    """
    rows = [
        (*first, *(column(records) for column in columns.values()))
        for first, records in groups
    ]
    return Table(title, text, (*head, *columns), rows)

"""Arrays in groups: takes arrays by their paths, gives tables of runs."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from .common import order_naturally
from .tables import (
    Array,
    Run,
    Table,
    group_arrays,
    is_usable,
    make_length_tables,
    make_table,
)

# how people call runs
_RUN = re.compile(
    r"(demo|demonstration|episode|ep|run|traj|trajectory|trial|rollout|recording|rec"
    r"|take|log|sequence|seq|experiment|exp|test)s?[ _-]*\d*",
    re.I,
)


def make_tables(
    arrays: Mapping[str, Array], units: Mapping[str, str] | None = None
) -> list[Table]:
    """Tables of arrays: one of the groups that are alike, and others by their lengths.

    Groups are alike where they stand in one group and hold arrays of the same names,
    as `data/demo_0/actions` and `data/demo_1/actions`. Each is a run.

    Args:
        arrays: (T) or (T, d), by paths, whose steps "/" separates.
    """
    arrays = {path: array for path, array in arrays.items() if is_usable(array)}
    units = units or {}
    groups = _find_runs(arrays)
    if len(groups) < 2:
        return make_length_tables(arrays, units)
    inner, runs = dict[str, str](), list[Run]()
    for path in sorted(groups, key=order_naturally):
        start, label = len(path) + 1, path.rpartition("/")[2]
        inner |= {name[start:]: units.get(name, "") for name in groups[path]}
        members = group_arrays({name[start:]: arrays[name] for name in groups[path]})
        runs += [replace(run, label=label) for run in members[:1]]
    taken = {name for names in groups.values() for name in names}
    rest = {path: array for path, array in arrays.items() if path not in taken}
    return [
        make_table(runs, "", inner),
        *(
            make_table([run], f"others of {run.count()} rows", units)
            for run in group_arrays(rest)
        ),
    ]


def _find_runs(arrays: Mapping[str, Array]) -> dict[str, list[str]]:
    """Paths of the arrays in each of the groups that are alike, where most are."""
    below = dict[str, dict[str, list[str]]]()  # by parent and group
    for path in arrays:
        steps = path.split("/")
        for depth in range(1, len(steps)):
            parent, group = "/".join(steps[: depth - 1]), "/".join(steps[:depth])
            below.setdefault(parent, {}).setdefault(group, []).append(path)
    found = dict[str, list[str]]()
    for groups in below.values():
        alike = dict[frozenset[str], dict[str, list[str]]]()
        for group, paths in groups.items():
            names = frozenset(path[len(group) :] for path in paths)
            alike.setdefault(names, {})[group] = paths
        most = max(alike.values(), key=len)
        labels = {group: _get_label(group) for group in most}
        lengths = [max(len(arrays[path]) for path in most[group]) for group in most]
        if len(most) > max(1, len(found)) and are_runs(labels.values(), lengths):
            found = most
    return found


def are_runs(labels: Iterable[str], lengths: Iterable[int]) -> bool:
    """Whether groups of the same arrays are runs, not parts of one robot."""
    return len(set(lengths)) > 1 or all(map(_RUN.fullmatch, labels))


def _get_label(path: str) -> str:
    """The last step of a path, with the one before it where it is a number alone."""
    *_, parent, label = ["", *path.split("/")]
    return f"{parent}_{label}" if label.isdecimal() else label

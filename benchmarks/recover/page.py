"""Figures of the page of recovery: records of its suites in, what page.md shows out."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from benchmarks.recover.unlisted import CHANGES
from benchmarks.suites import Record

Known = Mapping[str, Mapping[str, Record]]


def compute_figures(known: Known) -> dict[str, object]:
    """What the page shows besides the records themselves."""
    ours, described = list(known["ours"].values()), list(known["described"].values())
    clear = (1, 2, 3, 5)  # "approaches or exceeds" (overview.txt 4.5)
    return {
        "changes": CHANGES,
        "recovered": {
            suite: list_recoveries(records.values())
            for suite, records in known.items()
            if suite not in ("speed", "alarms")
        },
        "described_first": list_recoveries(r for r in described if r["scenario"] == 1),
        "described_clear": list_recoveries(
            r for r in described if r["scenario"] in clear
        ),
        "named_ours": [r["named"] for r in ours if r["scenario"] not in (9, 10)],
        "named_described": [
            r["named"] for r in described if r["scenario"] not in (9, 10)
        ],
        "named_nothing": [r["named"] for r in ours if r["scenario"] == 9],
        "pairs": _pair_with_control(known),
        "ratios": _list_speed_ratios(known["speed"].values()),
        "speeds": _list_speeds(known["speed"].values()),
        "false_alarms": _group_alarms(known["alarms"].values()),
    }


def list_recoveries(records: Iterable[Record]) -> list[float]:
    """Recovered over original distance of each run."""
    ways = [r["distance"] for r in records]
    return [float(d["healed"] or 0.0) / float(d["intact"]) for d in ways]


def _pair_with_control(known: Known) -> list[Record]:
    """Runs of the control with ours of the same cell, and trials of both.

    Trials are those until the lesser of both recoveries.
    """
    found = []
    for key, control in known["hardware"].items():
        if (ours := known["ours"].get(key)) is None:
            continue
        goal = min(ours["distance"]["healed"], control["distance"]["healed"])
        goal -= 1e-3  # records are rounded
        trials = 1 + int(np.argmax([(w or -np.inf) >= goal for w in ours["walked"]]))
        # the 50 that were kept are run first, then 50 in each generation
        of_control = 50 + 50 * int(np.argmax(np.array(control["best"]) >= goal))
        until = f"{trials} : {of_control:,}"
        found.append({"ours": ours, "control": control, "until": until})
    return found


def _choose_clock(record: Record) -> str:
    """CPU seconds where one core was used, which others share; else wall seconds."""
    return "cpu" if record["cores"] == 1 else "wall"


def _list_speed_ratios(records: Iterable[Record]) -> list[str]:
    """Ratios of evaluations a second, of each robot and count of cores."""
    groups = dict[tuple[str, int], list[Record]]()
    for r in records:
        groups.setdefault((r["robot"], r["cores"]), []).append(r)
    found = []
    for (robot, cores), rows in groups.items():
        for what in ("batch", "search"):
            clock = _choose_clock(rows[0])
            ratio = np.median([r["plain"][clock] / r[what][clock] for r in rows])
            count = f"{cores} core{'s' * (cores != 1)}"
            found.append(f"{robot}, {count}, {what} {ratio:.1f} : 1")
    return found


def _list_speeds(records: Iterable[Record]) -> list[Sequence[object]]:
    """Cells of the rows of speed."""
    return [
        (
            r["robot"],
            r["cores"],
            *(
                f"{1 / r[k][_choose_clock(r)]:.0f}"
                for k in ("plain", "batch", "search")
            ),
        )
        for r in records
    ]


def _group_alarms(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Tests of listed damages by robot and by whether the damage has a value."""
    found = dict[str, list[Record]]()
    for r in records:
        graded = "with a value" if r["damage"]["value"] else "without a value"
        found.setdefault(f"{r['robot']} | {graded}", []).append(r)
    return found

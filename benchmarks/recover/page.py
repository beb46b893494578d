"""The page of recovery: records of its suites in, docs/results/recover.md out."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.recover.unlisted import CHANGES
from benchmarks.writer import Section, publish_results
from selfheal.study.statistics import format_share

Records = Mapping[str, Mapping[str, Any]]

_HEAD = ("robot", "scenario", "seed", "damage", "believed", "named", "whole [m]",
         "broken [m]", "trials [m]", "recovered / whole", "CPU [s]")  # fmt: skip
_CLEAR = (1, 2, 3, 5)  # "approaches or exceeds" (overview.txt 4.5)


def write_page(root: Path, known: Mapping[str, Records], remarks: str) -> None:
    """Publish the page of all suites of recovery."""
    sections = [
        Section(
            "What was reached",
            "",
            ("figure", "target", "measured"),
            [*_tabulate_targets(known), *_tabulate_new_targets(known)],
        ),
        _make_runs_section(known["ours"], "Our method", _OURS),
        _make_runs_section(known["tenth"], "A hidden neuron fails", _TENTH),
        _make_unlisted_section(known["unlisted"]),
        _make_alarms_section(known["alarms"]),
        _make_runs_section(known["described"], "As described", _DESCRIBED),
        _make_control_section(known),
        _make_runs_section(known["beyond"], "Graded damage, changed worlds", _BEYOND),
        _make_runs_section(known["gap"], "A robot that is 5 % off its model", _GAP),
        _make_speed_section(known["speed"]),
        Section("What is not reached, was not run, and why", remarks),
    ]
    note = " (timings: one core that other work shared; CPU seconds are of this work)"
    data = {suite: list(records.values()) for suite, records in known.items()}
    title = "Recovery of legged robots"
    publish_results(root, "recover", title, sections, data, hardware=note)


_OURS = "One run a row. Trials that were not needed any more were not made."
_DESCRIBED = (
    "The two searches of 2004; recovered is what the last of three trials went, as "
    "there."
)
_TENTH = "Scenario 10, our method."
_BEYOND = "Scenarios 11 to 15, our method."
_GAP = (
    "Friction, masses and motors of the hidden robot are off by up to 5 %, drawn from "
    "the seed. Our method is not told by how much; it fits them to the walk of the "
    "whole robot."
)


def _compute_recovery(record: Mapping[str, Any]) -> float:
    """Recovered over original displacement."""
    d = record["distance"]
    return float(d["healed"] or 0.0) / float(d["intact"])


def _list_recoveries(records: Iterable[Mapping[str, Any]]) -> list[float]:
    return [_compute_recovery(r) for r in records]


def _format_quantiles(values: Sequence[float]) -> str:
    """Median and 10th percentile, and of how many."""
    if not len(values):
        return "not run"
    middle, low = np.median(values), np.quantile(values, 0.1)
    return f"{middle:.2f}; {low:.2f}, of {len(values)}"


def _format_named_share(records: Iterable[Mapping[str, Any]]) -> str:
    known = [r["named"] for r in records if r["named"] is not None]
    return format_share(sum(known), len(known))


def _tabulate_targets(known: Mapping[str, Records]) -> list[tuple[str, str, str]]:
    """The figures that were asked for."""
    ours, old = (list(known[name].values()) for name in ("ours", "described"))
    first = [r for r in old if r["scenario"] == 1]
    clear = [r for r in old if r["scenario"] in _CLEAR]
    broken = [r for r in ours if r["scenario"] not in (9, 10)]
    nothing = [r for r in ours if r["scenario"] == 9]
    return [
        (
            "as described, recovered / original: median; 10th percentile",
            "reported",
            _format_quantiles(_list_recoveries(old)),
        ),
        (
            "as described, scenario 1",
            "about 0.7 in 2004",
            _format_quantiles(_list_recoveries(first)),
        ),
        (
            "as described, scenarios 1, 2, 3, 5",
            "approaches or exceeds 1 in 2004",
            _format_quantiles(_list_recoveries(clear)),
        ),
        (
            "ours, recovered / original: median; 10th percentile",
            ">= 0.9; >= 0.6",
            _format_quantiles(_list_recoveries(ours)),
        ),
        (
            "ours, kind and place named, scenarios 1 to 8",
            ">= 80 %",
            _format_named_share(broken),
        ),
        (
            "as described, the same",
            "",
            _format_named_share(r for r in old if r["scenario"] not in (9, 10)),
        ),
        (
            "ours, scenario 9 says that nothing broke",
            ">= 90 %",
            _format_named_share(nothing),
        ),
        (
            "hardware trials, ours : control, for the same recovery",
            "<= 1 : 500",
            "; ".join(_compare_trials(known)) or "not run",
        ),
        ("one run, quadruped", "<= 10 min on 2 cores", _summarize_times(known)),
        (
            "evaluations/s against plain MuJoCo",
            ">= 5 : 1",
            _summarize_speed(known["speed"]),
        ),
    ]


def _tabulate_new_targets(known: Mapping[str, Records]) -> list[tuple[str, str, str]]:
    """The figures of scenario 10 and of what is in no list."""
    tenth, unlisted = (list(known[name].values()) for name in ("tenth", "unlisted"))
    told = sum(r["verdict"] == "unlisted" for r in unlisted)
    return [
        (
            "ours, scenario 10, recovered / original: median; 10th percentile",
            ">= 0.9",
            _format_quantiles(_list_recoveries(tenth)),
        ),
        ("ours, scenario 10, named", "reported", _format_named_share(tenth)),
        (
            "ours, changes in no list, recovered / original",
            "reported",
            _format_quantiles(_list_recoveries(unlisted)),
        ),
        (
            "ours, changes in no list, told as unlisted",
            "reported",
            format_share(told, len(unlisted)),
        ),
    ]


def _summarize_times(known: Mapping[str, Records]) -> str:
    """CPU time of a run of the quadruped, by our method and as described."""
    times = {
        name: [
            r["cpu_seconds"] for r in known[suite].values() if r["robot"] == "quadruped"
        ]
        for name, suite in (("ours", "ours"), ("as described", "described"))
    }
    return "; ".join(
        f"{name} {np.median(v):.0f} s, worst {max(v):.0f} s of CPU"
        for name, v in times.items()
        if v
    )


def _make_runs_section(records: Records, title: str, words: str) -> Section:
    """A row a run."""
    rows = []
    for r in sorted(records.values(), key=_order_run):
        d = r["distance"]
        walked = ", ".join("failed" if w is None else f"{w:.2f}" for w in r["walked"])
        named = {True: "yes", False: "no", None: ""}[r["named"]]
        rows.append(
            (
                r["robot"],
                r["scenario"],
                r["seed"],
                _describe_damages(r["damage"]),
                _describe_belief(r),
                named,
                f"{d['intact']:.2f}",
                f"{d['damaged'] or 0:.2f}",
                walked,
                f"{_compute_recovery(r):.2f}",
                f"{r['cpu_seconds']:.0f}",
            )
        )
    return Section(title, words if rows else "Not run.", _HEAD, rows)


def _order_run(record: Mapping[str, Any]) -> tuple[bool, int, int]:
    """Where a run stands in a table."""
    return record["robot"] == "hexapod", record["scenario"], record["seed"]


def _describe_belief(record: Mapping[str, Any]) -> str:
    """What is believed in the end; records of before the verdict have none."""
    if record.get("verdict") == "unlisted":
        return "unlisted"
    return _describe_damages(record["hypotheses"])


def _describe_damages(damages: Sequence[Mapping[str, Any]]) -> str:
    """Damages as short as a table has room for."""
    said = [f"{d['kind']} {d['target'].partition(':')[2]} {_format_value(d)}".strip()
            for d in damages if d["kind"] != "none"]  # fmt: skip
    return ", ".join(said) or "nothing"


def _format_value(damage: Mapping[str, Any]) -> str:
    """A value where there is one."""
    return f"{damage['value']:.2f}" if damage["value"] else ""


def _make_unlisted_section(records: Records) -> Section:
    """A row a run after a change that is in no list."""
    rows = [
        (
            r["robot"],
            r["what"],
            r["place"].partition(":")[2] or r["place"],
            r["seed"],
            _describe_belief(r),
            *(f"{r['distance'][k] or 0:.2f}" for k in ("intact", "damaged")),
            ", ".join("failed" if w is None else f"{w:.2f}" for w in r["walked"]),
            f"{_compute_recovery(r):.2f}",
            f"{r['cpu_seconds']:.0f}",
        )
        for r in records.values()
    ]
    head = ("robot", "change", "place", "seed", "verdict or belief", *_HEAD[6:])
    words = "; ".join(f"{name}: {said}" for name, said in CHANGES.items())
    return Section("What is in no list", f"Our method. Changes: {words}.", head, rows)


def _make_alarms_section(records: Records) -> Section:
    """Shares of listed damages that are told as unlisted."""
    rows = []
    for robot in dict.fromkeys(r["robot"] for r in records.values()):
        own = [r for r in records.values() if r["robot"] == robot]
        plain = [r for r in own if not r["damage"]["value"]]
        graded = [r for r in own if r["damage"]["value"]]
        for what, some in (("without a value", plain), ("with a value", graded)):
            shares = (sum(r[k] for r in some) for k in ("refuted", "unlisted", "named"))
            rows.append((robot, what, *(format_share(n, len(some)) for n in shares)))
    head = ("robot", "damage", "refuted by a new move", "unlisted after a new fit",
            "named in the end")  # fmt: skip
    words = (
        "One listed damage of a random kind, place and value each. It is fitted to one "
        "walk and tested with another; where that refutes the fit, both are fitted and "
        "tested again. Walks are those of the two best of 100 random controllers."
    )
    return Section("False alarms", words, head, rows)


def _pair_with_control(known: Mapping[str, Records]) -> list[tuple[Any, Any]]:
    """Runs of the control with our run of the same cell."""
    return [(known["ours"][key], control) for key, control in known["hardware"].items()
            if key in known["ours"]]  # fmt: skip


def _compare_trials(known: Mapping[str, Records]) -> list[str]:
    """Trials of both until the lesser of both recoveries, each pair."""
    found = []
    for ours, control in _pair_with_control(known):
        goal = min(ours["distance"]["healed"], control["distance"]["healed"])
        goal -= 1e-3  # records are rounded
        trials = 1 + int(np.argmax([(w or -np.inf) >= goal for w in ours["walked"]]))
        turn = int(np.argmax(np.array(control["best"]) >= goal))
        # the 50 that were kept are run first, then 50 in each generation
        found.append(f"{trials} : {50 + 50 * turn:,}")
    return found


def _make_control_section(known: Mapping[str, Records]) -> Section:
    """Our trials beside those of the control."""
    rows = [
        (
            f"scenario {c['scenario']}, seed {c['seed']}",
            f"{_compute_recovery(c):.2f}",
            f"{_compute_recovery(o):.2f}",
            f"{c['actions']:,}",
            o["actions"],
            n,
            f"{c['cpu_seconds']:.0f}",
        )
        for (o, c), n in zip(
            _pair_with_control(known), _compare_trials(known), strict=True
        )
    ]
    head = (
        "quadruped",
        "control, recovered / whole",
        "ours",
        "its evaluations",
        "our trials",
        "until the lesser recovery",
        "CPU of the control [s]",
    )
    words = (
        "70 generations on the broken robot, from the 50 best controllers of the whole "
        "one. Evaluations are those that the algorithm asks for; copies are not run "
        "again, for the robot has no chance in it."
    )
    return Section("The control", words, head, rows)


def _choose_clock(record: Mapping[str, Any]) -> str:
    """CPU seconds where one core was used, which others share; else wall seconds."""
    return "cpu" if record["cores"] == 1 else "wall"


def _summarize_speed(records: Records) -> str:
    """Ratios of evaluations a second."""
    found = []
    for key in dict.fromkeys((r["robot"], r["cores"]) for r in records.values()):
        rows = [r for r in records.values() if (r["robot"], r["cores"]) == key]
        for what in ("batch", "search"):
            ratio = np.median(
                [r["plain"][_choose_clock(r)] / r[what][_choose_clock(r)] for r in rows]
            )
            count = f"{key[1]} core{'s' * (key[1] != 1)}"
            found.append(f"{key[0]}, {count}, {what} {ratio:.1f} : 1")
    return "; ".join(found) or "not run"


def _make_speed_section(records: Records) -> Section:
    """Seconds of an evaluation."""
    rows = []
    for r in records.values():
        each = [
            f"{1 / r[k][_choose_clock(r)]:.0f}" for k in ("plain", "batch", "search")
        ]
        rows.append((r["robot"], r["cores"], *each))
    head = ("robot", "cores", "plain MuJoCo, network in numpy", "one batch of 100",
            "a whole search")  # fmt: skip
    words = (
        "Evaluations of 1,000 steps in a second, each way in turn: of CPU time where "
        "there was one core, which other work shared, of wall time where there were "
        "more. Plain MuJoCo uses one. A search counts what the algorithm asks for: "
        "copies have been scored already."
    )
    return Section("Speed", words, head, rows)

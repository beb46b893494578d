"""The page of moves: records of its suites in, docs/results/dynamics.md out."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.writer import Section, publish_results

Records = Mapping[str, dict[str, Any]]
_ERRORS = (
    "Normalized errors on the held-out move, whole, open loop (1: as far off as a "
    "constant): of best.xml as identified, with its stated values fitted anew, with "
    "what was found, and of noise alone."
)
_SERVOS = (
    "Found / hidden, the same in all joints: the fastest rate of a set point and the "
    "delay (of commands, or the same of all readings). Zeros of the eight servos: root "
    "mean square of the hidden ones, and of what is left of them."
)
_WALKS = (
    "A gait of 10 s on the floor, made on the rated plant as `heal` makes it: the way "
    "walked [m], and what is said of it by the median over what the robot may be (as "
    "`heal` says now), by the rated plant, by that with servos as found, "
    "by best.xml, and by best.xml with all that was found (`selfheal replay --model`)."
)
_JOINTS = "Joint angles in that walk: root mean square error of the same models [deg]."


def write_page(root: Path, known: Mapping[str, Records], remarks: str) -> None:
    """Publish the page of all suites."""
    rows = [(f"{suite} {key}", r) for suite, records in known.items()
            for key, r in records.items()]  # fmt: skip
    errors = ("robot", "body right", "torso still", "verdict", "effects",
              "best.xml", "refit", "found", "noise", "CPU [s]")  # fmt: skip
    sections = [
        Section("Held-out moves", _ERRORS, errors, [_list_errors(*r) for r in rows]),
        Section("Servos", _SERVOS,
                ("robot", "rate [rad/s]", "delay [s]", "zeros [deg]", "left [deg]"),
                [_list_servos(*r) for r in rows]),
        Section("Walks", _WALKS, ("robot", "walked", *_NAMES),
                [*(_list_ways(*r) for r in rows), _mean_gaps([r for _, r in rows])]),
        Section("Joints in walks", _JOINTS, ("robot", *_NAMES[1:]),
                [(key, *(f"{r[f'{n}_joints']:.2f}" for n in _KEYS[1:]))
                 for key, r in rows]),
        Section("What limits it", remarks),
    ]  # fmt: skip
    data = {suite: list(records.values()) for suite, records in known.items()}
    title = "Dynamics told from short moves"
    publish_results(root, "dynamics", title, sections, data)


_KEYS = ("present", "rated", "found", "body", "dynamics")
_NAMES = ("as heal says", "rated plant", "rated plant, servos as found", "best.xml",
          "best.xml with what was found")  # fmt: skip


def _list_errors(key: str, record: Mapping[str, Any]) -> list[str]:
    """A row of errors over whole moves."""
    last = record["horizons"][-1]
    names = ("given", "refit", "patched", "floor")
    return [key, *("yes" if record[name] else "no" for name in ("exact", "held")),
            record["verdict"], ", ".join(record["effects"]),
            *(f"{last[name]:.3f}" for name in names),
            f"{record['cpu_seconds']:.0f}"]  # fmt: skip


def _list_servos(key: str, record: Mapping[str, Any]) -> list[str]:
    """A row of values, found and hidden."""
    found, hidden = np.degrees(record["offset"])
    size, left = (float(np.sqrt(np.mean(x**2))) for x in (hidden, found - hidden))
    return [key, *("{:.3f} / {:.3f}".format(*record[n]) for n in ("speed", "delay")),
            f"{size:.2f}", f"{left:.2f}"]  # fmt: skip


def _list_ways(key: str, record: Mapping[str, Any]) -> list[str]:
    """A row of ways, walked and predicted [m]."""
    return [key, *(f"{record[name]:.2f}" for name in ("walked", *_KEYS))]


def _mean_gaps(records: list[dict[str, Any]]) -> list[str]:
    """The last row: means of the absolute errors of predicted ways [m]."""
    gaps = [np.mean([abs(r[name] - r["walked"]) for r in records]) for name in _KEYS]
    return ["mean absolute error", "", *(f"{gap:.3f}" for gap in gaps)]

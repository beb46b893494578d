"""The benchmark of the telemetry check: faults put into clean recordings.

    python -m benchmarks.telemetry SUITE... [--count N] [--jobs J]
    python -m benchmarks.telemetry page

`drawn` draws robots, each with a fault of its log or its set-up, and as many without:
they are checked, what the check says is done by a script, and they are checked again.
`known` and `new` are recordings of fourteen robots, checked as they are, then with one
fault each: those that the check was made with, and others that it never saw.
`concealed`, robots whose physics differs from the model, and `devices`, real ones, have
to give no alarm. `page` makes its part of docs/results.
"""

from collections.abc import Mapping

from benchmarks.suites import Record, run_suites
from benchmarks.telemetry.suites import GROUPS, SUITES


def compute_figures(known: Mapping[str, Mapping[str, Record]]) -> dict[str, object]:
    """Counts by fault and by suite, and each that went wrong."""
    injected = [
        {"group": group, "name": name, **one}
        for group in GROUPS
        for name, r in known[group].items()
        for one in r["injected"]
    ]
    drawn = [{"seed": key, **r} for key, r in known["drawn"].items()]
    faulty, clean = ([r for r in drawn if bool(r["fault"]) is f] for f in (True, False))
    quiet = {
        (f"clean, {suite}" if suite in GROUPS else suite): {
            name: r for name, r in records.items() if "alarms" in r
        }
        for suite, records in known.items()
        if suite != "drawn"
    }
    return {
        "groups": GROUPS,
        "faulty": faulty,
        "clean": clean,
        "wrong": [r for r in faulty if r["others"] or r["left"] or not r["told"]]
        + [r for r in clean if r["others"] or r["left"]],
        "injected": {
            fault: {
                group: [
                    r for r in injected if (r["group"], r["fault"]) == (group, fault)
                ]
                for group in GROUPS
            }
            for fault in dict.fromkeys(r["fault"] for r in injected)
        },
        "missed": [r for r in injected if not r["located"]],
        "quiet": quiet,
    }


if __name__ == "__main__":
    run_suites("telemetry", __doc__ or "", SUITES, compute_figures)

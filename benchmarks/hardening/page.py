"""Figures of the page of the hardening: records of its studies in, its cells out."""

from collections import Counter
from collections.abc import Iterable, Mapping

from benchmarks.hardening.originals import KINDS
from benchmarks.suites import Record

Records = Mapping[str, Record]
STUDIES = ("fuzz", "disk", "kills")


def compute_figures(known: Mapping[str, Records]) -> dict[str, object]:
    """What the page shows, and the records that say something.

    Messages are long, and of mutants without a fault nothing is to be learned.
    """
    kept = {
        study: {
            key: {k: v for k, v in record.items() if k != "stderr"}
            for key, record in records.items()
            if record["faults"] or study != "fuzz"
        }
        for study, records in known.items()
    }
    return {
        "records": kept,
        "mutants": {k: _summarize_mutants(v) for k, v in _group(known["fuzz"], KINDS)},
        "disks": {k: _count_ends(v) for k, v in _group(known["disk"])},
        "kills": {k: _count_ends(v) for k, v in _group(known["kills"])},
        "faults": {study: _list_faults(known[study]) for study in STUDIES},
    }


def _group(
    records: Records, names: Iterable[str] = ()
) -> Iterable[tuple[str, list[Record]]]:
    """Records by the first word of their key, in the order of some names."""
    found: dict[str, list[Record]] = {name: [] for name in names}
    for key, record in records.items():
        found.setdefault(key.split()[0], []).append(record)
    return ((name, here) for name, here in found.items() if here)


def _summarize_mutants(here: list[Record]) -> tuple[object, ...]:
    """Cells of a kind: how many were accepted, refused, and did harm."""
    whats = Counter(what for r in here for what in {f["what"] for f in r["faults"]})
    well = Counter(r["code"] for r in here if not r["faults"])
    return (
        len(here),
        well[0],
        well[2],
        ", ".join(f"{n} {what}" for what, n in whats.most_common()) or "none",
        f"{max(r['seconds'] for r in here):.1f}",
        max(r["megabytes"] for r in here),
    )


def _count_ends(here: list[Record]) -> tuple[int, ...]:
    """Cells of a command that writes: runs, whole, refused and faulty."""
    whole = sum(r["code"] == 0 and not r["faults"] for r in here)
    faulty = sum(bool(r["faults"]) for r in here)
    return len(here), whole, len(here) - whole - faulty, faulty


def _list_faults(records: Records) -> list[tuple[object, ...]]:
    """Every fault of a study, those of one cause in one row, with three keys."""
    found = dict[tuple[str, str], list[str]]()
    for key, record in records.items():
        for fault in record["faults"]:
            found.setdefault((fault["what"], fault["detail"]), []).append(key)
    return [
        (what, len(keys), detail.replace("|", "\\|"), ", ".join(keys[:3]))
        for (what, detail), keys in sorted(found.items(), key=lambda x: -len(x[1]))
    ]

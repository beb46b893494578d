"""The page of the hardening: records of its studies in, hardening.md out."""

from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path

from benchmarks.hardening.originals import KINDS
from benchmarks.suites import Record, read_records
from benchmarks.writer import Section, publish_results

STUDIES = ("fuzz", "disk", "kills")
_SHOWN = 3  # keys of records with the same fault; chosen


def write_page(root: Path) -> None:
    """Publish the page of all studies."""
    known = {study: read_records("hardening", study) for study in STUDIES}
    sections = [
        _make_fuzz_section(known["fuzz"]),
        _make_writing_section(
            known["disk"], "Full disks",
            "Commands that write, their folder on a disk with little room, which is "
            "small or filled by another file. Whole: it ended with code 0; refused: "
            "code 1 and one message. A faulty end has another code, a traceback, a "
            "leftover, or lost an earlier file.",
        ),
        _make_writing_section(
            known["kills"], "Kills",
            "Commands killed just before one of the things that they do to files, then "
            "run again with --resume where there is a file. Whole: it ended as one "
            "that was never killed, to the bit but for times, and left nothing else.",
        ),
        *(_make_faults_section(study, known[study]) for study in STUDIES),
    ]  # fmt: skip
    # messages are long, and of those without a fault nothing is to be learned
    data = {
        study: [
            {"key": key, **{k: v for k, v in record.items() if k != "said"}}
            for key, record in records.items()
            if record["faults"] or study != "fuzz"
        ]
        for study, records in known.items()
    }
    title = "Broken files, full disks, kills"
    publish_results(root, "hardening", title, sections, data)


def _make_fuzz_section(records: Mapping[str, Record]) -> Section:
    """How many mutants were accepted, refused, and did harm, by kind."""
    rows = []
    for kind in KINDS:
        here = [r for key, r in records.items() if key.split()[0] == kind]
        if not here:
            continue
        whats = Counter(what for r in here for what in {f["what"] for f in r["faults"]})
        rows.append((
            kind, len(here),
            sum(r["code"] == 0 and not r["faults"] for r in here),
            sum(r["code"] == 2 and not r["faults"] for r in here),
            ", ".join(f"{n} {what}" for what, n in whats.most_common()) or "none",
            f"{max(r['seconds'] for r in here):.1f}",
            max(r["megabytes"] for r in here),
        ))  # fmt: skip
    text = (
        "Damaged files of six kinds, each given to a command that reads it. A command "
        "whose search begins is stopped after five seconds and counts as accepted. "
        "Faults: a traceback, a hang above 20 s, a crash, more than 1 GB, an exit code "
        "other than 0 and 2, other than one message, a warning, a file left over. A "
        "mutant is repeated by `python -m benchmarks.hardening fuzz --kind KIND --seed "
        "SEED`. What an earlier version of the program accepted or refused well is not "
        "read again, unless benchmarks/results/hardening-fuzz.jsonl is removed."
    )
    head = ("kind", "mutants", "accepted", "refused", "faults", "longest [s]",
            "most [MB]")  # fmt: skip
    return Section("Broken files", text, head, rows)


def _make_writing_section(
    records: Mapping[str, Record], title: str, text: str
) -> Section:
    """How commands that write ended, a row each.

    Args:
        records: by key, whose first word is the command.
    """
    found = defaultdict[str, list[Record]](list)
    for key, record in records.items():
        found[key.split()[0]].append(record)
    rows = [
        (name, len(here), sum(r["code"] == 0 and not r["faults"] for r in here),
         sum(r["code"] != 0 and not r["faults"] for r in here),
         sum(bool(r["faults"]) for r in here))
        for name, here in found.items()
    ]  # fmt: skip
    return Section(title, text, ("command", "runs", "whole", "refused", "faulty"), rows)


def _make_faults_section(study: str, records: Mapping[str, Record]) -> Section:
    """Every fault of a study, those of one cause in one row."""
    found = defaultdict[tuple[str, str], list[str]](list)
    for key, record in records.items():
        for fault in record["faults"]:
            found[fault["what"], fault["detail"]].append(key)
    rows = [
        (what, len(keys), detail.replace("|", "\\|"), ", ".join(keys[:_SHOWN]))
        for (what, detail), keys in sorted(found.items(), key=lambda x: -len(x[1]))
    ]
    text = "" if rows else "None."
    return Section(f"Faults: {study}", text, ("fault", "times", "where", "of"), rows)

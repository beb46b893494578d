"""Study `actions`: do chosen actions beat random ones, for our search, with few?"""

from collections.abc import Mapping, Sequence
from typing import Any

from ..errors import InputError
from ..selfmodel.run import Settings
from .calibration import diagram, reliability
from .plan import Asked, Outcome, Picture, Record, Study, Table, Task, chosen
from .statistics import fisher, permuted, share, spread
from .trees import REAL, WHERE, column, gauge, identified, opened, statements

CYCLES, BUDGET = 8, 80_000  # those of docs/results/identify-few-actions.md
_WAYS = {"chosen": False, "random": True}


def _tasks(asked: Asked) -> list[Task]:
    if asked.recordings is None:
        raise InputError(
            "study 'actions' asks the robot of 2006; give --recordings FOLDER"
        )
    return [
        Task(f"{way} {seed}", {"robot": REAL, "way": way, "seed": seed,
                               "recordings": str(asked.recordings)})
        for seed in asked.seeds for way in _WAYS
    ]  # fmt: skip


def _play(settings: Mapping[str, Any]) -> Outcome:
    asked = Settings(
        REAL,
        space="sides",
        random_actions=_WAYS[settings["way"]],
        engine="statics",
        cycles=CYCLES,
        budget=BUDGET,
        seed=settings["seed"],
    )
    return identified(opened(settings), asked)


def _by_way(records: Sequence[Record]) -> dict[str, list[Record]]:
    return {w: chosen(records, way=w) for w in _WAYS}


def _tables(records: Sequence[Record]) -> list[Table]:
    found = _by_way(records)
    wins = {w: (sum(column(rs, "success")), len(rs)) for w, rs in found.items()}
    rows = [
        (f"{way} actions", f"{len(rs):,}", str(CYCLES),
         spread(column(rs, "evaluations"), 0), share(*wins[way]),
         spread(column(rs, "error")), _right_share(rs))
        for way, rs in found.items()
    ]  # fmt: skip
    errors = [column(rs, "error") for rs in found.values()]
    text = (
        f"Our search, attachments at the sides, {WHERE[REAL]}; success: every part on "
        "its true parent; error: mean distance of the parts' centers. Chosen against "
        f"random: successes p = {fisher(*wins.values()):.2g} (Fisher, two-sided), "
        f"errors p = {permuted(*errors):.2g} (permutation of means)."
    )
    head = ("actions", "runs", "of each", "evaluations", "successes (95 %)",
            "error [cm]", "edge F1")  # fmt: skip
    told = "Stated probability of each attachment but part 1's."
    return [
        Table("Chosen against random actions", text, head, rows),
        gauge("Disagreement and error", [(f"{w} actions", rs)
                                         for w, rs in found.items()]),
        reliability("How sure, stated against true", told, statements(records)),
    ]  # fmt: skip


def _right_share(records: Sequence[Record]) -> str:
    """Mean share of right attachments."""
    values = column(records, "edge_f1")
    return f"{sum(values) / len(values):.3f}" if values else ""


def _pictures(records: Sequence[Record]) -> list[Picture]:
    found = _by_way(records)
    told = {f"{w} actions": statements(rs) for w, rs in found.items()}
    return [diagram("How sure, stated against true", told)]


STUDY = Study(
    about="Chosen against random actions: ours, 8 actions, the readings of 2006.",
    tasks=_tasks,
    play=_play,
    tables=_tables,
    pictures=_pictures,
    given=("recordings",),
)

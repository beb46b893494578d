"""The methods that studies compare: a run's settings in, what it found; tests out."""

from collections.abc import Mapping, Sequence
from itertools import combinations

from ..selfmodel.run import Settings
from .columns import extract_column
from .plan import Boxes, Outcome, Record, RunSettings, Table, select_records
from .statistics import run_fisher_test, run_permutation_test
from .trees import evaluate_identification, open_study_robot

METHODS = {
    "random-batch": "baseline 1",
    "random-alternate": "baseline 2",
    "paper": "2006 rule",
    "disagreement": "2006, plain disagreement",
    "ours, random": "ours, random actions",
    "ours": "ours",
}
OURS = ("ours", "ours, random")


def run_method(settings: RunSettings, *, cycles: int, budget: int) -> Outcome:
    """A self-modeling by "method" of the settings; attachments are looked for anywhere.

    Args:
        settings: "robot", "method", "seed" and "recordings" of a run.
        budget: simulations of our search; those of 2006 are 15 climbers' in 200
            generations an action.
    """
    method = settings["method"]
    run_settings = Settings(
        settings["robot"],
        method="default" if method in OURS else method,
        random_actions=method == "ours, random",
        engine="statics",
        cycles=cycles,
        budget=budget,
        seed=settings["seed"],
    )
    return evaluate_identification(open_study_robot(settings), run_settings)


def group_by_method(
    records: Sequence[Record], **wanted: str
) -> dict[str, list[Record]]:
    """Method -> its runs with these settings, of methods that have any."""
    found = {m: select_records(records, method=m, **wanted) for m in METHODS}
    return {method: rs for method, rs in found.items() if rs}


def make_error_picture(title: str, found: Mapping[str, Sequence[Record]]) -> Boxes:
    """A box of errors for each method."""
    series = {METHODS[m]: extract_column(rs, "error") for m, rs in found.items()}
    return Boxes(title, series, "error [cm]")


def make_test_table(title: str, found: Mapping[str, Sequence[Record]]) -> Table:
    """Each method against each."""
    rows = []
    wins = {
        m: (int(sum(extract_column(rs, "success"))), len(rs)) for m, rs in found.items()
    }
    errors = {m: extract_column(rs, "error") for m, rs in found.items()}
    for one, other in combinations(found, 2):
        p = (
            run_fisher_test(wins[one], wins[other]),
            run_permutation_test(errors[one], errors[other]),
        )
        rows.append((METHODS[one], METHODS[other], *(f"{each:.2g}" for each in p)))
    text = (
        "p of successes by Fisher's exact test, of errors by a permutation test of the "
        "means (of 9,999 draws: 0.0002 is the least it can say); both two-sided, none "
        "corrected for there being several."
    )
    head = ("method", "against", "successes, p", "errors, p")
    return Table(title, text, head, rows)

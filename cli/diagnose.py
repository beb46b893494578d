"""`selfheal diagnose`, `replay`, `effects`: a model and recordings in, findings out."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from selfheal.printable import join_names

from ._options import AS_JSON, FORCE, SEED, complete, list_faults, out_file, out_folder
from ._print import print_error, print_json, print_line, print_table, print_text
from ._progress import DiagnosisProgress, ProgressBar, ShowProgress
from ._runs import choose_run_folder, refuse_existing

if TYPE_CHECKING:
    from selfheal.diagnosis.output.result import Diagnosis
    from selfheal.diagnosis.output.schema import Finding, FitScores, Scores

_NO_CHECK = typer.Option(
    metavar="NAME",
    help="A fault of logs to let pass, as `sign`.",
    autocompletion=complete(list_faults),
)
_PREDICTED = "selfheal replay"  # the source of what a replay writes
_MEANS = (
    "Root mean square errors on held-out recordings, replayed in segments of that "
    "length; normalized, 1 is as far off as a constant. given: the model as it is; "
    "refit: what it states, fitted anew; patched: with the findings; floor: what noise "
    "alone leaves. Error without a finding: how many times as large, all else fitted "
    "anew."
)


def diagnose(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL", help="The robot's MJCF or URDF.")
    ],
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="RECORDING.h5...", help="What the real robot did."),
    ],
    out: Annotated[Path | None, out_folder("runs/diagnose-MODEL")] = None,
    held_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="An episode, a piece id[t0,t1], or a file to prove it on; once each.",
        ),
    ] = None,
    no_check: Annotated[list[str] | None, _NO_CHECK] = None,
    seed: Annotated[int, SEED] = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite an earlier diagnosis.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where the same run was killed.")
    ] = False,
    findings_only: Annotated[
        bool, typer.Option("--findings-only", help="Patch nothing that MODEL states.")
    ] = False,
    minutes: Annotated[
        float, typer.Option(help="Then the best answer so far is given; so by Ctrl-C.")
    ] = 30.0,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Find where a model and recordings differ, and which physics is missing."""
    # its matrices are small: a second thread waits, spinning, for the first; before
    # numpy is loaded
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from selfheal.api import diagnose as find
    from selfheal.diagnosis.output.storage import claim_folder

    out = out or _choose_folder(model, resume)
    with (
        claim_folder(out, force=force, resume=resume) as memory,
        ProgressBar("reading", as_json=as_json, asked=progress) as live,
    ):
        if resume and not memory.exists():
            live.say(f"nothing of {out} is unfinished: from the beginning")
        with _heed_interrupts(live, memory) as is_wanted:
            found = find(model, recordings, held_out=held_out or (),
                         no_check=no_check or (), seed=seed, memory=memory,
                         progress=DiagnosisProgress(live), minutes=minutes,
                         stop=is_wanted, findings_only=findings_only)  # fmt: skip
        found.save(out, force=force)
    if as_json:
        extra = {"seconds": round(found.seconds, 1), "folder": str(out)}
        print_json({**found.document, **extra})
    else:
        _print_diagnosis(found, out)


def _choose_folder(model: Path, resume: bool) -> Path:
    """A free folder for a diagnosis of a model; to go on with one, it must be named."""
    from selfheal.errors import InputError

    if resume:
        raise InputError("--resume needs --out FOLDER, that of the killed diagnosis")
    return choose_run_folder(f"diagnose-{model.stem}")


@contextmanager
def _heed_interrupts(live: ProgressBar, memory: Path) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed once, while entered; a second time it interrupts."""
    pressed = threading.Event()
    earlier = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: Any) -> None:
        """Take the first one as the wish for an answer."""
        pressed.set()
        signal.signal(signal.SIGINT, earlier)
        live.say("Ctrl-C: testing the best answer so far; once more ends it at once")

    if earlier is signal.default_int_handler:  # a job in the background ignores it
        signal.signal(signal.SIGINT, note)
    try:
        yield pressed.is_set
    except KeyboardInterrupt:
        if memory.exists():
            print_error("selfheal: --resume goes on where this was")
        raise
    finally:
        signal.signal(signal.SIGINT, earlier)


def _print_diagnosis(found: "Diagnosis", folder: Path) -> None:
    """The verdict, the findings, the errors, the files."""
    from selfheal.diagnosis.output.storage import ALL_FILES
    from selfheal.report.errors import state_errors
    from selfheal.report.phrases import state_verdict

    print_text(state_verdict(found.document), "bold", is_wrapped=False)
    for said in state_errors(found.document["fit"]):
        print_text(said, is_wrapped=False)
    _print_findings(found.document["findings"])
    _print_fit(found.document["fit"])
    for remark in found.remarks:
        print_text(f"note: {remark}")
    for name in ALL_FILES:
        if (folder / name).exists():
            print_line(os.fspath(folder / name))


def _print_findings(findings: Sequence["Finding"]) -> None:
    """A row a finding, and how to tell it from its equals."""
    if not findings:
        return
    from selfheal.report.tables import (
        GROWTH,
        format_growth,
        format_onset,
        format_parameter,
    )

    head = ("effect", "where", "value (90 % interval)", GROWTH)
    rows = [
        (
            found["effect"],
            [found["target"], *filter(None, [format_onset(found)])],
            list(map(format_parameter, found["parameters"])),
            format_growth(found),
        )
        for found in findings
    ]
    print_table(head, rows)
    for found in findings:
        if rivals := found.get("equivalent"):
            how = found.get("separate_by")
            print_text(
                f"{found['effect']} at {found['target']} cannot be distinguished from "
                f"{join_names(rivals)} by these recordings"
                + (f"; to separate them: {how}" if how else "")
            )


def _print_fit(fit: "FitScores") -> None:
    """The error on held-out recordings, also over longer and longer segments."""
    from selfheal.report.errors import MODELS, list_errors, name_replay
    from selfheal.report.tables import format_short

    def make_row(label: str, errors: "Scores") -> list[str]:
        removed = errors.get("explainable_removed")
        share = "\N{EN DASH}" if removed is None else f"{100 * removed:.0f} %"
        return [label, *(format_short(errors.get(key)) for key in MODELS), share]

    if rows := list(list_errors(fit)):
        print_table(("held-out error of", "over", *MODELS), rows)
    each = [make_row("replay", fit)]
    each += [make_row(name_replay(h), h) for h in fit.get("horizons", ())]
    print_table(("normalized", *MODELS, "explainable removed"), each)
    print_text(_MEANS, "dim")


def replay(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A diagnosis.")],
    inputs: Annotated[
        Path, typer.Argument(metavar="INPUTS.h5", help="Commands, start, signals.")
    ],
    out: Annotated[Path, out_file("PREDICTED.h5")] = Path("predicted.h5"),
    model: Annotated[
        Path | None,
        typer.Option(metavar="OTHER.xml", help="Apply the findings to this model."),
    ] = None,
    force: Annotated[bool, FORCE] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Predict what the robot does, by the patched model, open loop."""
    from selfheal.diagnosis.output.replay import replay_recording
    from selfheal.recording import read, write

    start = time.perf_counter()
    _check_replay(folder, inputs, out, model, force)
    with ProgressBar("reading", as_json=as_json, asked=progress) as live:
        predicted = replay_recording(
            folder, read(inputs), model=model, progress=live.show
        )
    predicted = replace(predicted, source=_PREDICTED)
    out.parent.mkdir(parents=True, exist_ok=True)
    write(predicted, out)
    document = {
        "format": "selfheal-replay",
        "version": 1,
        "diagnosis": str(folder),
        "model": None if model is None else str(model),
        "inputs": str(inputs),
        "predicted": str(out),
        "episodes": len(predicted.episodes),
        "samples": sum(e.time.size for e in predicted.episodes.values()),
        "seconds": round(time.perf_counter() - start, 1),
    }
    if as_json:
        print_json(document)
    else:
        print_line(
            f"{out}: {document['episodes']} episodes, {document['samples']} samples "
            f"predicted in {document['seconds']} s"
        )


def _check_replay(
    folder: Path, inputs: Path, out: Path, model: Path | None, force: bool
) -> None:
    """Refuse what cannot work before anything is simulated."""
    from selfheal.diagnosis.output.storage import ALL_FILES, FILES
    from selfheal.errors import InputError
    from selfheal.files import check_file, check_writable, explain_unreadable

    if not os.path.isfile(folder / FILES[0]):
        raise InputError(
            f"{folder} is no diagnosis: it has no {FILES[0]}; make one by 'selfheal "
            "diagnose'"
        )
    if model is not None:
        check_file(model)
    check_file(inputs)
    check_writable(out)
    used = [inputs, *(folder / name for name in ALL_FILES), *filter(None, [model])]
    if out.resolve() in [path.resolve() for path in used]:
        raise InputError(f"--out {out} would overwrite what the prediction is made of")
    if out.exists() and (reason := explain_unreadable(out)):
        raise InputError(f"cannot write {out}: {reason}")
    if out.exists():
        refuse_existing(out, force=force or _is_prediction(out))


def _is_prediction(path: Path) -> bool:
    """Whether a file is an earlier prediction, which a new one may replace."""
    import h5py

    from selfheal.limited_reading import explain_dangerous

    if explain_dangerous(path, "selfheal.files:read_members", "h5py"):
        return False
    try:
        with h5py.File(path) as file:
            return bool(file.attrs.get("source") == _PREDICTED)
    except OSError:
        return False


def effects(as_json: Annotated[bool, AS_JSON] = False) -> None:
    """List the physics that can be found missing."""
    from selfheal.diagnosis.effects import load_catalogue

    found = [
        {"name": e.name, "group": e.group, "says": e.description,
         "equation": e.equation, "source": e.source, "separate_by": e.separate_by}
        for e in load_catalogue().values()
    ]  # fmt: skip
    if as_json:
        print_json({"format": "selfheal-effects", "version": 1, "effects": found})
        return
    head = ("name", "where", "what happens", "equation")
    rows = [
        [str(e[key]) for key in ("name", "group", "says", "equation")] for e in found
    ]
    print_table(head, rows, whole=2)

"""`selfheal diagnose`, `replay`, `effects`: a model and recordings in, findings out."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from selfheal.errors import InputError
from selfheal.files import check_file, check_writable, explain_unreadable
from selfheal.printable import join_names

from ._options import AS_JSON, FORCE, SEED, complete, out_file, out_folder
from ._print import (
    print_document,
    print_error,
    print_json,
    print_line,
    print_paragraph,
    print_table,
)
from ._progress import DiagnosisProgress, ProgressBar, ShowProgress
from ._runs import choose_run_folder, refuse_existing

if TYPE_CHECKING:
    from selfheal.diagnosis.output.result import Diagnosis

_NO_CHECK = typer.Option(
    metavar="NAME",
    help="Kind of log fault to ignore, `sign` say; once each.",
    autocompletion=complete("telemetry:KINDS"),
)
_PREDICTED = "selfheal replay"  # the source of what a replay writes
_MEANS = (
    "Root mean square errors on held-out recordings, replayed in segments of that "
    "length; normalized, 1 is as far off as a constant. given: the model as it is; "
    "refit: its nominal values, fitted anew; patched: with the findings; floor: what "
    "noise alone leaves. Error without a finding: how many times as large, all else "
    "fitted anew."
)

_MODEL = typer.Argument(metavar="MODEL", help="The robot's MJCF or URDF.")
_RECORDINGS = typer.Argument(
    metavar="RECORDING.h5...", help="Recordings of the real robot."
)
_HELD_OUT = typer.Option(
    metavar="ID",
    help="Test data: an episode, a window id[t0,t1] or a file; once each.",
)
_FORCE = typer.Option("--force", help="Overwrite an earlier diagnosis.")
_RESUME = typer.Option("--resume", help="Continue a diagnosis that was killed.")
_FINDINGS_ONLY = typer.Option(
    "--findings-only", help="Keep the nominal values of MODEL."
)
_MINUTES = typer.Option(help="Time limit; Ctrl-C ends it early with an answer.")
_INPUTS = typer.Argument(
    metavar="INPUTS.h5", help="Recording of commands and initial state."
)
_OTHER_MODEL = typer.Option(
    metavar="OTHER.xml", help="Apply the findings to this model."
)


def diagnose(
    model: Annotated[Path, _MODEL],
    recordings: Annotated[list[Path], _RECORDINGS],
    out: Annotated[Path | None, out_folder("runs/diagnose-MODEL")] = None,
    held_out: Annotated[list[str] | None, _HELD_OUT] = None,
    no_check: Annotated[list[str] | None, _NO_CHECK] = None,
    seed: Annotated[int, SEED] = 0,
    force: Annotated[bool, _FORCE] = False,
    resume: Annotated[bool, _RESUME] = False,
    findings_only: Annotated[bool, _FINDINGS_ONLY] = False,
    minutes: Annotated[float, _MINUTES] = 30.0,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Find where a model and recordings differ, and which physics is missing."""
    # its matrices are small: a second thread waits, spinning, for the first; before
    # numpy is loaded
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from selfheal.api import diagnose as find
    from selfheal.diagnosis.output.storage import claim_folder

    if resume and out is None:
        raise InputError("--resume needs --out FOLDER, that of the killed diagnosis")
    out = out or choose_run_folder(f"diagnose-{model.stem}")
    with (
        claim_folder(out, force=force, resume=resume) as memory,
        ProgressBar("reading", as_json=as_json, progress=progress) as live,
    ):
        if resume and not memory.exists():
            live.say(f"nothing of {out} is unfinished: from the beginning")
        with _heed_interrupts(live, memory) as is_wanted:
            found = find(
                model,
                recordings,
                held_out=held_out or (),
                no_check=no_check or (),
                seed=seed,
                memory=memory,
                progress=DiagnosisProgress(live),
                minutes=minutes,
                stop=is_wanted,
                findings_only=findings_only,
            )
        found.save(out, force=force)
    if as_json:
        seconds = round(found.seconds, 1)
        print_json({**found.document, "seconds": seconds, "folder": str(out)})
    else:
        _print_diagnosis(found, out)


@contextmanager
def _heed_interrupts(live: ProgressBar, memory: Path) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed once, while entered; a second time it interrupts."""
    pressed = threading.Event()
    earlier = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: object) -> None:
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

    print_line(state_verdict(found.document), "bold")
    for said in state_errors(found.document["fit"]):
        print_line(said)
    _print_findings(found.document["findings"])
    _print_fit(found.document["fit"])
    for remark in found.remarks:
        print_paragraph(f"note: {remark}")
    for name in ALL_FILES:
        if (folder / name).exists():
            print_line(os.fspath(folder / name))


def _print_findings(findings: Sequence[Mapping[str, Any]]) -> None:
    """A row a finding, and how to separate it from its equals."""
    if not findings:
        return
    from selfheal.report.tables import (
        GROWTH,
        format_growth,
        format_onset,
        format_quantity,
    )

    head = ("effect", "where", "value (90 % interval)", GROWTH)
    rows = [
        (
            found["effect"],
            [found["target"], *filter(None, [format_onset(found)])],
            [f"{p['name']} {format_quantity(p)}" for p in found["parameters"]],
            format_growth(found),
        )
        for found in findings
    ]
    print_table(head, rows)
    for found in findings:
        if rivals := found.get("equivalent"):
            how = found.get("separate_by")
            print_paragraph(
                f"{found['effect']} at {found['target']} cannot be distinguished from "
                f"{join_names(rivals)} by these recordings"
                + (f"; to separate them: {how}" if how else "")
            )


def _print_fit(fit: Mapping[str, Any]) -> None:
    """The error on held-out recordings, also over longer and longer segments."""
    from selfheal.report.errors import MODELS, list_errors, name_replay
    from selfheal.report.tables import format_short

    def make_row(label: str, errors: Mapping[str, Any]) -> list[str]:
        removed = errors.get("explainable_removed")
        share = "\N{EN DASH}" if removed is None else f"{100 * removed:.0f} %"
        return [label, *(format_short(errors.get(key)) for key in MODELS), share]

    if rows := list(list_errors(fit)):
        print_table(("held-out error of", "over", *MODELS), rows)
    each = [make_row("replay", fit)]
    each += [make_row(name_replay(h), h) for h in fit.get("horizons", ())]
    print_table(("normalized", *MODELS, "explainable removed"), each)
    print_paragraph(_MEANS, style="dim")


def replay(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A diagnosis.")],
    inputs: Annotated[Path, _INPUTS],
    out: Annotated[Path, out_file("PREDICTED.h5")] = Path("predicted.h5"),
    model: Annotated[Path | None, _OTHER_MODEL] = None,
    force: Annotated[bool, FORCE] = False,
    as_json: Annotated[bool, AS_JSON] = False,
    progress: ShowProgress = False,
) -> None:
    """Simulate a recording with the patched model, open loop."""
    from selfheal.diagnosis.output.replay import replay_recording
    from selfheal.recording import read, write

    start = time.perf_counter()
    _check_replay(folder, inputs, out, model, force)
    with ProgressBar("reading", as_json=as_json, progress=progress) as live:
        predicted = replay_recording(
            folder, read(inputs), model=model, progress=live.show
        )
    predicted = replace(predicted, source=_PREDICTED)
    out.parent.mkdir(parents=True, exist_ok=True)
    write(predicted, out)
    count = len(predicted.episodes)
    samples = sum(e.time.size for e in predicted.episodes.values())
    seconds = round(time.perf_counter() - start, 1)
    if as_json:
        print_document(
            "replay",
            diagnosis=str(folder),
            model=None if model is None else str(model),
            inputs=str(inputs),
            predicted=str(out),
            episodes=count,
            samples=samples,
            seconds=seconds,
        )
    else:
        print_line(
            f"{out}: {count} episodes, {samples} samples predicted in {seconds} s"
        )


def _check_replay(
    folder: Path, inputs: Path, out: Path, model: Path | None, force: bool
) -> None:
    """Refuse what cannot work before anything is simulated."""
    from selfheal.diagnosis.output.storage import ALL_FILES, FILES

    if not os.path.isfile(folder / FILES[0]):
        raise InputError(
            f"{folder} is no diagnosis: it has no {FILES[0]}; make one by 'selfheal "
            "diagnose'"
        )
    if model is not None:
        check_file(model)
    check_file(inputs)
    check_writable(out)
    if out.exists() and (reason := explain_unreadable(out)):
        raise InputError(f"cannot write {out}: {reason}")
    used = [inputs, *(folder / name for name in ALL_FILES), *filter(None, [model])]
    refuse_existing(out, used, force=force or _is_prediction(out))


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
    """List the effects that a model may lack."""
    from selfheal.diagnosis.effects import load_catalogue

    catalogue = load_catalogue().values()
    if as_json:
        keys = ("name", "group", "equation", "source", "separate_by")
        found = [
            {"says": e.description, **{key: getattr(e, key) for key in keys}}
            for e in catalogue
        ]
        print_document("effects", effects=found)
        return
    head = ("name", "where", "what happens", "equation")
    rows = [(e.name, e.group, e.description, e.equation) for e in catalogue]
    print_table(head, rows, whole=2)

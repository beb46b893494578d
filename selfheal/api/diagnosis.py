"""What Python users call: a model and recordings in, a Diagnosis out."""

import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from ..errors import InputError, check_seed
from ..files import check_file
from ..printable import join_names
from ..recording import Recording, open_recording, strip_file
from .run_files import check_options

if TYPE_CHECKING:
    from ..diagnosis.output.result import Diagnosis

DRAWING_SHARE = 0.97  # of the time that is over when the report is drawn; measured
RecordingLike = Recording | str | os.PathLike[str]


class DiagnoseOptions(TypedDict, total=False):
    """What `diagnose` takes besides model and recordings; all of it may be left out.

    Attributes:
        held_out: what no fit may see and the result is proved on: `id`, `id[t0,t1]`
            [s], `file.h5:id`, `file.h5:id[t0,t1]`, or a path, whose recording is read
            too. Without any: a third of a recording's episodes, such that the others
            span them, or the last third of a lone one.
        no_check: kinds of log faults to ignore, of `selfheal.telemetry.KINDS`.
        seed: of all random numbers, 0 by default.
        memory: folder of checkpoints, in which the same diagnosis goes on where it was
            killed; remove it in the end.
        minutes: time limit [min], about, 30 by default: the best answer so far is given
            then, and says what it left out; `math.inf` for as long as it takes.
        findings_only: keep the nominal values of the model.
    """

    held_out: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
    no_check: Sequence[str]
    seed: int
    memory: str | os.PathLike[str] | None
    minutes: float
    findings_only: bool


def diagnose(
    model: str | os.PathLike[str],
    recordings: RecordingLike | Sequence[RecordingLike],
    *,
    progress: Callable[[str, float], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
    **options: Unpack[DiagnoseOptions],
) -> "Diagnosis":
    """Where a model and recordings differ, and which physics the model lacks.

    Args:
        model: path of the robot's MJCF or URDF.
        recordings: of the real robot: paths, or what `selfheal.recording.read` gave.
        progress: called with what is being done and the share (0 to 1) of the
            time that is over, about; 0 where that is not known.
        stop: called before each batch of simulations; once True, the best answer so far
            is given as soon as it is tested.
        **options: as `DiagnoseOptions` lists them.

    Returns:
        The verdict, the findings and their proof; `save` and `simulate` use them.

    Raises:
        InputError: a file is missing or given twice, a name unfit, or `minutes` <= 0.
        ModelError: MuJoCo cannot load the model.
        RecordingError: a recording breaks the contract, does not fit the model or
            contradicts it as no physics does, or is too short or quiet to decide.
    """
    from ..diagnosis.diagnose import diagnose as find
    from ..report.diagnose import make_diagnosis_page

    check_options(options, DiagnoseOptions.__optional_keys__)
    begun = time.monotonic()
    seed, minutes = options.get("seed", 0), options.get("minutes", 30.0)
    check_seed(seed)
    check_file(model)
    is_over = _make_clock(minutes, stop)
    held_out = _to_list(options.get("held_out", ()))
    read, names = _read_all(_to_list(recordings), held_out, os.fspath(model))
    say = _limit_shares(progress or (lambda what, share: None), begun, minutes)
    noted = _check_logs(model, read, options.get("no_check", ()))
    found = find(
        model,
        read,
        held_out=names,
        seed=seed,
        memory=options.get("memory"),
        progress=say,
        is_over=is_over,
        findings_only=options.get("findings_only", False),
        begun=begun,
    )
    found = replace(found, remarks=(*noted, *found.remarks))
    say("drawing the report", DRAWING_SHARE)
    page = make_diagnosis_page(found, str(model), [r.file for r in read])
    return replace(found, page=page)


def _limit_shares(
    progress: Callable[[str, float], None], begun: float, minutes: float
) -> Callable[[str, float], None]:
    """Progress whose shares are not less than what is over of the time limit."""

    def say(what: str, share: float) -> None:
        over = (time.monotonic() - begun) / (60 * minutes)
        progress(what, min(max(share, over), DRAWING_SHARE) if share else share)

    return say


def _make_clock(minutes: float, stop: Callable[[], bool]) -> Callable[[float], bool]:
    """Whether a share of some minutes from now is over, or `stop` says so."""
    if not minutes > 0:
        raise InputError(f"minutes are {minutes:g}; would fit: more than 0")
    begun = time.monotonic()
    return lambda share: stop() or time.monotonic() - begun > share * 60 * minutes


def _read_all(
    given: Sequence[RecordingLike],
    held_out: Sequence[str | os.PathLike[str]],
    model: str,
) -> tuple[list[Recording], list[str]]:
    """Every recording, and the full names of what is held out."""
    entries = [os.fspath(entry) for entry in held_out]
    files = [entry for entry in entries if _is_file(entry)]
    if not given:
        raise InputError("no recording was given; would fit: at least one")
    read = _open_recordings([*given, *files], spare=len(files), model=model)
    return read, [name for entry in entries for name in _resolve_held_out(entry, read)]


def _check_logs(
    model: str | os.PathLike[str], recordings: Sequence[Recording], skip: Sequence[str]
) -> list[str]:
    """Refuse recordings that contradict the model; other faults, in a line each."""
    from ..recording import check_against_model, list_model_names, load_model
    from ..telemetry import check_telemetry, refuse_faulty

    compiled, noted = load_model(model), list[str]()
    names = list_model_names(compiled)
    for recording in recordings:
        check_against_model(recording, names)
        faults = check_telemetry(recording, compiled)
        for fault in refuse_faulty(recording.file, faults, skip):
            noted.append(f"{recording.file}, {fault.describe()}")
    return noted


def _to_list(given: Any) -> list[Any]:
    """What was given, in a list also where it is one."""
    one = isinstance(given, Recording | str | os.PathLike)
    return [given] if one else list(given)


def _is_file(name: str) -> bool:
    """Whether a name to hold out is that of a file, not of an episode."""
    return name.lower().endswith((".h5", ".hdf5")) and os.path.isfile(name)


def _open_recordings(
    given: Sequence[RecordingLike], spare: int, model: str
) -> list[Recording]:
    """Every recording, checked; none is given twice."""
    found: dict[str, Recording] = {}
    for i, one in enumerate(given):
        name = one.file if isinstance(one, Recording) else os.fspath(one)
        key = os.path.realpath(name)
        if key not in found:
            found[key] = open_recording(one, model=model)
        elif i < len(given) - spare:
            raise InputError(
                f"{name} is given twice, first as {found[key].file}; would fit: each "
                "once, and a `file` of its own for each recording made in Python"
            )
    return list(found.values())


def _resolve_held_out(entry: str, recordings: Sequence[Recording]) -> list[str]:
    """A name to hold out with its file before it; of a file all of its episodes."""
    if _is_file(entry):
        real = os.path.realpath(entry)
        (whole,) = (r for r in recordings if os.path.realpath(r.file) == real)
        return [f"{whole.file}:{name}" for name in whole.episodes]
    exact = [r for r in recordings if entry.startswith(f"{r.file}:")]
    fits = [full for r in exact or recordings if (full := _qualify_episode(entry, r))]
    if len(fits) > 1:
        raise InputError(
            f"held-out {entry!r} fits several recordings; would fit: {join_names(fits)}"
        )
    return fits or [entry]  # a name that fits none is refused where it is used


def _qualify_episode(entry: str, recording: Recording) -> str:
    """The entry with the recording's file before it; empty where it is no episode."""
    name = strip_file(entry, recording.file)
    known = {name, re.sub(r"\[[^\[\]]*\]$", "", name)} & set(recording.episodes)
    return f"{recording.file}:{name}" if known else ""

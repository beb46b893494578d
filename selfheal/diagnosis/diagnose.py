"""A model and recordings in, a diagnosis out: locate, name, prove."""

import os
import time
from collections.abc import Callable, Sequence

import numpy as np

from ..recording import Recording
from .effects import load_catalogue
from .effects.nominal import build_nominal_terms
from .estimation.problem import Problem, build_problem, check_enough_segments
from .output.build_result import build_diagnosis
from .output.result import Diagnosis
from .selection.change_point import (
    choose_held_out_after,
    detect_change_point,
    set_onset,
)
from .selection.holdout import choose_hypothesis, drop_refuted, keep_competitive
from .selection.hypotheses import name_effects, start_search
from .selection.quantization import name_quantization
from .selection.refine import prefer_simpler_names, refine_hypothesis
from .selection.verdict import (
    HeldOutScores,
    analyze_remaining,
    decide_verdict,
    drop_names,
    is_replay_off,
    makes_replay_worse,
    removes_too_little,
)
from .simulation.checks import check_dataset
from .simulation.dataset import LONG, WINDOW, cut_readable_segments, prepare_dataset

Progress = Callable[[str, float], None]


def diagnose(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    *,
    held_out: Sequence[str] = (),
    seed: int = 0,
    memory: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Where simulation and reality differ, and which physics was left out.

    Args:
        model: MJCF or URDF.
        recordings: of the real robot.
        held_out: episodes or pieces kept from the fit, as `recording.split` takes them.
        seed: of the windows that candidates are first tried on.
        memory: folder of what was worked out, in which a killed run goes on.
        progress: told what is being done and how far it is (0 to 1).

    Raises:
        ModelError: MuJoCo cannot load the model, or it diverges.
        RecordingError: a recording does not fit it, or is too short or too quiet.
    """
    begun = time.monotonic()
    say = progress or (lambda what, share: None)
    case = prepare_dataset(model, recordings, held_out, memory)
    check_dataset(case)
    problem = build_problem(case, WINDOW)
    check_enough_segments(case.training, problem)
    search = start_search(
        problem, case.robot, build_nominal_terms(case.robot), load_catalogue().values(),
        rng=np.random.default_rng(seed), progress=say,
    )  # fmt: skip
    onset = (
        None if search.is_done else detect_change_point(search.problem, search.best.fit)
    )
    if onset and not held_out:
        later = choose_held_out_after(onset, recordings, case.held_out)
        if later:  # what is held out now could not show it
            return diagnose(
                model, recordings, held_out=later, seed=seed, memory=memory,
                progress=progress,
            )  # fmt: skip
    search.candidates = set_onset(search.candidates, onset)
    longer = Problem(
        case.training, cut_readable_segments(case.training, LONG), problem.sigma
    )
    namings = name_effects(search, problem, longer)
    case = case.with_noise_of(namings[0].problem.simulator)
    say("fitting everything once more", 0.0)
    namings = [
        prefer_simpler_names(refine_hypothesis(case, n))
        for n in keep_competitive(case, namings)
    ]
    say("testing what was found on the held-out episodes", 0.0)
    naming, refuted = choose_hypothesis(case, [drop_refuted(case, n) for n in namings])
    say("looking for what has no name", 0.0)
    structure = analyze_remaining(case, naming)
    naming, verdict = decide_verdict(naming, structure)
    proof = HeldOutScores.compute(case, naming)
    worse = bool(naming.named) and makes_replay_worse(case, naming, proof)
    if worse or (naming.named and removes_too_little(case, naming, proof)):
        # what does not predict where nothing was fitted is no finding
        refuted = (*refuted, *(n.term.label for n in naming.named))
        naming, verdict = decide_verdict(drop_names(naming), structure)
        verdict = "unlisted" if worse else verdict
        proof = HeldOutScores.compute(case, naming)
    smooth, naming = (
        naming,
        name_quantization(naming, case.robot, load_catalogue().values()),
    )
    if naming is not smooth:
        verdict = {"nothing": "explained", "unlisted": "partly"}.get(verdict, verdict)
        proof = HeldOutScores.compute(case, naming)
    if is_replay_off(case, naming, proof):
        verdict = {"explained": "partly", "nothing": "unlisted"}.get(verdict, verdict)
    return build_diagnosis(case, naming, verdict, proof, structure, refuted, begun)

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
    dataset = prepare_dataset(model, recordings, held_out, memory)
    check_dataset(dataset)
    problem = build_problem(dataset, WINDOW)
    check_enough_segments(dataset.training, problem)
    search = start_search(
        problem,
        dataset.robot,
        build_nominal_terms(dataset.robot),
        load_catalogue().values(),
        rng=np.random.default_rng(seed),
        progress=say,
    )
    onset = (
        None if search.is_done else detect_change_point(search.problem, search.best.fit)
    )
    if onset and not held_out:
        later = choose_held_out_after(onset, recordings, dataset.held_out)
        if later:  # what is held out now could not show it
            return diagnose(
                model, recordings, held_out=later, seed=seed, memory=memory,
                progress=progress,
            )  # fmt: skip
    search.candidates = set_onset(search.candidates, onset)
    longer = Problem(
        dataset.training, cut_readable_segments(dataset.training, LONG), problem.sigma
    )
    hypotheses = name_effects(search, problem, longer)
    dataset = dataset.with_noise_of(hypotheses[0].problem.simulator)
    say("fitting everything once more", 0.0)
    hypotheses = [
        prefer_simpler_names(refine_hypothesis(dataset, n))
        for n in keep_competitive(dataset, hypotheses)
    ]
    say("testing what was found on the held-out episodes", 0.0)
    hypothesis, refuted = choose_hypothesis(
        dataset, [drop_refuted(dataset, n) for n in hypotheses]
    )
    say("looking for what has no name", 0.0)
    structure = analyze_remaining(dataset, hypothesis)
    hypothesis, verdict = decide_verdict(hypothesis, structure)
    proof = HeldOutScores.compute(dataset, hypothesis)
    worse = bool(hypothesis.named) and makes_replay_worse(dataset, hypothesis, proof)
    if worse or (hypothesis.named and removes_too_little(dataset, hypothesis, proof)):
        # what does not predict where nothing was fitted is no finding
        refuted = (*refuted, *(n.term.label for n in hypothesis.named))
        hypothesis, verdict = decide_verdict(drop_names(hypothesis), structure)
        verdict = "unlisted" if worse else verdict
        proof = HeldOutScores.compute(dataset, hypothesis)
    smooth, hypothesis = (
        hypothesis,
        name_quantization(hypothesis, dataset.robot, load_catalogue().values()),
    )
    if hypothesis is not smooth:
        verdict = {"nothing": "explained", "unlisted": "partly"}.get(verdict, verdict)
        proof = HeldOutScores.compute(dataset, hypothesis)
    if is_replay_off(dataset, hypothesis, proof):
        verdict = {"explained": "partly", "nothing": "unlisted"}.get(verdict, verdict)
    return build_diagnosis(
        dataset, hypothesis, verdict, proof, structure, refuted, begun
    )

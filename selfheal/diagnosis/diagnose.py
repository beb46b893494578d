"""A model and recordings in, a diagnosis out: locate, name, prove."""

import os
import time
from collections.abc import Callable, Sequence

import numpy as np

from ..recording import Recording
from .answer import answer_of
from .case import LONG, WINDOW, check_enough, pieces_of, prepare, problem_of
from .effects import catalogue
from .name import begin_search, name_effects
from .onset import began, dated, held_out_later
from .polish import plainest, polished
from .problem import Problem
from .prove import (
    Proof,
    bare,
    is_astray,
    is_little,
    is_worse,
    judged,
    structure_of,
)
from .refute import in_question, likeliest, upheld
from .result import Diagnosis
from .rounding import with_rounding
from .stated import stated_terms
from .usable import check_usable

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
    case = prepare(model, recordings, held_out, memory)
    check_usable(case)
    problem = problem_of(case, WINDOW)
    check_enough(case.world, problem)
    search = begin_search(
        problem, case.scene, stated_terms(case.scene), catalogue().values(),
        rng=np.random.default_rng(seed), progress=say,
    )  # fmt: skip
    onset = None if search.is_done else began(search.problem, search.now.fit)
    if onset and not held_out:
        later = held_out_later(onset, recordings, case.held)
        if later:  # what is held out now could not show it
            return diagnose(
                model, recordings, held_out=later, seed=seed, memory=memory,
                progress=progress,
            )  # fmt: skip
    search.candidates = dated(search.candidates, onset)
    longer = Problem(case.world, pieces_of(case.world, LONG), problem.sigma)
    namings = name_effects(search, problem, longer)
    case = case.heard(namings[0].problem.world)
    say("fitting everything once more", 0.0)
    namings = [plainest(polished(case, n)) for n in in_question(case, namings)]
    say("testing what was found on the held-out episodes", 0.0)
    naming, refuted = likeliest(case, [upheld(case, n) for n in namings])
    say("looking for what has no name", 0.0)
    structure = structure_of(case, naming)
    naming, verdict = judged(naming, structure)
    proof = Proof.of(case, naming)
    worse = bool(naming.named) and is_worse(case, naming, proof)
    if worse or (naming.named and is_little(case, naming, proof)):
        # what does not predict where nothing was fitted is no finding
        refuted = (*refuted, *(n.term.label for n in naming.named))
        naming, verdict = judged(bare(naming), structure)
        verdict = "unlisted" if worse else verdict
        proof = Proof.of(case, naming)
    smooth, naming = naming, with_rounding(naming, case.scene, catalogue().values())
    if naming is not smooth:
        verdict = {"nothing": "explained", "unlisted": "partly"}.get(verdict, verdict)
        proof = Proof.of(case, naming)
    if is_astray(case, naming, proof):
        verdict = {"explained": "partly", "nothing": "unlisted"}.get(verdict, verdict)
    return answer_of(case, naming, verdict, proof, structure, refuted, begun)

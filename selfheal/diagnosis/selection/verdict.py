"""How far a naming holds: takes it, gives a verdict and held-out errors."""

from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.free_form import FreeFormTorque
from ..estimation.candidate_fit import LinearizedFit, fit_candidate
from ..estimation.least_squares import Fit, fit_parameters
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import (
    ABOVE,
    expected_cost,
    expected_noise,
    robust_noise,
    worst_channel_ratio,
)
from ..estimation.problem import Problem, build_initial_state_offsets
from ..simulation import score
from ..simulation.dataset import WINDOW, Dataset, cut_readable_segments
from ..simulation.simulator import Simulator
from .cross_validation import ScoredFit
from .evidence import improvement_p_value
from .holdout import squared_error, squared_error_reestimated
from .hypotheses import Hypothesis
from .refine import refit_native_timestep
from .screening import draw_segments, subsample_problem

STEPPED = 15000  # steps of simulation in a fit to the model's own time step; chosen
EXPLAINED = 0.5  # share of what can be explained that a name must explain; chosen
LITTLE = 0.1  # of it in the held-out episodes: names that remove less are none; chosen
ROOM = 0.05  # of an error, less than which cannot be explained (contract section 2)
WHOLE = 0.9  # share of it that makes a mismatch explained; chosen
# times the re-fitted model's held-out error: no name stands, or none that explains its
# pieces; chosen
WORSE, OTHER = 1.05, 3.0
ASTRAY = 6.0  # times the floor: a replay that far off is not all explained; chosen


def _share_removed_in_segments(case: Dataset, naming: Hypothesis) -> float:
    """Share of the explainable error that the names remove in held-out pieces.

    Signals weighed as in the fit: the contract's score, over their spread there, is of
    little else than one that hardly moves in a few poses; and of a chaotic robot's
    replay it tells where that was when it began.
    """
    sigma, found = naming.problem.sigma, naming.final.fit
    held = Problem(case.held_out, cut_readable_segments(case.held_out, WINDOW), sigma)
    held = marginalize_initial_states(held, found.terms, found.values)
    before, after = np.sqrt(
        [
            squared_error_reestimated(held, naming.nominal.fit),
            squared_error(held, found),
        ]
    )
    room = before - np.sqrt(expected_noise(held))
    return float((before - after) / max(room, ROOM * before))


@dataclass(frozen=True)
class RemainingStructure:
    """What the named effects leave.

    Attributes:
        p_value: that a torque of free form explains no more of it.
        share: of the squared error that it explains.
        above: root mean square of the residual over what noise and time step leave.
        loudest: the same in the worst scored column.
        explained: share of what can be explained that the names explain.
    """

    p_value: float
    share: float
    noise_ratio: float
    worst_channel_ratio: float
    explained: float

    @property
    def is_significant(self) -> bool:
        """Whether something is left that is no noise."""
        shown = self.p_value < 0.01 and self.share > 0.05
        return (shown and self.noise_ratio > 1) or max(
            self.noise_ratio, self.worst_channel_ratio
        ) > ABOVE


def analyze_remaining(case: Dataset, naming: Hypothesis) -> RemainingStructure:
    """What is left beside the names, by a torque of free form and by its size."""
    now, rng = naming.final.fit, np.random.default_rng(1)
    pieces = Problem(
        case.training,
        cut_readable_segments(case.training, WINDOW),
        naming.problem.sigma,
    )
    problem = marginalize_initial_states(
        subsample_problem(pieces, 15000, rng), now.terms, now.values
    )
    base = LinearizedFit.from_fit(
        problem, fit_parameters(problem, now.terms, now.values, rounds=0)
    )
    held = ScoredFit.from_fit(problem, base.fit)
    p, share = 1.0, 0.0
    terms = FreeFormTorque().propose_terms(case.robot)
    for term in terms:
        new = ScoredFit.from_fit(problem, fit_candidate(base, term, rounds=2))
        p = min(p, improvement_p_value(problem, held, new, len(terms)))
        share = max(share, 1 - new.error / held.error)
    left = base.fit.cost
    before = (
        squared_error_reestimated(problem, naming.nominal.fit) if naming.named else left
    )
    noise = expected_cost(problem, base.fit)
    if naming.named and problem.segments.is_single_readings:
        noise = max(noise, robust_noise(problem, base.fit.residuals))
    return RemainingStructure(
        p, share, float(np.sqrt(left / max(noise, 1e-12))),
        worst_channel_ratio(problem, base.fit),
        float((before - left) / max(before - noise, 1e-12)),
    )  # fmt: skip


def drop_names(naming: Hypothesis) -> Hypothesis:
    """The same without any name."""
    return replace(naming, named=(), final=naming.nominal)


@dataclass(frozen=True, eq=False)
class HeldOutScores:
    """Errors on held-out episodes.

    Attributes:
        stated: the re-fitted model, as MuJoCo steps it.
        patched: that with what was named.
        pieces: that were replayed.
        count: readings (E, S).
        squares: squared errors (E, S) of each model.
        numbers: scores, of the floor too.
    """

    nominal: Fit
    patched: Fit
    segments: Segments
    count: Floats
    squares: dict[str, Floats]
    numbers: dict[str, float]

    @classmethod
    def compute(cls, case: Dataset, naming: Hypothesis) -> "HeldOutScores":
        """Of the model as given, re-fitted, and with what was named."""
        world, none = case.held_out, ((), np.zeros(0))
        some = draw_segments(naming.problem, STEPPED, np.random.default_rng(3))
        fits = [naming.nominal.fit, *([naming.final.fit] if naming.named else ())]
        plain = [
            refit_native_timestep(
                LinearizedFit.from_fit(naming.problem, f).select(some)
            )
            for f in fits
        ]
        stated, found = plain[0], plain[-1]
        pieces = score.cut_replay_segments(world)
        count = score.count_readings(world, pieces)
        models = {"given": none, "refit": (stated.terms, stated.values),
                  "patched": (found.terms, found.values)}  # fmt: skip
        squares = {
            k: score.sum_squared_errors(world, pieces, terms, values)
            for k, (terms, values) in models.items()
        }
        numbers = {k: score.compute_score(world, s, count) for k, s in squares.items()}
        numbers["floor"] = min(_noise_floor(case, pieces, found), numbers["patched"])
        return cls(stated, found, pieces, count, squares, numbers)


def decide_verdict(
    naming: Hypothesis, structure: RemainingStructure
) -> tuple[Hypothesis, str]:
    """The verdict; names that explain too little are taken back."""
    if naming.named and structure.is_significant and structure.explained < EXPLAINED:
        return drop_names(naming), "unlisted"
    if naming.named:
        whole = structure.explained > WHOLE or not structure.is_significant
        return naming, "explained" if whole else "partly"
    return naming, "unlisted" if structure.is_significant else "nothing"


def _noise_floor(case: Dataset, pieces: Segments, found: Fit) -> float:
    """Score that the readings' noise alone would leave, as far as it is known.

    Noise is in what a prediction is compared with and, where the initial state was
    read, in what it starts from.
    """
    world = case.held_out
    kick = build_initial_state_offsets(world, pieces)
    told = world.simulate(
        found.terms, np.tile(found.values, (len(kick), 1)), pieces, kick=kick
    )
    moved = np.nansum((told[1:] - told[0]) ** 2, axis=0)
    squares = []
    for c in world.channels:
        noise = np.nansum(np.nan_to_num(c.noise) ** 2)
        read = np.isfinite(pieces.readings[:, c.columns]).all(axis=1)
        start = moved[read][:, c.columns].sum(axis=1)
        squares.append((noise + (start.mean() if read.any() else 0)) / c.spread**2)
    scored = np.array([c.is_scored for c in world.channels])
    return float(np.sqrt(np.mean(np.array(squares)[scored]))) if scored.any() else 0.0


def explainable_removed(numbers: dict[str, float]) -> float | None:
    """The contract's explainable_removed; None where too little could be."""
    room = numbers["refit"] - numbers["floor"]
    if not room >= ROOM * numbers["refit"]:
        return None
    return (numbers["refit"] - numbers["patched"]) / room


def makes_replay_worse(case: Dataset, naming: Hypothesis, proof: HeldOutScores) -> bool:
    """Whether the names make a replay of what is held out worse.

    Not if they explain nearly all in its pieces and it is no other thing: a robot that
    falls, or is chaotic, is soon elsewhere whatever is true of it.
    """
    patched, refit = proof.numbers["patched"], proof.numbers["refit"]
    if not np.isfinite(patched):  # it diverges, whatever the re-fitted model does
        return True
    if patched > OTHER * refit:
        return True
    return patched > WORSE * refit and _share_removed_in_segments(case, naming) < WHOLE


def removes_too_little(case: Dataset, naming: Hypothesis, proof: HeldOutScores) -> bool:
    """Whether names remove next to nothing of what can be explained where held out."""
    if proof.segments.is_single_readings:
        return _share_removed_in_segments(case, naming) < LITTLE
    removed = explainable_removed(proof.numbers)
    if removed is None or removed >= LITTLE:
        return False
    return _share_removed_in_segments(case, naming) < EXPLAINED


def is_replay_off(case: Dataset, naming: Hypothesis, proof: HeldOutScores) -> bool:
    """Whether what is held out is further from the replay than noise can make it.

    Of a robot that something touches in most episodes: in one it may fall on another
    side by chance. And with the time step's own error taken away as well as with it. Of
    single readings nothing tells the noise.
    """
    if proof.segments.is_single_readings:
        return False
    world, found, far = case.held_out, naming.final.fit, ASTRAY * proof.numbers["floor"]
    if _typical_score(world, proof.squares["patched"], proof.count) <= far:
        return False
    finer = score.sum_squared_errors(
        world, proof.segments, found.terms, found.values, centered=True
    )
    return _typical_score(world, finer, proof.count) > far


def _typical_score(world: Simulator, squares: Floats, count: Floats) -> float:
    """Score of squared errors (E, S); where something touches, of half the episodes."""
    if not world.has_contact:
        return score.compute_score(world, squares, count)
    each = zip(squares, count, strict=True)
    return float(
        np.nanmedian([score.compute_score(world, s[None], n[None]) for s, n in each])
    )

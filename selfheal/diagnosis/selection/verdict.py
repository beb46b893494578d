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


def _share_removed_in_segments(dataset: Dataset, hypothesis: Hypothesis) -> float:
    """Share of the explainable error that the names remove in held-out pieces.

    Signals weighed as in the fit: the contract's score, over their spread there, is of
    little else than one that hardly moves in a few poses; and of a chaotic robot's
    replay it tells where that was when it began.
    """
    sigma, found = hypothesis.problem.sigma, hypothesis.final.fit
    held = Problem(
        dataset.held_out, cut_readable_segments(dataset.held_out, WINDOW), sigma
    )
    held = marginalize_initial_states(held, found.terms, found.values)
    before, after = np.sqrt(
        [
            squared_error_reestimated(held, hypothesis.nominal.fit),
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


def analyze_remaining(dataset: Dataset, hypothesis: Hypothesis) -> RemainingStructure:
    """What is left beside the names, by a torque of free form and by its size."""
    now, rng = hypothesis.final.fit, np.random.default_rng(1)
    segments = Problem(
        dataset.training,
        cut_readable_segments(dataset.training, WINDOW),
        hypothesis.problem.sigma,
    )
    problem = marginalize_initial_states(
        subsample_problem(segments, 15000, rng), now.terms, now.values
    )
    base = LinearizedFit.from_fit(
        problem, fit_parameters(problem, now.terms, now.values, rounds=0)
    )
    held = ScoredFit.from_fit(problem, base.fit)
    p, share = 1.0, 0.0
    terms = FreeFormTorque().propose_terms(dataset.robot)
    for term in terms:
        new = ScoredFit.from_fit(problem, fit_candidate(base, term, rounds=2))
        p = min(p, improvement_p_value(problem, held, new, len(terms)))
        share = max(share, 1 - new.error / held.error)
    left = base.fit.cost
    before = (
        squared_error_reestimated(problem, hypothesis.nominal.fit)
        if hypothesis.named
        else left
    )
    noise = expected_cost(problem, base.fit)
    if hypothesis.named and problem.regime.has_single_readings:
        noise = max(noise, robust_noise(problem, base.fit.residuals))
    return RemainingStructure(
        p, share, float(np.sqrt(left / max(noise, 1e-12))),
        worst_channel_ratio(problem, base.fit),
        float((before - left) / max(before - noise, 1e-12)),
    )  # fmt: skip


def drop_names(hypothesis: Hypothesis) -> Hypothesis:
    """The same without any name."""
    return replace(hypothesis, named=(), final=hypothesis.nominal)


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
    def compute(cls, dataset: Dataset, hypothesis: Hypothesis) -> "HeldOutScores":
        """Of the model as given, re-fitted, and with what was named."""
        simulator, none = dataset.held_out, ((), np.zeros(0))
        some = draw_segments(hypothesis.problem, STEPPED, np.random.default_rng(3))
        fits = [
            hypothesis.nominal.fit,
            *([hypothesis.final.fit] if hypothesis.named else ()),
        ]
        plain = [
            refit_native_timestep(
                LinearizedFit.from_fit(hypothesis.problem, f).select(some)
            )
            for f in fits
        ]
        nominal_terms, found = plain[0], plain[-1]
        segments = score.cut_replay_segments(simulator)
        count = score.count_readings(simulator, segments)
        models = {"given": none, "refit": (nominal_terms.terms, nominal_terms.values),
                  "patched": (found.terms, found.values)}  # fmt: skip
        squares = {
            k: score.sum_squared_errors(simulator, segments, terms, values)
            for k, (terms, values) in models.items()
        }
        numbers = {
            k: score.compute_score(simulator, s, count) for k, s in squares.items()
        }
        numbers["floor"] = min(
            _noise_floor(dataset, segments, found), numbers["patched"]
        )
        return cls(nominal_terms, found, segments, count, squares, numbers)


def decide_verdict(
    hypothesis: Hypothesis, structure: RemainingStructure
) -> tuple[Hypothesis, str]:
    """The verdict; names that explain too little are taken back."""
    if (
        hypothesis.named
        and structure.is_significant
        and structure.explained < EXPLAINED
    ):
        return drop_names(hypothesis), "unlisted"
    if hypothesis.named:
        whole = structure.explained > WHOLE or not structure.is_significant
        return hypothesis, "explained" if whole else "partly"
    return hypothesis, "unlisted" if structure.is_significant else "nothing"


def _noise_floor(dataset: Dataset, segments: Segments, found: Fit) -> float:
    """Score that the readings' noise alone would leave, as far as it is known.

    Noise is in what a prediction is compared with and, where the initial state was
    read, in what it starts from.
    """
    simulator = dataset.held_out
    initial_state_offset = build_initial_state_offsets(simulator, segments)
    predicted = simulator.simulate(
        found.terms,
        np.tile(found.values, (len(initial_state_offset), 1)),
        segments,
        initial_state_offset=initial_state_offset,
    )
    moved = np.nansum((predicted[1:] - predicted[0]) ** 2, axis=0)
    squares = []
    for c in simulator.channels:
        noise = np.nansum(np.nan_to_num(c.noise) ** 2)
        read = np.isfinite(segments.readings[:, c.columns]).all(axis=1)
        start = moved[read][:, c.columns].sum(axis=1)
        squares.append((noise + (start.mean() if read.any() else 0)) / c.spread**2)
    scored = np.array([c.is_scored for c in simulator.channels])
    return float(np.sqrt(np.mean(np.array(squares)[scored]))) if scored.any() else 0.0


def explainable_removed(numbers: dict[str, float]) -> float | None:
    """The contract's explainable_removed; None where too little could be."""
    room = numbers["refit"] - numbers["floor"]
    if not room >= ROOM * numbers["refit"]:
        return None
    return (numbers["refit"] - numbers["patched"]) / room


def makes_replay_worse(
    dataset: Dataset, hypothesis: Hypothesis, proof: HeldOutScores
) -> bool:
    """Whether the names make a replay of what is held out worse.

    Not if they explain nearly all in its pieces and it is no other thing: a robot that
    falls, or is chaotic, is soon elsewhere whatever is true of it.
    """
    patched, refit = proof.numbers["patched"], proof.numbers["refit"]
    if not np.isfinite(patched):  # it diverges, whatever the re-fitted model does
        return True
    if patched > OTHER * refit:
        return True
    return (
        patched > WORSE * refit
        and _share_removed_in_segments(dataset, hypothesis) < WHOLE
    )


def removes_too_little(
    dataset: Dataset, hypothesis: Hypothesis, proof: HeldOutScores
) -> bool:
    """Whether names remove next to nothing of what can be explained where held out."""
    if proof.segments.is_single_readings:
        return _share_removed_in_segments(dataset, hypothesis) < LITTLE
    removed = explainable_removed(proof.numbers)
    if removed is None or removed >= LITTLE:
        return False
    return _share_removed_in_segments(dataset, hypothesis) < EXPLAINED


def is_replay_off(
    dataset: Dataset, hypothesis: Hypothesis, proof: HeldOutScores
) -> bool:
    """Whether what is held out is further from the replay than noise can make it.

    Of a robot that something touches in most episodes: in one it may fall on another
    side by chance. And with the time step's own error taken away as well as with it. Of
    single readings nothing tells the noise.
    """
    if proof.segments.is_single_readings:
        return False
    simulator, found, far = (
        dataset.held_out,
        hypothesis.final.fit,
        ASTRAY * proof.numbers["floor"],
    )
    if _typical_score(simulator, proof.squares["patched"], proof.count) <= far:
        return False
    finer = score.sum_squared_errors(
        simulator, proof.segments, found.terms, found.values, centered=True
    )
    return _typical_score(simulator, finer, proof.count) > far


def _typical_score(simulator: Simulator, squares: Floats, count: Floats) -> float:
    """Score of squared errors (E, S); where something touches, of half the episodes."""
    if not simulator.has_contact:
        return score.compute_score(simulator, squares, count)
    each = zip(squares, count, strict=True)
    return float(
        np.nanmedian(
            [score.compute_score(simulator, s[None], n[None]) for s, n in each]
        )
    )

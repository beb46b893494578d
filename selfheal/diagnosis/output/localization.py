"""Where a model is wrong, and where effects act: a hypothesis in, regimes out.

A regime is a kind of motion that effects show in (contract section 2): after a
reversal, at high load, in contact, ...
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import Channel, RobotSummary
from ..data.segments import Segments
from ..effects.base import Term
from ..effects.measurement import Quantization
from ..estimation.problem import Problem
from ..selection.hypotheses import Hypothesis
from ..simulation.dataset import Dataset
from ..simulation.simulator import Simulator
from .result import Localization
from .schema import Location, SignalShare, Window

# in the order of the contract
REGIMES = (
    "reversal",
    "slow",
    "fast",
    "high_load",
    "saturated",
    "contact",
    "near_limit",
    "after_step",
)
EVENT_SECONDS = 0.25  # [s] that a reversal or a step counts for; chosen
MIN_REGIME_SAMPLES = 20  # samples of a regime below which nothing is said of it; chosen
# segments with a difference, below which there is no test; chosen: of 5 its least
# p-value is 1/32
MIN_TESTED_SEGMENTS = 6
MAX_MOTION_STEPS = 400  # steps of an episode at which its motion is looked at; chosen
# shares of the root mean square of a joint's speed: of rest, of slow and fast; chosen
REST_SPEED_SHARE, SLOW_SPEED_SHARE, FAST_SPEED_SHARE = 0.02, 0.1, 1.3
HIGH_LOAD_RATIO = 1.3  # times the root mean square of a load, a high one; chosen
NEAR_LIMIT_SHARE = 0.45  # of a joint's range off its center, near a limit; chosen
SATURATED_SHARE = 0.98  # of the largest force, a saturated one; chosen
COMMAND_STEP_SHARE = 0.1  # of a command's range, a change of it that is a step; chosen

MAX_LISTED_SEGMENTS = 3  # that a finding lists; chosen
MIN_LISTED_SHARE = 0.02  # of the error, less of which a finding does not list; chosen
# share of the gain that a regime has to hold, and how much denser than elsewhere the
# gain has to be there, for a finding to name it; chosen
MIN_REGIME_GAIN, MIN_REGIME_DENSITY = 0.3, 1.5
Masks = np.ndarray  # of bool


@dataclass(frozen=True, eq=False)
class _Motion:
    """What a robot did at each time step of an episode.

    Attributes:
        position: (G, J) of hinges and slides [rad or m].
        velocity: (G, J) [rad/s or m/s].
        load: (G, J) torque of the actuators, or of weight and motion where there are
            none, without its sign [N m or N].
        contact: (G) whether anything touched.
        ctrl: (G, nu) commands.
    """

    position: Floats
    velocity: Floats
    load: Floats
    contact: np.ndarray
    ctrl: Floats


def classify_samples(
    simulator: Simulator, robot: RobotSummary, segments: Segments
) -> np.ndarray:
    """Whether each sample of each signal is in each regime.

    Args:
        simulator: with the episodes and the signals.
        robot: whose joints' typical motion tells what is slow, fast and near.

    Returns:
        (R, M, S) of bool, in the order of `REGIMES` and of the signals.
    """
    out = np.zeros(
        (len(REGIMES), len(segments.sample_steps), len(simulator.channels)), bool
    )
    at = segments.first_step[segments.segment_of_sample] + segments.sample_steps
    episode_of_sample = segments.episode[segments.segment_of_sample]
    for i in range(len(simulator.episodes)):
        rows = np.flatnonzero(episode_of_sample == i)
        if not len(rows):
            continue
        motion = _compute_motion(simulator, robot, i)
        last = len(motion.position) - 1
        near = np.clip(np.round(at[rows]).astype(int), 0, last)
        for s, c in enumerate(simulator.channels):
            regimes = _find_regimes(motion, _find_joints(robot, c), robot)
            out[:, rows, s] = regimes[:, near]
    return out


def _find_joints(robot: RobotSummary, c: Channel) -> list[int]:
    """Which joints, by their order, a signal is about: its own, or all."""
    own = [i for i, j in enumerate(robot.joints) if j.name == c.target]
    if c.kind == "joint_torque":
        at = [a.dof for a in robot.actuators if a.name == c.target]
        own = [i for i, j in enumerate(robot.joints) if j.dof in at]
    return own or list(range(len(robot.joints)))


def _compute_motion(simulator: Simulator, robot: RobotSummary, index: int) -> _Motion:
    """The motion of an episode, from its readings and the nominal model."""
    import mujoco

    model, episode = simulator.compiler.nominal, simulator.episodes[index]
    every = max(1, len(episode.ctrl) // MAX_MOTION_STEPS)
    at = np.arange(0, len(episode.ctrl), every)
    state = simulator.complete_state(index, at)
    qpos, qvel = state.qpos, state.qvel
    data = mujoco.MjData(model)
    load, contact = np.zeros((len(at), model.nv)), np.zeros(len(at), bool)
    for k, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = q, v
        data.ctrl[:] = episode.ctrl[at[k]]
        mujoco.mj_forward(model, data)
        load[k] = np.abs(data.qfrc_actuator if model.nactuator else data.qfrc_bias)
        contact[k] = data.ncon > 0
    grid = np.minimum(np.arange(len(episode.ctrl)) // every, len(at) - 1)
    dof, place = [j.dof for j in robot.joints], [j.qpos for j in robot.joints]
    return _Motion(
        qpos[grid][:, place],
        qvel[grid][:, dof],
        load[grid][:, dof],
        contact[grid],
        episode.ctrl,
    )


def _find_regimes(motion: _Motion, joints: list[int], robot: RobotSummary) -> Masks:
    """Whether any of some joints is in a regime (R, G), at the G steps of a motion."""
    steps = max(1, round(EVENT_SECONDS / robot.timestep))
    out = {name: np.zeros(len(motion.position), bool) for name in REGIMES}
    out["contact"] |= motion.contact & robot.has_contact
    out["after_step"] |= _within_last_steps(_find_command_steps(motion.ctrl), steps)
    for j in joints:
        joint, speed = robot.joints[j], np.abs(motion.velocity[:, j])
        is_moving = speed > REST_SPEED_SHARE * joint.speed
        sign = np.sign(np.where(is_moving, motion.velocity[:, j], 0))
        out["reversal"] |= _within_last_steps(_find_reversals(sign), steps)
        out["slow"] |= speed < SLOW_SPEED_SHARE * joint.speed
        out["fast"] |= speed > FAST_SPEED_SHARE * joint.speed
        load = motion.load[:, j]
        out["high_load"] |= load > HIGH_LOAD_RATIO * np.sqrt(np.mean(load**2)) + 1e-12
        away = np.abs(motion.position[:, j] - joint.range_center)
        out["near_limit"] |= away > NEAR_LIMIT_SHARE * joint.range
        limits = [
            robot.model.actuator_forcerange[a.id, 1]
            for a in robot.actuators
            if a.dof == joint.dof and robot.model.actuator_forcelimited[a.id]
        ]
        if limits:
            out["saturated"] |= load >= SATURATED_SHARE * limits[0]
    return np.stack(list(out.values()))


def _find_command_steps(ctrl: Floats) -> np.ndarray:
    """Whether any command (G, nu) jumps, at each step (G)."""
    if not ctrl.size:
        return np.zeros(len(ctrl), bool)
    change = np.abs(np.diff(ctrl, axis=0, prepend=ctrl[:1]))
    large = COMMAND_STEP_SHARE * (np.ptp(ctrl, axis=0) + 1e-12)
    return (change > large).any(axis=1)


def _find_reversals(sign: Floats) -> np.ndarray:
    """Where a sign (G) becomes its opposite, zeros in between left out; (G) of bool."""
    known = np.flatnonzero(sign)
    out = np.zeros(len(sign), bool)
    if len(known):
        turned = known[1:][np.diff(sign[known]) != 0]
        out[turned] = True
    return out


def _within_last_steps(events: np.ndarray, steps: int) -> np.ndarray:
    """Whether an event (G) was in the last so many steps, at each step (G)."""
    count = np.cumsum(events)
    before = np.zeros_like(count)
    before[steps:] = count[:-steps]
    return count > before


def localize_error(
    simulator: Simulator, robot: RobotSummary, segments: Segments, square: Floats
) -> tuple[Floats, Floats]:
    """Share of the squared error in each regime, and its p-value.

    Args:
        simulator: with the episodes and the signals.
        robot: whose joints' motion makes the regimes.
        square: (M, S) squared residuals [variances].

    Returns:
        share: (S, R) of all squared error; NaN where the regime was hardly seen.
        p_value: (S, R) that the error is no larger there than elsewhere: Wilcoxon's
            signed-rank test over segments, corrected for the whole grid (Holm 1979).
    """
    where, total = classify_samples(simulator, robot, segments), np.nansum(square)
    share = np.full((len(simulator.channels), len(REGIMES)), np.nan)
    p = np.ones_like(share)
    for s in range(len(simulator.channels)):
        for r in range(len(REGIMES)):
            inside = where[r, :, s]
            if min(inside.sum(), (~inside).sum()) < MIN_REGIME_SAMPLES:
                continue
            share[s, r] = np.nansum(square[inside, s]) / max(total, 1e-300)
            p[s, r] = _larger_inside_p_value(segments, square[:, s], inside)
    return share, _correct_holm(p, np.isfinite(share))


def _larger_inside_p_value(
    segments: Segments, square: Floats, inside: np.ndarray
) -> float:
    """p-value that a squared error is no larger inside a regime than outside.

    Args:
        segments: with M samples, each segment with a mean of both.
        square: (M) squared residuals of a signal [variances].
        inside: (M) whether a sample is in the regime.
    """
    from scipy.stats import wilcoxon

    means = []
    for mask in (inside, ~inside):
        segment = segments.segment_of_sample[mask]
        n = np.bincount(segment, minlength=len(segments))
        error = np.nan_to_num(square[mask])
        total = np.bincount(segment, error, minlength=len(segments))
        means.append(np.where(n > 0, total / np.maximum(n, 1), np.nan))
    apart = means[0] - means[1]
    apart = apart[np.isfinite(apart) & (apart != 0)]
    if len(apart) < MIN_TESTED_SEGMENTS:
        return 1.0
    return float(wilcoxon(apart, alternative="greater").pvalue)


def _correct_holm(p: Floats, tested: np.ndarray) -> Floats:
    """p-values (S, R) corrected by Holm (1979) over the cells that were tested (S, R).

    The i-th smallest of n is multiplied by n - i, i from 0, and is no smaller than
    those before it.
    """
    order = np.argsort(p[tested])
    factors = np.arange(len(order), 0, -1)
    fixed = np.maximum.accumulate(np.minimum(1.0, p[tested][order] * factors))
    out = np.ones_like(p)
    out[tested] = fixed[np.argsort(order)]
    return out


def localize_findings(
    dataset: Dataset, hypothesis: Hypothesis
) -> tuple[Localization, dict[int, Location]]:
    """Where the re-fitted model is wrong, and where each named effect acts."""
    simulator, problem = dataset.training, hypothesis.problem
    segments = problem.segments
    refit, final = hypothesis.nominal, hypothesis.final
    before = _square_residuals(problem, refit.terms, refit.values)
    share, p = localize_error(simulator, dataset.robot, segments, before)
    located = Localization(tuple(c.name for c in simulator.channels), REGIMES, share, p)
    where: dict[int, Location] = {}
    after = _square_residuals(problem, final.terms, final.values)
    masks = classify_samples(simulator, dataset.robot, segments)
    for n, named in enumerate(hypothesis.named):
        if isinstance(named.term.effect, Quantization):
            signal = named.term.targets[0].partition(":")[2]
            own = SignalShare(name=signal, share_of_error=1.0)
            own["p_value"] = named.evidence.p_value
            where[n] = {"signals": [own], "regime": "always", "windows": []}
            continue
        without = _square_residuals(problem, *final.without_terms(named.term))
        where[n] = _describe_location(dataset, segments, masks, without - after)
        if onset := named.term.onset:
            where[n]["onset"] = {
                "episode": onset.episode,
                "time": onset.time,
                "low": onset.low,
                "high": onset.high,
            }
    return located, where


def _square_residuals(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Floats:
    """Squared residuals (M, S) [variances], summed over a signal's columns.

    Args:
        problem: with M samples of S signals.
        values: (P) of all their parameters.
    """
    r = problem.unmarginalized.residuals_at(terms, values)
    r = r.reshape(problem.segments.readings.shape)
    return np.stack(
        [(r[:, c.columns] ** 2).sum(axis=1) for c in problem.simulator.channels], axis=1
    )


def _describe_location(
    dataset: Dataset, segments: Segments, masks: np.ndarray, gain: Floats
) -> Location:
    """Where an effect lowers the error: signals, regime and segments.

    Args:
        masks: (R, M, S) whether a sample is in a regime.
        gain: (M, S) by how much the effect lowers the squared error [variances].
    """
    simulator = dataset.training
    by_signal = np.maximum(gain.sum(axis=0), 0)
    by_signal = by_signal / max(by_signal.sum(), 1e-300)
    signals: list[SignalShare] = [
        {
            "name": simulator.channels[s].name,
            "share_of_error": by_signal[s],
            "p_value": improvement_p_value(segments, gain[:, s]),
        }
        for s in np.argsort(-by_signal)
        if by_signal[s] > MIN_LISTED_SHARE
    ]
    by_segment = np.bincount(
        segments.segment_of_sample, gain.sum(axis=1), minlength=len(segments)
    )
    most = np.argsort(-by_segment)[:MAX_LISTED_SEGMENTS]
    return {
        "signals": signals,
        "regime": _find_densest_regime(masks, gain),
        "windows": [_describe_segment(simulator, segments, int(w)) for w in most],
    }


def improvement_p_value(segments: Segments, gain: Floats) -> float:
    """p-value that an effect does not lower an error: Wilcoxon's signed-rank test.

    Args:
        segments: with M samples; each segment is one observation, few or many.
        gain: (M) by how much the effect lowers the squared error [variances].
    """
    from scipy.stats import wilcoxon

    each = np.bincount(segments.segment_of_sample, gain, minlength=len(segments))
    each = each[each != 0]
    return float(wilcoxon(each, alternative="greater").pvalue) if len(each) else 1.0


def _find_densest_regime(masks: np.ndarray, gain: Floats) -> str:
    """The regime that holds the most gain for its size; "always" without any.

    Args:
        masks: (R, M, S) whether a sample is in a regime.
        gain: (M, S) by how much an effect lowers the squared error [variances].
    """
    total, size = gain.sum(), gain.size
    best, density = "always", MIN_REGIME_DENSITY
    for r, name in enumerate(REGIMES):
        inside = masks[r]
        if inside.sum() < MIN_REGIME_SAMPLES or total <= 0:
            continue
        share = gain[inside].sum() / total
        if share > MIN_REGIME_GAIN and share / (inside.sum() / size) > density:
            best, density = name, share / (inside.sum() / size)
    return best


def _describe_segment(simulator: Simulator, segments: Segments, w: int) -> Window:
    """Episode, start and end of a segment."""
    episode = simulator.episodes[int(segments.episode[w])]
    start = episode.start + segments.first_step[w] * simulator.timestep
    end = start + segments.lengths[w] * simulator.timestep
    return {"episode": episode.id, "start": start, "end": end}

"""Where a model is wrong: takes residuals, gives signals, regimes and windows."""

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import Channel, RobotSummary
from ..data.segments import Segments
from ..simulation.simulator import Simulator

REGIMES = ("reversal", "slow", "fast", "high_load", "saturated", "contact",
           "near_limit", "after_step")  # fmt: skip
AFTER = 0.25  # [s] that a reversal or a step counts for; chosen
FEW = 20  # samples of a regime below which nothing is said of it; chosen


def classify_samples(
    simulator: Simulator, robot: RobotSummary, segments: Segments
) -> np.ndarray:
    """Whether each sample of each signal (M, S) is in each regime: (R, M, S)."""
    out = np.zeros(
        (len(REGIMES), len(segments.sample_steps), len(simulator.channels)), bool
    )
    at = segments.first_step[segments.segment_of_sample] + segments.sample_steps
    log = segments.episode[segments.segment_of_sample]
    for i, episode in enumerate(simulator.episodes):
        rows = np.flatnonzero(log == i)
        if len(rows):
            motion = _compute_motion(simulator, robot, i)
            near = np.clip(np.round(at[rows]).astype(int), 0, len(motion[0]) - 1)
            for s, c in enumerate(simulator.channels):
                joints = _find_joints(robot, c)
                for r, name in enumerate(REGIMES):
                    out[r, rows, s] = _is_in_regime(
                        name, motion, joints, episode, robot
                    )[near]
    return out


def _find_joints(robot: RobotSummary, c: Channel) -> list[int]:
    """Which joints (by order) a signal is about: its own, or all."""
    own = [i for i, j in enumerate(robot.joints) if j.name == c.target]
    if c.kind == "joint_torque":
        at = [a.dof for a in robot.actuators if a.name == c.target]
        own = [i for i, j in enumerate(robot.joints) if j.dof in at]
    return own or list(range(len(robot.joints)))


def _compute_motion(simulator: Simulator, robot: RobotSummary, log: int):
    """Position, speed, load (G, J) along an episode's grid, contact (G)."""
    import mujoco

    from ..data.state_estimate import estimate_initial_state

    model, episode = simulator.compiler.nominal, simulator.episodes[log]
    every = max(1, len(episode.ctrl) // 400)
    at = np.arange(0, len(episode.ctrl), every)
    qpos, qvel, _ = estimate_initial_state(simulator, log, at, {})
    data = mujoco.MjData(model)
    load, touch = np.zeros((len(at), model.nv)), np.zeros(len(at), bool)
    for k, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = q, v
        data.ctrl[:] = episode.ctrl[at[k]]
        mujoco.mj_forward(model, data)
        load[k] = np.abs(data.qfrc_bias) if not model.nu else np.abs(data.qfrc_actuator)
        touch[k] = data.ncon > 0
    grid = np.minimum(np.arange(len(episode.ctrl)) // every, len(at) - 1)
    dofs, places = [j.dof for j in robot.joints], [j.qpos for j in robot.joints]
    return qpos[grid][:, places], qvel[grid][:, dofs], load[grid][:, dofs], touch[grid]


def _is_in_regime(
    name: str, motion, joints, episode, robot: RobotSummary
) -> np.ndarray:
    """(G) whether any of the joints is in the regime."""
    q, v, load, touch = motion
    found = np.zeros(len(q), bool)
    if name == "contact":
        return touch if robot.has_contact else found
    after = max(1, round(AFTER / robot.timestep))
    if name == "after_step":
        jumps = np.zeros(len(q), bool)
        if episode.ctrl.size:
            change = np.abs(np.diff(episode.ctrl, axis=0, prepend=episode.ctrl[:1]))
            large = 0.1 * (np.ptp(episode.ctrl, axis=0) + 1e-12)
            jumps = (change > large).any(axis=1)
        return _within_last_steps(jumps, after)
    for j in joints:
        joint = robot.joints[j]
        found |= _is_joint_in_regime(
            name, joint, q[:, j], v[:, j], load[:, j], after, robot
        )
    return found


def _is_joint_in_regime(
    name, joint, q, v, load, after: int, robot: RobotSummary
) -> np.ndarray:
    if name == "reversal":
        lively = np.abs(v) > 0.02 * joint.speed
        sign = np.sign(np.where(lively, v, 0))
        return _within_last_steps(_find_reversals(sign), after)
    if name == "slow":
        return np.abs(v) < 0.1 * joint.speed
    if name == "fast":
        return np.abs(v) > 1.3 * joint.speed
    if name == "high_load":
        return load > 1.3 * np.sqrt(np.mean(load**2)) + 1e-12
    if name == "near_limit":
        return np.abs(q - joint.range_center) > 0.45 * joint.range
    limits = [
        robot.model.actuator_forcerange[a.id, 1]
        for a in robot.actuators
        if a.dof == joint.dof and robot.model.actuator_forcelimited[a.id]
    ]
    return load >= 0.98 * limits[0] if limits else np.zeros(len(q), bool)


def _find_reversals(sign: Floats) -> np.ndarray:
    """Where a sign, zeros passed over, becomes its opposite."""
    known = np.flatnonzero(sign)
    out = np.zeros(len(sign), bool)
    if len(known):
        turned = known[1:][np.diff(sign[known]) != 0]
        out[turned] = True
    return out


def _within_last_steps(events: np.ndarray, steps: int) -> np.ndarray:
    """Whether one of the events was in the last so many steps."""
    count = np.cumsum(events)
    before = np.zeros_like(count)
    before[steps:] = count[:-steps]
    return count > before


def localize_error(
    simulator: Simulator, robot: RobotSummary, segments: Segments, square: Floats
):
    """Share (S, R) of the squared error (M, S) in each regime, and its p-value.

    The p-value is that the error is larger there than elsewhere, over windows
    (Wilcoxon's signed ranks), corrected for the whole grid (Holm 1979).
    """
    from scipy.stats import wilcoxon

    where = classify_samples(simulator, robot, segments)
    total = np.nansum(square)
    share = np.full((len(simulator.channels), len(REGIMES)), np.nan)
    p = np.ones_like(share)
    count = len(segments)
    for s in range(len(simulator.channels)):
        for r in range(len(REGIMES)):
            inside = where[r, :, s]
            if inside.sum() < FEW or (~inside).sum() < FEW:
                continue
            share[s, r] = np.nansum(square[inside, s]) / max(total, 1e-300)
            means = []
            for mask in (inside, ~inside):
                n = np.bincount(segments.segment_of_sample[mask], minlength=count)
                e = np.bincount(
                    segments.segment_of_sample[mask],
                    np.nan_to_num(square[mask, s]),
                    minlength=count,
                )
                means.append(np.where(n > 0, e / np.maximum(n, 1), np.nan))
            apart = means[0] - means[1]
            apart = apart[np.isfinite(apart) & (apart != 0)]
            if len(apart) >= 6:
                p[s, r] = wilcoxon(apart, alternative="greater").pvalue
    return share, _correct_holm(p, np.isfinite(share))


def _correct_holm(p: Floats, tested: np.ndarray) -> Floats:
    """Holm's correction over the cells that were tested."""
    flat = np.flatnonzero(tested.ravel())
    order = flat[np.argsort(p.ravel()[flat])]
    out, worst = np.ones(p.size), 0.0
    for i, cell in enumerate(order):
        worst = max(worst, min(1.0, p.ravel()[cell] * (len(order) - i)))
        out[cell] = worst
    return out.reshape(p.shape)

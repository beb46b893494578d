"""What drives can have: late, limited or weak commands, and more of a servo."""

import math
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np
from mujoco import MjData

from benchmarks.hidden.effects.base import (
    Draw,
    Install,
    Joint,
    Sized,
    Values,
    draw_nothing,
    draw_number,
    find_load,
    find_speed,
    make_joint_force,
    push_joint,
)
from benchmarks.hidden.robots.robot import Rng, Robot, get_name
from benchmarks.hidden.truth import CommandShaper, Force, HiddenRobot, scale_gain

# ---------------------------------------------------------------- commands


def _delay_command(delay: float, fine: float) -> CommandShaper:
    """The command of `delay` [s] ago; before the first, the first."""
    line: deque[float] = deque(maxlen=round(delay / fine) + 1)

    def shape(command: float, speed: float, first: bool) -> float:
        if first:
            line.extend([command] * (line.maxlen or 1))
        line.append(command)
        return line[0]

    return shape


def _lag_command(timeconst: float, fine: float) -> CommandShaper:
    """First-order lag: d command / dt = (sent - command) / timeconst."""
    share, state = 1 - math.exp(-fine / timeconst), [0.0]

    def shape(command: float, speed: float, first: bool) -> float:
        if first:
            state[0] = command
        state[0] += share * (command - state[0])
        return state[0]

    return shape


def _limit_rate(rate: float, fine: float) -> CommandShaper:
    """The command moves at most at `rate` [rad/s]."""
    most, state = rate * fine, [0.0]

    def shape(command: float, speed: float, first: bool) -> float:
        if first:
            state[0] = command
        state[0] += min(max(command - state[0], -most), most)
        return state[0]

    return shape


def _lead_command(lead: float, fine: float) -> CommandShaper:
    """A goal that is ahead by its speed: command + lead d command / dt."""
    return lambda command, speed, first: command + lead * speed


def _shape(make: Callable[[float, float], CommandShaper], key: str) -> Install:
    """What installs a shaper, from a parameter and the fine step [s]."""

    def install(truth: HiddenRobot, target: str, v: Values) -> None:
        chain = truth.shapers.setdefault(get_name(target), [])
        chain.append(lambda fine: make(v[key], fine))

    return install


def _install_shift(truth: HiddenRobot, target: str, v: Values) -> None:
    """All commands come late, or before the recording says so."""
    truth.ahead = max(-v["shift"], 0.0)
    if v["shift"] > 0:
        for actuator in truth.robot.actuators:
            _shape(_delay_command, "shift")(truth, f"actuator:{actuator}", v)


def _draw_rate(robot: Robot, target: str, rng: Rng) -> Sized:
    """Largest rate of a command; larger sizes are slower."""
    speed = find_speed(robot, target)
    return lambda s: {"rate": 2.0 * speed / (1 + s)}


# ---------------------------------------------------------------- limits


def _draw_torque_limit(robot: Robot, target: str, rng: Rng) -> Sized:
    """Limit of a motor torque; larger sizes are smaller limits."""
    load = find_load(robot, target)
    return lambda s: {"limit": load * max(1.6 / (1 + 0.5 * s), 0.15)}


def _install_saturation(truth: HiddenRobot, target: str, v: Values) -> None:
    actuator = truth.spec.actuator(get_name(target))
    actuator.forcerange, actuator.forcelimited = [-v["limit"], v["limit"]], 1


def _install_goals(truth: HiddenRobot, target: str, v: Values) -> None:
    actuator = truth.spec.actuator(get_name(target))
    actuator.ctrlrange, actuator.ctrllimited = [v["low"], v["high"]], 1


def _draw_speed_limit(robot: Robot, target: str, rng: Rng) -> Sized:
    """Stall torque and no-load speed of a motor; larger sizes are weaker motors."""
    load, speed = find_load(robot, target), find_speed(robot, target)
    stall = rng.uniform(2.0, 3.5)

    def values(size: float) -> Values:
        soft = 1 / (1 + 0.4 * size)
        return {
            "stall_torque": stall * load * (0.5 + soft),
            "no_load_speed": 3.0 * speed * soft,
        }

    return values


def _install_speed_limit(truth: HiddenRobot, target: str, v: Values) -> None:
    """A force limit of the actuator that falls with speed."""
    _install_saturation(truth, target, {"limit": 1.0})
    push_joint(_push_speed_limit)(truth, target, v)


def _push_speed_limit(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """Torque in the direction of motion falls from stall to 0 at the no-load speed."""
    ratio, stall = float(data.qvel[joint.dof]) / v["no_load_speed"], v["stall_torque"]
    high = stall * min(max(1 - ratio, 0.0), 1.0)
    low = stall * min(max(1 + ratio, 0.0), 1.0)
    joint.model.actuator_forcerange[joint.actuator] = (-low, high)


# ---------------------------------------------------------------- gains


def _draw_kp(robot: Robot, target: str, rng: Rng) -> Sized:
    """Gain of a position servo: below the stated one, or above it in 40 % of cases."""
    actuator, more = robot.model.actuator(get_name(target)), rng.random() < 0.4
    given = float(actuator.gainprm[0])
    if more:
        return lambda s: {"kp": given * (1.4 + 0.5 * s)}
    return lambda s: {"kp": given * max(0.65 / (1 + 0.4 * s), 0.2)}


def _install_gain(truth: HiddenRobot, target: str, v: Values) -> None:
    """Another gain of a position servo; of a thruster at a site, its gear."""
    actuator = truth.spec.actuator(get_name(target))
    if truth.robot.drive == "servo":
        scale_gain(actuator, "kp", v["kp"] / float(actuator.gainprm[0]))
    else:
        scale_gain(actuator, "gear", v["kp"] / np.abs(actuator.gear[:3]).max())


def _install_torque_constant(truth: HiddenRobot, target: str, v: Values) -> None:
    scale_gain(truth.spec.actuator(get_name(target)), "gear", v["gain"])


def _draw_integral(robot: Robot, target: str, rng: Rng) -> Sized:
    load = find_load(robot, target)
    return lambda s: {"ki": 10 * load * s, "imax": 0.6 * load}


def _make_integral(joint: Joint, v: Values) -> Force:
    """Torque = ki x integral of the servo's error, within imax; 0 at time 0."""
    total, fine, imax = [0.0], float(joint.model.opt.timestep), v["imax"]

    def push(data: MjData, time: float) -> None:
        if time < 0:
            return
        error = float(data.ctrl[joint.control]) - float(data.qpos[joint.q])
        total[0] = min(max(total[0] + v["ki"] * error * fine, -imax), imax)
        data.qfrc_applied[joint.dof] += total[0]

    return push


def _push_dead_band(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """The servo's stiffness does nothing within a torque [N m] of its error."""
    error = float(data.ctrl[joint.control] - data.qpos[joint.q])
    commanded, width = joint.stiffness * error, v["width"]
    data.qfrc_applied[joint.dof] -= min(max(commanded, -width), width)


def _install_compensation(truth: HiddenRobot, target: str, v: Values) -> None:
    """The controller carries the weight that the given model has."""
    for body in truth.spec.bodies[1:]:
        if body.mass:
            body.gravcomp = truth.robot.model.body(body.name).mass[0] / body.mass


def _install_soft_base(truth: HiddenRobot, target: str, v: Values) -> None:
    """The base rocks about its y axis."""
    base = truth.spec.body(get_name(target))
    joint = base.add_joint(name="mount", axis=[0, 1, 0])
    joint.stiffness[0], joint.damping[0] = v["stiffness"], v["damping"]
    truth.sprung.append("mount")


PHYSICS: Mapping[str, tuple[Draw, Install]] = {
    "command_delay": (draw_number("delay", 0.01), _shape(_delay_command, "delay")),
    "actuator_lag": (draw_number("timeconst", 0.02), _shape(_lag_command, "timeconst")),
    "torque_saturation": (_draw_torque_limit, _install_saturation),
    "speed_torque_limit": (_draw_speed_limit, _install_speed_limit),
    "servo_gain": (_draw_kp, _install_gain),
    "rate_limit": (_draw_rate, _shape(_limit_rate, "rate")),
    "integral_action": (_draw_integral, make_joint_force(_make_integral)),
    "command_range": (draw_nothing, _install_goals),
    "clock_shift": (draw_nothing, _install_shift),
    "torque_constant": (draw_nothing, _install_torque_constant),
    "velocity_feedforward": (draw_nothing, _shape(_lead_command, "lead")),
    "dead_band": (draw_nothing, push_joint(_push_dead_band)),
    "gravity_compensation": (draw_nothing, _install_compensation),
    "base_compliance": (draw_nothing, _install_soft_base),
}

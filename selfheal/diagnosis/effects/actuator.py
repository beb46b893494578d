"""What lies between the command and the torque: delays, filters, limits, gains."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...mjcf.edit import Edit, Rename, Set, format_number
from ...recording.actuator_laws import (
    find_goal,
    get_servo_gains,
    has_affine_force,
    is_pid,
)
from ...recording.data import Floats
from ..data.robot_summary import Actuator, RobotSummary
from .by_target import ActuatorEffect
from .commands import (
    STALE_STEPS,
    CommandGrid,
    change_columns,
    delay_commands,
    filter_column,
    limit_rate_of_column,
)
from .declaration import SELDOM, USUAL, ParameterSpec, Proposal
from .places import ActuatorPlace, Place
from .protocols import CommandFilter, JointForce, ModelEdit, StepState, TextForm

if TYPE_CHECKING:
    from mujoco import MjModel


class CommandDelay(
    ActuatorEffect,
    CommandFilter[ActuatorPlace],
    ModelEdit[ActuatorPlace],
    TextForm[ActuatorPlace],
):
    """A delay beyond the one that the model states."""

    name = "command_delay"
    description = "A command takes effect some time after it is given."
    equation = "u(t) = ctrl(t - delay)"
    source = "MuJoCo actuator/delay (3.5)"
    separate_by = "move the joint by hand: a late sensor shows then, a late command not"
    phrase = "{at} acts on its commands {delay} late"
    parameters = (ParameterSpec("delay", "s", nominal=0.0, nonnegative=True),)
    log_odds = USUAL
    is_shared = True

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        if not robot.model.actuator_ctrlnum[actuator.id]:
            return None
        least = max(robot.contact_timing_error, STALE_STEPS * robot.timestep)
        delay = self.bound("delay", (0.0, 0.3), scale=0.01, resolution=least)
        return Proposal((delay,), ((0.005,), (0.02,), (0.06,)))

    def transform_command(
        self, ctrl: Floats, grid: CommandGrid, place: ActuatorPlace, values: Floats
    ) -> Floats:
        return delay_commands(ctrl, place.controls, values / grid.step)

    def is_whole_in_text(self, place: Place) -> bool:
        """MuJoCo delays by whole time steps."""
        return False

    def edit_model(
        self, model: "MjModel", place: ActuatorPlace, values: Floats
    ) -> None:
        if place.is_patched:  # out of a patched model: `transform_command` does it
            rest = model.actuator_delay[place.actuator] - values[0]
            least = 1e-6 * model.opt.timestep  # a text's last digit
            model.actuator_delay[place.actuator] = rest if rest > least else 0.0

    def edit_text(
        self, model: "MjModel", place: ActuatorPlace, values: Floats
    ) -> list[Edit]:
        delay = float(model.actuator_delay[place.actuator]) + values[0]
        steps = int(np.ceil(delay / model.opt.timestep)) + 1
        attributes = {
            "delay": format_number(delay),
            "nsample": str(max(steps, 2) + 1),
            "interp": "linear",
        }
        return [Set("actuator", name_or_id(model, place), attributes)]


class ActuatorLag(
    ActuatorEffect, CommandFilter[ActuatorPlace], TextForm[ActuatorPlace]
):
    name = "actuator_lag"
    description = "The actuator follows its command as a first-order filter does."
    equation = "timeconst du/dt = ctrl - u"
    source = "MuJoCo actuator/dyntype filterexact"
    separate_by = "command sines of rising frequency: a lag weakens them, a delay not"
    phrase = "{at} follows its commands with a time constant of {timeconst} {lacks}"
    parameters = (ParameterSpec("timeconst", "s", nominal=0.0, nonnegative=True),)
    is_shared = True

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        model, a = robot.model, actuator.id
        if model.actuator_dyntype[a] or not has_affine_force(model, a):
            return None
        least = STALE_STEPS * robot.timestep
        p = self.bound("timeconst", (0.0, 1.0), scale=0.02, resolution=least)
        return Proposal((p,), ((0.01,), (0.05,), (0.2,)))

    def transform_command(
        self, ctrl: Floats, grid: CommandGrid, place: ActuatorPlace, values: Floats
    ) -> Floats:
        timeconst = values[:, 0]
        keep = np.exp(-grid.step / np.maximum(timeconst, 1e-9))

        def follow(u: Floats) -> Floats:
            """As the command was when each step began, or in its middle."""
            filtered = filter_column(u, keep)
            if not grid.is_mean:
                return filtered
            after = np.append(filtered[:, 1:], filtered[:, -1:], axis=1)
            is_slow = timeconst[:, None] > 0
            return np.where(is_slow, (filtered + after) / 2, filtered)

        return change_columns(ctrl, place.controls, follow)

    def edit_text(
        self, model: "MjModel", place: ActuatorPlace, values: Floats
    ) -> list[Edit]:
        return rename_to_general(model, place, dyntype="filterexact", dynprm=values[0])


class RateLimit(ActuatorEffect, CommandFilter[ActuatorPlace]):
    name = "rate_limit"
    description = "The servo moves its goal no faster than a rate."
    equation = "|du/dt| <= rate"
    source = "MuJoCo actuator/pid slewmax"
    separate_by = "step the command by several sizes"
    phrase = "{at} follows its commands at {rate} at most"
    parameters = (ParameterSpec("rate", "rad/s", nominal=np.inf, nonnegative=True),)
    is_shared = True

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        """Of what holds a position, in whatever units that is commanded."""
        rate = actuator.max_rate
        if find_goal(robot.model, actuator.id) < 0 or not rate > 0:
            return None
        p = self.bound("rate", (1e-2 * rate, 1e3 * rate), scale=rate, at=actuator)
        if not actuator.servo:  # commanded in other units than the position's
            p = replace(p, unit="ctrl/s")
        return Proposal((p,), tuple((share * rate,) for share in (0.3, 1.0, 3.0)))

    def transform_command(
        self, ctrl: Floats, grid: CommandGrid, place: ActuatorPlace, values: Floats
    ) -> Floats:
        most = values[:, 0] * grid.step
        return change_columns(
            ctrl, [place.goal], lambda u: limit_rate_of_column(u, most)
        )


class ThermalDerating(ActuatorEffect, CommandFilter[ActuatorPlace]):
    """A thermal model of first order (I^2 t): resistance rises with temperature.

    Each episode begins cold.
    """

    name = "thermal_derating"
    description = "The motor gives less torque the warmer its torques have made it."
    equation = "tau = tau_stated / (1 + loss h), timeconst dh/dt = (gear ctrl)^2 - h"
    source = "IEC 60034-11, thermal protection of motors"
    separate_by = "hold a weight for a minute after a rest: the joint sinks slowly"
    phrase = (
        "{at} gets weaker as it warms up, by {loss} of squared torque with a time "
        "constant of {timeconst}"
    )
    parameters = (
        ParameterSpec("loss", "1/(N m)^2", nominal=0.0, nonnegative=True),
        ParameterSpec("timeconst", "s", nonnegative=True),
    )
    log_odds = SELDOM

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        """Of motors, which are commanded a torque."""
        model, a = robot.model, actuator.id
        laws = model.actuator_gaintype, model.actuator_biastype, model.actuator_dyntype
        is_motor = not any(law[a] for law in laws) and model.actuator_gainprm[a, 0] == 1
        if not (is_motor and actuator.dof >= 0 and actuator.max_force > 0):
            return None
        most = 1 / actuator.max_force**2
        loss = self.bound("loss", (0.0, 20 * most), scale=0.3 * most, at=actuator)
        # of a small winding seconds, of a large motor's housing an hour
        time = self.bound("timeconst", (1.0, 3600.0), scale=10.0, nominal=30.0)
        return Proposal((loss, time), ((most, 10.0), (most, 100.0)))

    def transform_command(
        self, ctrl: Floats, grid: CommandGrid, place: ActuatorPlace, values: Floats
    ) -> Floats:
        loss, keep = values[:, :1], np.exp(-grid.step / values[:, 1])

        def derate(u: Floats) -> Floats:
            squares = (place.gear * u) ** 2
            cold = np.concatenate([0 * squares[:, :1], squares], axis=1)
            return u / (1 + loss * filter_column(cold, keep)[:, 1:])

        return change_columns(ctrl, place.controls, derate)


class SpeedTorqueLimit(ActuatorEffect, JointForce[ActuatorPlace]):
    name = "speed_torque_limit"
    description = "The torque that the motor can give falls with its speed."
    equation = "tau sign(v) <= stall_torque (1 - |v| / no_load_speed)"
    source = "any motor's data sheet"
    separate_by = "command full torque from rest and watch the speed grow"
    phrase = (
        "{at} gives less torque the faster it turns: {stall_torque} at rest, none at "
        "{no_load_speed}"
    )
    parameters = (
        ParameterSpec("stall_torque", "N m", nominal=np.inf, nonnegative=True),
        ParameterSpec("no_load_speed", "rad/s", nominal=np.inf, nonnegative=True),
    )
    needs = frozenset({"forcerange"})

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        if actuator.dof < 0:
            return None
        joint = robot.joint_by_dof(actuator.dof)
        m, v = actuator.max_force, joint.max_speed
        parameters = (
            self.bound("stall_torque", (0.01 * m, 20 * m), scale=0.2 * m, at=actuator),
            self.bound("no_load_speed", (0.2 * v, 100 * v), scale=0.3 * v, at=joint),
        )
        shares = ((1, 1.3), (0.6, 1.3), (1, 4), (0.2, 1.3), (0.2, 4))
        return Proposal(parameters, tuple((a * m, b * v) for a, b in shares))

    def apply_forces(
        self, state: StepState, place: ActuatorPlace, values: Floats
    ) -> None:
        a, gear = place.actuator, place.gear
        stall, speed = values.T
        share = state.qvel[:, place.dof] / speed
        up = stall * np.clip(1 - share, 0, 1) / abs(gear)
        down = -stall * np.clip(1 + share, 0, 1) / abs(gear)
        low, high = (down, up) if gear > 0 else (-up, -down)
        assert state.forcerange is not None  # by `needs`
        limits = state.forcerange[:, a]
        limits[:, 0] = np.maximum(limits[:, 0], low)
        limits[:, 1] = np.minimum(limits[:, 1], high)


class ServoGain(ActuatorEffect, ModelEdit[ActuatorPlace]):
    """Gains of a servo, or the gain of a motor [N m/ctrl] alone.

    A servo may be commanded in other units than its length's. Its kp is that of its
    length then, and the gain of its command changes by the same factor.
    """

    name = "servo_gain"
    description = (
        "The servo is stiffer or softer, a motor stronger or weaker than stated."
    )
    equation = "tau = kp (ctrl - q) - kv v; of a motor, tau = kp ctrl"
    source = "MuJoCo actuator/position"
    separate_by = "load the held joint with a known weight"
    phrase = "{at} has gains {other} ({all})"
    parameters = (
        ParameterSpec("kp", "N m/rad", nonnegative=True, is_in_model=True),
        ParameterSpec("kv", "N m s/rad", nonnegative=True, is_in_model=True),
    )
    parameter_sets = (("kp", "kv"), ("kp",))
    overrides = ("kp", "kv", "gain", "bias", "gear")

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        model, a = robot.model, actuator.id
        laws = model.actuator_gaintype[a], model.actuator_biastype[a]
        is_motor = max(laws) == 0 and model.actuator_gainprm[a, 0] > 0
        kp, kv = get_servo_gains(model, a)
        if holds := find_goal(model, a) >= 0:
            kp = -float(model.actuator_biasprm[a, 1])
        elif not is_motor:
            return None
        stiffness = self.bound(
            "kp", (0.05 * kp, 20 * kp), scale=0.2 * kp, at=actuator, nominal=kp
        )
        if not holds:
            stiffness = replace(stiffness, unit=f"{actuator.force}/ctrl")
            return Proposal((stiffness,), ((0.6 * kp,), (1.6 * kp,)))
        scale = 0.2 * kv + 0.05 * _typical_torque(robot, actuator) / actuator.speed
        bounds = (0.0, 10 * kv + 0.5 * kp)
        damping = self.bound("kv", bounds, scale=scale, at=actuator, nominal=kv)
        return Proposal((stiffness, damping), ((0.6 * kp, kv), (1.6 * kp, kv)))

    def edit_model(
        self, model: "MjModel", place: ActuatorPlace, values: Floats
    ) -> None:
        a = place.actuator
        if len(values) == 1:  # a motor
            model.actuator_gainprm[a, 0] = values[0]
        else:
            if not is_pid(model, a):
                model.actuator_gainprm[a, 0] *= (
                    -values[0] / model.actuator_biasprm[a, 1]
                )
            model.actuator_biasprm[a, 1] = -values[0]
            model.actuator_biasprm[a, 2] = -values[1]


def _typical_torque(robot: RobotSummary, actuator: Actuator) -> float:
    """Typical torque [N m or N] of what an actuator drives."""
    if actuator.dof >= 0:
        return float(robot.joint_by_dof(actuator.dof).torque)
    return float(actuator.max_force / 3)


def name_or_id(model: "MjModel", place: ActuatorPlace) -> str | int:
    """What the text's edits call an actuator."""
    return model.actuator(place.actuator).name or place.actuator


def rename_to_general(
    model: "MjModel", place: ActuatorPlace, **attributes: str | float
) -> list[Edit]:
    """The actuator as a <general> one of the same law, with more attributes.

    Args:
        model: compiled, as its text states it.
        place: of an actuator with one control and an affine force.
        attributes: of the <general>, beside those of its law.
    """
    a = place.actuator
    law = {
        "gainprm": format_number(model.actuator_gainprm[a, :3]),
        "biasprm": format_number(model.actuator_biasprm[a, :3]),
        "biastype": "affine" if model.actuator_biastype[a] == 1 else "none",
        "gaintype": "affine" if model.actuator_gaintype[a] == 1 else "fixed",
        **{
            k: v if isinstance(v, str) else format_number(v)
            for k, v in attributes.items()
        },
    }
    (control,) = place.controls
    if model.actuator_ctrllimited[control]:  # a <general> inherits no range
        law["ctrlrange"] = format_number(model.actuator_ctrlrange[control])
    own = ("kp", "kv", "gain", "dampratio", "timeconst", "inheritrange")
    gone = dict.fromkeys(own)
    return [Rename("actuator", name_or_id(model, place), "general", {**gone, **law})]

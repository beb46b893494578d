"""What a servo does with its command: it sums its error, leads its goal, or waits."""

from dataclasses import dataclass, replace

import numpy as np

from ....recording import find_output
from ....recording.actuator_laws import (
    find_goal,
    get_servo_gains,
    has_affine_force,
    is_pid,
)
from ....recording.data import Floats
from ...data.robot_summary import Actuator, RobotSummary
from ..base import Term
from ..by_target import ActuatorEffect
from ..commands import SAME_INSTANT_STEPS, CommandGrid, change_columns
from ..declaration import (
    SELDOM,
    FindingField,
    ParameterSpec,
    Proposal,
)
from ..places import ActuatorPlace
from ..protocols import CommandFilter, JointForce, StepState

# [s] over which a servo takes the slope of its goal; chosen: a sample of commands at
# 50 Hz, which a grid of steps repeats
SLOPE_SECONDS = 0.02
NO_DYNAMICS = 0  # mjtDyn
# share of its scale below which an integral gain is no more than a torque; chosen
INTEGRAL_GAIN_RESOLUTION = 0.3
SETTLED = "settled"


class VelocityFeedforward(ActuatorEffect, CommandFilter[ActuatorPlace]):
    name = "velocity_feedforward"
    description = "The servo adds a torque in proportion to the speed of its goal."
    equation = "tau = kp (ctrl + lead d ctrl/dt - q) - kv v"
    source = "Corke 2017, Robotics, Vision and Control, section 9.1: feedforward"
    separate_by = "ramp the command: feed-forward takes the lag away"
    phrase = "{at} feeds the speed of its goal forward, {lead} of it"
    parameters = (ParameterSpec("lead", "s", nominal=0.0, nonnegative=True),)

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        """Begin with that which undoes the servo's own damping."""
        model, a = robot.model, actuator.id
        same = sum(other.dof == actuator.dof for other in robot.actuators)
        is_only = actuator.dof < 0 or same == 1
        if find_goal(model, a) < 0 or not has_affine_force(model, a) or not is_only:
            return None
        least = SAME_INSTANT_STEPS * robot.timestep
        lead = self.bound("lead", (0.0, 0.5), scale=0.01, resolution=least)
        stiffness, damping = -model.actuator_biasprm[a, 1:3]
        return Proposal((lead,), ((float(damping / stiffness) or 0.02,),))

    def transform_command(
        self, ctrl: Floats, grid: CommandGrid, place: ActuatorPlace, values: Floats
    ) -> Floats:
        return change_columns(
            ctrl, [place.goal], lambda u: u + values * _slope(u, grid.step)
        )


def _slope(u: Floats, step: float) -> Floats:
    """Slope of commands u (1 or N, G) over the last `SLOPE_SECONDS` [unit/s]."""
    steps = max(1, round(SLOPE_SECONDS / step))
    before = np.concatenate([np.repeat(u[:, :1], steps, axis=1), u], axis=1)
    slope: Floats = (u - before[:, : u.shape[1]]) / (steps * step)
    return slope


class DeadBand(ActuatorEffect, JointForce[ActuatorPlace]):
    """A dead zone of the force that a servo's error, or a motor's command, gives."""

    name = "dead_band"
    description = "What is commanded below a width does nothing, and more acts less."
    equation = "tau = p - min(max(p, -width), width), p = kp (ctrl - q), or kp ctrl"
    source = "Tao, Kokotovic 1996, Adaptive Control of Systems, dead zone"
    separate_by = "command small steps about a pose without load"
    phrase = "{at} does nothing below {width} of what it is commanded"
    parameters = (ParameterSpec("width", "N m", nominal=0.0, nonnegative=True),)
    log_odds = SELDOM
    needs = frozenset({"gainprm", "biasprm", "actuator_length"})

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        model, a = robot.model, actuator.id
        is_motor = not model.actuator_biasprm[a, :3].any()
        if not (
            (is_motor or find_goal(model, a) >= 0)
            and has_affine_force(model, a)
            and model.actuator_dyntype[a] == NO_DYNAMICS
            and model.actuator_gaintype[a] == 0
            and model.actuator_gainprm[a, 0]
        ):
            return None
        most = actuator.max_force
        width = self.bound("width", (0.0, most), scale=0.1 * most, at=actuator)
        return Proposal((width,), ((0.03 * most,), (0.15 * most,)))

    def apply_forces(
        self, state: StepState, place: ActuatorPlace, values: Floats
    ) -> None:
        assert state.gainprm is not None and state.biasprm is not None  # by `needs`
        assert state.actuator_length is not None
        a, (control,) = place.actuator, place.controls
        gain, bias = state.gainprm[:, a, 0], state.biasprm[:, a]
        length = state.actuator_length[:, place.output]
        force = gain * state.ctrl[:, control] + bias[:, 0] + bias[:, 1] * length
        width = values[:, 0] / abs(place.gear)
        state.ctrl[:, control] -= np.clip(force, -width, width) / gain


@dataclass(frozen=True, kw_only=True)
class IntegratorPlace(ActuatorPlace):
    """A servo that integrates its error.

    Attributes:
        begins: "settled" where the integral begins at what the first moments ask for;
            None: at 0.
    """

    begins: str | None = None


class IntegralAction(ActuatorEffect, JointForce[ActuatorPlace]):
    name = "integral_action"
    description = (
        "The servo sums up its error and pushes until it is gone; the sum begins at 0, "
        'or with `"begins": "settled"` at what each recording\'s first moments ask for.'
    )
    equation = "tau += ki s, where ds/dt = ctrl - q and |ki s| <= imax"
    source = "MuJoCo actuator/pid ki, imax"
    separate_by = "hold a loaded pose for ten seconds"
    phrase = "{at} sums up its error with a gain of {ki}"
    parameters = (
        ParameterSpec("ki", "N m/(rad s)", nominal=0.0, nonnegative=True),
        ParameterSpec("imax", "N m", nonnegative=True),
    )
    finding_fields = (
        FindingField(
            "begins",
            (SETTLED,),
            is_required=False,
            note=": its sum had settled before each recording began.",
        ),
    )
    place_type = IntegratorPlace

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """Two terms at each servo: its sum begun at 0, or long before the recording."""
        found = super().propose_terms(robot)
        return [*found, *map(_begin_settled, found)]

    def propose_at(self, robot: RobotSummary, actuator: Actuator) -> Proposal | None:
        # the sum of the readings is in the joint's unit, as the error without a gear
        model, a = robot.model, actuator.id
        ungeared = model.actuator_gear[find_output(model, a), 0] == 1
        has_own = is_pid(model, a) and model.actuator_gainprm[a, 0] > 0
        if not (actuator.servo and actuator.measured and ungeared) or has_own:
            return None
        (kp, _), most = get_servo_gains(model, a), actuator.max_force
        parameters = (
            self.bound("ki", (0.0, 50 * kp), scale=0.3 * kp, at=actuator),
            self.bound(
                "imax", (0.0, 10 * most), scale=0.2 * most, at=actuator, nominal=most
            ),
        )
        # the last one is often at its limit: from a limit that is never met no slope
        # of the error leads there
        shares = ((0.5, 1), (5, 0.5), (2, 0.1))
        return Proposal(parameters, tuple((i * kp, m * most) for i, m in shares))

    def apply_forces(
        self, state: StepState, place: ActuatorPlace, values: Floats
    ) -> None:
        # the sum since the episode began is that of the measured error up to the
        # segment's start, and of the simulated one from there
        error = state.ctrl[:, place.goal] - state.qpos[:, place.qpos]
        total = state.integral_errors[place.actuator]
        most = self.max_integral(values)
        state.applied_force[:, place.dof] += values[:, 0] * total
        total[:] = np.clip(total + error * state.timestep, -most, most)

    @staticmethod
    def max_integral(values: Floats) -> Floats:
        """Largest magnitudes (n) of the sum [rad s or m s], of values (n, 2)."""
        ki, most = values.T
        return np.divide(most, ki, out=np.full(len(ki), np.inf), where=ki > 0)


def _begin_settled(term: Term) -> Term:
    """The term with a sum that begins at what the servo bears; a slow one is faint."""
    ki, most = term.parameters
    parameters = replace(ki, resolution=INTEGRAL_GAIN_RESOLUTION * ki.scale), most
    (place,) = term.places
    assert isinstance(place, IntegratorPlace)  # by `place_type`
    return replace(
        term, places=(replace(place, begins=SETTLED),), parameters=parameters
    )

"""What lies between the command and the torque."""

from dataclasses import replace

import numpy as np

from ...mjcf.edit import Rename, Set, format_number
from ..data.robot_summary import RobotSummary, has_affine_force
from .base import Effect, Floats, Parameter, Term, extend_places

SLOW = 0.3  # of its scale, an integral gain that is hardly more than a torque; chosen


class ActuatorEffect(Effect):
    """What all of them share: an actuator, or all of them alike."""

    group = "actuator"
    is_shared = False  # may be one cause for all actuators, a bus or a supply

    def make_parameters(self, robot: RobotSummary, actuator) -> tuple[Parameter, ...]:
        """Its numbers at an actuator; `actuator` is a `scene.Actuator`."""
        raise NotImplementedError

    def make_initial_values(
        self, robot: RobotSummary, actuator
    ) -> tuple[tuple[float, ...], ...]:
        """Values to begin a search at."""
        raise NotImplementedError

    def applies_to(self, robot: RobotSummary, actuator) -> bool:
        """Whether it could be at this actuator."""
        return True

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """At each actuator and, where one cause can do that, at all alike."""
        found = [
            Term(
                self,
                (f"actuator:{actuator.name}",),
                (robot.actuator_place(actuator),),
                self.make_parameters(robot, actuator),
                self.make_initial_values(robot, actuator),
            )
            for actuator in robot.actuators
            if self.applies_to(robot, actuator)
        ]
        if self.is_shared and len(found) > 1:
            targets = tuple(t.targets[0] for t in found)
            places = tuple(t.places[0] for t in found)
            found.append(replace(found[0], targets=targets, places=places))
        return found


class CommandDelay(ActuatorEffect):
    """A delay beyond the one that the model states."""

    name = "command_delay"
    is_common = True
    description = "A command takes effect some time after it is given."
    equation = "u(t) = ctrl(t - delay)"
    source = "MuJoCo actuator/delay (3.5)"
    separate_by = "move the joint by hand: a late sensor shows then, a late command not"
    regime = "after_step"
    is_shared = True
    native_is_stepwise = True

    def make_parameters(self, robot, actuator):
        return (
            Parameter("delay", "s", 0.0, 0.0, 0.3, 0.01, robot.contact_timing_error),
        )

    def make_initial_values(self, robot, actuator):
        return ((0.005,), (0.02,), (0.06,))

    def transform_command(self, ctrl, step, place, values):
        return _replace_column(
            ctrl, place, _delay_column(ctrl[..., place["actuator"]], values / step)
        )

    def edit_model(self, model, place, values):
        if place.get("there"):  # out of a patched model: `command` does it
            rest = model.actuator_delay[place["actuator"]] - values[0]
            least = 1e-6 * model.opt.timestep  # a text's last digit
            model.actuator_delay[place["actuator"]] = rest if rest > least else 0.0

    def edit_text(self, model, place, values):
        delay = float(model.actuator_delay[place["actuator"]]) + values[0]
        steps = int(np.ceil(delay / model.opt.timestep)) + 1
        predicted = {
            "delay": format_number(delay),
            "nsample": str(max(steps, 2) + 1),
            "interp": "linear",
        }
        return [Set("actuator", _name_or_id(model, place), predicted)]


def _name_or_id(model, place):
    return model.actuator(place["actuator"]).name or place["actuator"]


def _replace_column(ctrl: Floats, place, column: Floats) -> Floats:
    """Commands (N, G, nu) whose one column (N, G) is another."""
    out = np.broadcast_to(ctrl, (len(column), *ctrl.shape[1:])).copy()
    out[..., place["actuator"]] = column
    return out


def _delay_column(u: Floats, steps: Floats) -> Floats:
    """Columns u (1 or N, G) later by a number of grid steps (N, 1), as means."""
    grid = np.arange(u.shape[1])
    at = grid - steps
    low = np.floor(at).astype(int)
    share = at - low
    last = u.shape[1] - 1
    rows = np.arange(len(u))[:, None]
    before, after = (u[rows, np.clip(low + i, 0, last)] for i in (0, 1))
    return (1 - share) * before + share * after


class ActuatorLag(ActuatorEffect):
    name = "actuator_lag"
    holds_previous_command = True
    description = "The actuator follows its command as a first-order filter does."
    equation = "timeconst du/dt = ctrl - u"
    source = "MuJoCo actuator/dyntype filterexact"
    separate_by = "command sines of rising frequency: a lag weakens them, a delay not"
    regime = "after_step"
    is_shared = True

    def make_parameters(self, robot, actuator):
        return (Parameter("timeconst", "s", 0.0, 0.0, 1.0, 0.02),)

    def make_initial_values(self, robot, actuator):
        return ((0.01,), (0.05,), (0.2,))

    def applies_to(self, robot, actuator):
        model, a = robot.model, actuator.id
        return model.actuator_dyntype[a] == 0 and has_affine_force(model, a)

    def transform_command(self, ctrl, step, place, values):
        u = ctrl[..., place["actuator"]]
        keep = np.exp(-step / np.maximum(values[:, 0], 1e-9))
        out = np.empty((u.shape[1], len(values)))
        now = np.broadcast_to(u[:, 0], len(values)).astype(float)
        for k, goal in enumerate(u.T.copy()):
            # the torque of a step comes from the state at its beginning
            out[k] = now
            now = goal + (now - goal) * keep
        return _replace_column(ctrl, place, _keep_if_undelayed(out.T, u, keep))

    def edit_text(self, model, place, values):
        return rename_to_general(model, place, dyntype="filterexact", dynprm=values[0])


def _keep_if_undelayed(out: Floats, u: Floats, keep: Floats) -> Floats:
    """Exactly the command where there is no lag at all."""
    return np.where(keep[:, None] == 0, u, out)


def rename_to_general(model, place, **attributes) -> list[Rename]:
    """The actuator as a <general> one of the same law, with more attributes."""
    a = place["actuator"]
    predicted = {
        "gainprm": format_number(model.actuator_gainprm[a, :3]),
        "biasprm": format_number(model.actuator_biasprm[a, :3]),
        "biastype": "affine" if model.actuator_biastype[a] == 1 else "none",
        "gaintype": "affine" if model.actuator_gaintype[a] == 1 else "fixed",
        **{
            k: v if isinstance(v, str) else format_number(v)
            for k, v in attributes.items()
        },
    }
    if model.actuator_ctrllimited[a]:
        predicted["ctrlrange"] = format_number(
            model.actuator_ctrlrange[a]
        )  # not inherited now
    own = ("kp", "kv", "gain", "dampratio", "timeconst", "inheritrange")
    gone = dict.fromkeys(own)
    return [
        Rename("actuator", _name_or_id(model, place), "general", {**gone, **predicted})
    ]


class RateLimit(ActuatorEffect):
    name = "rate_limit"
    description = "The servo moves its goal no faster than a rate."
    equation = "|du/dt| <= rate"
    source = "MuJoCo actuator/pid slewmax"
    separate_by = "step the command by several sizes"
    regime = "after_step"

    def make_parameters(self, robot, actuator):
        rate = actuator.max_rate
        unit = f"{actuator.unit}/s"
        return (Parameter("rate", unit, np.inf, 1e-2 * rate, 1e3 * rate, rate),)

    def make_initial_values(self, robot, actuator):
        return tuple((share * actuator.max_rate,) for share in (0.3, 1.0, 3.0))

    def applies_to(self, robot, actuator):
        """Of what holds a position, in whatever units that is commanded."""
        model, a = robot.model, actuator.id
        holds = has_affine_force(model, a) and model.actuator_biasprm[a, 1] < 0
        return actuator.dof >= 0 and holds and actuator.max_rate > 0

    def transform_command(self, ctrl, step, place, values):
        u = ctrl[..., place["actuator"]].T.copy()
        most = values[:, 0] * step
        least = -most
        out = np.empty((len(u), len(values)))
        now = np.broadcast_to(u[0], len(values)).astype(float)
        for k, goal in enumerate(u):
            # np.clip takes ten times as long
            now = now + np.minimum(np.maximum(goal - now, least), most)
            out[k] = now
        return _replace_column(ctrl, place, out.T)


class TorqueSaturation(ActuatorEffect):
    """A limit inside the forcerange that the model states: it lifts none."""

    name = "torque_saturation"
    description = "The actuator gives no more than so much torque."
    equation = "|tau| <= limit"
    source = "MuJoCo actuator/forcerange"
    separate_by = "command larger and larger steps"
    regime = "saturated"

    def make_parameters(self, robot, actuator):
        most = actuator.max_force
        low, high = 0.005 * most, 20 * most
        return (Parameter("limit", actuator.force, np.inf, low, high, 0.1 * most),)

    def make_initial_values(self, robot, actuator):
        return tuple(
            (s * actuator.max_force,) for s in (0.9, 0.6, 0.35, 0.2, 0.1, 0.05)
        )

    def applies_to(self, robot, actuator):
        # at a site the gear is a direction
        geared = robot.model.actuator_gear[actuator.id, 0] != 0
        return geared and has_affine_force(robot.model, actuator.id)

    def edit_model(self, model, place, values):
        a = place["actuator"]
        most = values[0] / abs(model.actuator_gear[a, 0])
        limited = model.actuator_forcelimited[a]
        nominal_terms = model.actuator_forcerange[a] if limited else (-np.inf, np.inf)
        model.actuator_forcerange[a] = np.clip(nominal_terms, -most, most)
        model.actuator_forcelimited[a] = 1


class SpeedTorqueLimit(ActuatorEffect):
    name = "speed_torque_limit"
    description = "The torque that the motor can give falls with its speed."
    equation = "tau sign(v) <= stall_torque (1 - |v| / no_load_speed)"
    source = "any motor's data sheet"
    separate_by = "command full torque from rest and watch the speed grow"
    regime = "fast"
    writes_forcerange = True

    def make_parameters(self, robot, actuator):
        most, speed = actuator.max_force, robot.joint_by_dof(actuator.dof).max_speed
        unit = f"{robot.joint_by_dof(actuator.dof).unit}/s"
        return (
            Parameter("stall_torque", actuator.force, np.inf, 0.01 * most,
                      20 * most, 0.2 * most),
            Parameter("no_load_speed", unit, np.inf, 0.2 * speed,
                      100 * speed, 0.3 * speed),
        )  # fmt: skip

    def make_initial_values(self, robot, actuator):
        most, speed = actuator.max_force, robot.joint_by_dof(actuator.dof).max_speed
        return (
            (most, 1.3 * speed), (0.6 * most, 1.3 * speed), (most, 4 * speed),
            (0.2 * most, 1.3 * speed), (0.2 * most, 4 * speed),
        )  # fmt: skip

    def applies_to(self, robot, actuator):
        return actuator.dof >= 0

    def apply_forces(self, state, place, values):
        a, gear = place["actuator"], place["gear"]
        stall, speed = values.T
        share = state.qvel[:, place["dof"]] / speed
        up = stall * np.clip(1 - share, 0, 1) / abs(gear)
        down = -stall * np.clip(1 + share, 0, 1) / abs(gear)
        low, high = (down, up) if gear > 0 else (-up, -down)
        limits = state.forcerange[:, a]
        limits[:, 0] = np.maximum(limits[:, 0], low)
        limits[:, 1] = np.minimum(limits[:, 1], high)


class ServoGain(ActuatorEffect):
    name = "servo_gain"
    restates_nominal = True
    overrides = ("kp", "kv", "gain", "gear")
    description = (
        "The servo is stiffer or softer, a motor stronger or weaker than stated."
    )
    equation = "tau = kp (ctrl - q) - kv v; of a motor, tau = kp ctrl"
    source = "MuJoCo actuator/position"
    separate_by = "load the held joint with a known weight"
    regime = "high_load"

    def make_parameters(self, robot, actuator):
        kp, kv = _servo_gains(robot.model, actuator.id)
        unit = f"{actuator.force}/{actuator.unit if actuator.servo else 'ctrl'}"
        stiffness = Parameter("kp", unit, kp, 0.05 * kp, 20 * kp, 0.2 * kp)
        if not actuator.servo:
            return (stiffness,)
        joint = robot.joint_by_dof(actuator.dof)
        high = 10 * kv + 0.5 * kp
        scale = 0.2 * kv + 0.05 * joint.torque / joint.speed
        return (
            stiffness,
            Parameter(
                "kv", f"{actuator.force} s/{actuator.unit}", kv, 0.0, high, scale
            ),
        )

    def make_initial_values(self, robot, actuator):
        kp, *kv = (p.nominal for p in self.make_parameters(robot, actuator))
        return ((0.6 * kp, *kv), (1.6 * kp, *kv))

    def applies_to(self, robot, actuator):
        model, a = robot.model, actuator.id
        law = model.actuator_gaintype[a], model.actuator_biastype[a]
        return actuator.servo or (max(law) == 0 and model.actuator_gainprm[a, 0] > 0)

    def rate_rarity(self, term, values):
        """A motor is weak more seldom than what it moves is heavy."""
        return self.rarity if len(term.parameters) > 1 else 2

    def edit_model(self, model, place, values):
        a = place["actuator"]
        model.actuator_gainprm[a, 0] = values[0]
        if len(values) > 1:  # not of a motor
            model.actuator_biasprm[a, 1] = -values[0]
            model.actuator_biasprm[a, 2] = -values[1]


def _servo_gains(model, actuator: int) -> tuple[float, float]:
    kp = float(model.actuator_gainprm[actuator, 0])
    return kp, -float(model.actuator_biasprm[actuator, 2])


class IntegralAction(ActuatorEffect):
    name = "integral_action"
    restates_nominal = True
    description = (
        "The servo sums up its error and pushes until it is gone; the sum begins at 0, "
        'or with `"begins": "settled"` at what each recording\'s first moments ask for.'
    )
    equation = "tau += ki s, where ds/dt = ctrl - q and |ki s| <= imax"
    source = "MuJoCo actuator/pid ki, imax"
    separate_by = "hold a loaded pose for ten seconds"
    regime = "high_load"

    def propose_terms(self, robot):
        """At each servo; its sum begun at 0, or long before the recording."""
        own = super().propose_terms(robot)
        return [*own, *map(_begin_settled, own)]

    def make_parameters(self, robot, actuator):
        kp, _ = _servo_gains(robot.model, actuator.id)
        most = actuator.max_force
        return (
            Parameter("ki", f"{actuator.force}/({actuator.unit} s)", 0.0, 0.0, 50 * kp,
                      0.3 * kp),
            Parameter("imax", actuator.force, most, 0.0, 10 * most, 0.2 * most),
        )  # fmt: skip

    def make_initial_values(self, robot, actuator):
        kp, _ = _servo_gains(robot.model, actuator.id)
        most = actuator.max_force
        # one that is often full: from a limit that is never met no slope leads there
        return ((0.5 * kp, most), (5 * kp, 0.5 * most), (2 * kp, 0.1 * most))

    def applies_to(self, robot, actuator):
        # the sum of what was read is in the joint's unit, as the error without a gear
        ungeared = robot.model.actuator_gear[actuator.id, 0] == 1
        return actuator.servo and actuator.measured and ungeared

    def apply_forces(self, state, place, values):
        # the sum since the episode began is that of the measured error up to the
        # window's start, and of the simulated one from there
        error = state.ctrl[:, place["actuator"]] - state.qpos[:, place["qpos"]]
        total, most = (
            state.integral_errors[place["actuator"]],
            self.max_integral(values),
        )
        state.applied_force[:, place["dof"]] += values[:, 0] * total
        total[:] = np.clip(total + error * state.timestep, -most, most)

    @staticmethod
    def max_integral(values: Floats) -> Floats:
        """(n) sums [rad s] beyond which none goes, of values (n, 2)."""
        ki, most = values.T
        return np.divide(most, ki, out=np.full(len(ki), np.inf), where=ki > 0)


def _begin_settled(term: Term) -> Term:
    """The same, its sum begun with what it bears; a slow one is a mere torque."""
    ki, most = term.parameters
    own = replace(ki, resolution=SLOW * ki.scale), most
    note = {"begins": "settled"}
    return replace(extend_places(term, **note), parameters=own, finding_fields=note)

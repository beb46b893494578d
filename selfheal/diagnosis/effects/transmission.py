"""What lies between motor and link."""

import numpy as np

from .base import Effect, Parameter, Term, extend_places
from .friction import JointEffect, torque_scale
from .second_joint import SecondJointEffect

FREE = 1e6  # [rad or m] where a joint without a stop has it; chosen: none gets there
# periods a turn of magnets or teeth, or in a slide's range; chosen: fewer are those
# of gravity, or of a spring
FEWEST, ALONG = 4.0, 1.5
SHUT = 1e-7  # least half of a gap [rad or m]; chosen: MuJoCo asks for a range
REFERS = 0.3  # of a joint's range, what a spring's reference is known to; chosen
STIFF = 5.0  # times the spring that shows, where another search begins; chosen


class TransmissionEffect(JointEffect):
    """As friction, at every hinge and slide, but of the transmission."""

    group = "transmission"


class Armature(TransmissionEffect):
    name = "armature"
    is_common = True
    overrides = ("armature",)
    description = "Inertia of the rotor, seen through the gear."
    equation = "tau = -armature a"
    source = "MuJoCo joint/armature"
    separate_by = "repeat the motion with another payload"
    regime = "fast"

    def make_parameters(self, robot, joint):
        unit = "kg m^2" if joint.unit == "rad" else "kg"
        now = float(robot.model.dof_armature[joint.dof])
        high = now * 10 + 20 * joint.inertia
        return (Parameter("armature", unit, now, 0.0, high, 0.3 * joint.inertia),)

    def make_initial_values(self, robot, joint):
        (p,) = self.make_parameters(robot, joint)
        return (
            (p.nominal + 0.3 * p.scale,),
            (p.nominal + 2 * p.scale,),
            (p.nominal / 2,),
        )

    def edit_model(self, model, place, values):
        model.dof_armature[place["dof"]] = values[0]


class JointSpring(TransmissionEffect):
    """Stiffness and springref in the place of those that the model states."""

    name = "joint_spring"
    overrides = ("stiffness",)
    description = "A spring across the joint, a cable or a hose perhaps."
    equation = "tau = -stiffness (q - springref)"
    source = "MuJoCo joint/stiffness, springref"
    separate_by = "measure the torque at rest, or re-zero the encoder"

    def make_parameters(self, robot, joint):
        unit = f"{joint.force}/{joint.unit}"
        scale = 0.2 * joint.torque / joint.range
        high = 10 * torque_scale(robot, joint) / joint.range
        reach = 5 * joint.range + 1
        now = float(robot.model.jnt_stiffness[joint.id])
        ref = float(robot.model.qpos_spring[joint.qpos])
        return (
            Parameter("stiffness", unit, now, 0.0, high + 10 * now, scale),
            Parameter(
                "springref", joint.unit, ref, min(ref, joint.range_center) - reach,
                max(ref, joint.range_center) + reach, REFERS * joint.range,
            ),
        )  # fmt: skip

    def make_initial_values(self, robot, joint):
        stiffness, ref = self.make_parameters(robot, joint)
        k = stiffness.nominal + stiffness.scale
        ends = (joint.range_center + joint.range, joint.range_center - joint.range)
        # a spring too stiff becomes softer in a few steps; one too soft puts its
        # reference so far off that it takes many to become stiffer
        stiff = stiffness.nominal + STIFF * stiffness.scale
        soft = tuple((k, q) for q in (ref.nominal, *ends))
        return (*soft, (stiff, ref.nominal), (stiff, joint.range_center))

    def rate_rarity(self, term, values):
        """A reference far from where the joint was stands for a constant torque."""
        ref = term.parameters[1]
        off = abs(values[1] - (ref.low + ref.high) / 2)
        return int(off > ref.scale / REFERS)

    def edit_model(self, model, place, values):
        model.jnt_stiffness[place["joint"]] = values[0]
        model.qpos_spring[model.jnt_qposadr[place["joint"]]] = values[1]


class HardStop(TransmissionEffect):
    """A stop inside the range that the model states: it takes none away."""

    name = "hard_stop"
    description = "A stop, or an obstacle, that the joint cannot pass."
    equation = "q <= range (or >=), as soft as timeconst says"
    source = "MuJoCo joint/range, joint/solreflimit"
    separate_by = "move slowly towards the angle from the free side"
    regime = "near_limit"

    def propose_terms(self, robot):
        return [
            self._make_term(robot, joint, side)
            for joint in robot.joints
            for side in (-1, 1)
        ]

    def edit_model(self, model, place, values):
        joint, (stop, *soft) = place["joint"], values
        inside = _limit_range(model, place, stop)
        if not model.jnt_limited[joint] or inside != tuple(model.jnt_range[joint]):
            model.jnt_solref[joint, : len(soft)] = soft
        model.jnt_range[joint], model.jnt_limited[joint] = inside, 1

    def _make_term(self, robot, joint, side: int) -> Term:
        end = (
            joint.range_center + side * joint.range / 2
        )  # where the robot was seen to go
        reach = 0.5 * joint.range
        stop = Parameter(
            "range", joint.unit, side * np.inf, end - reach, end + reach,
            0.1 * joint.range,
        )  # fmt: skip
        starts = end - side * 0.02 * joint.range, end - side * 0.1 * joint.range
        place = {"joint": joint.id, "side": side, "dof": joint.dof}
        soft = self._make_softness(robot, joint)
        return Term(
            self, (f"joint:{joint.name}",), (place,), (stop, *soft),
            tuple((start, *(p.nominal for p in soft)) for start in starts),
            {"side": side},
        )  # fmt: skip

    def _make_softness(self, robot, joint) -> tuple[Parameter, ...]:
        """How soon it stops, where solref says such a time and poses are not all."""
        time, hard = robot.model.jnt_solref[joint.id, 0], 2 * robot.timestep
        if time < hard or robot.has_only_poses:
            return ()
        return (Parameter("timeconst", "s", float(time), hard, 0.2, 0.2 * time),)


def _limit_range(model, place, value) -> tuple[float, float]:
    joint = place["joint"]
    low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-FREE, FREE)
    if place["side"] < 0:
        return max(low, value), high
    return low, min(high, value)


class Cogging(TransmissionEffect):
    name = "cogging"
    rarity = 1
    description = "A torque that repeats with the angle, of magnets or a gear's teeth."
    equation = "tau = amplitude sin(poles q + phase)"
    source = "MuJoCo actuator/dcmotor, cogging (3.7)"
    separate_by = "turn the joint slowly through its whole range"
    regime = "slow"
    is_periodic = True

    def make_parameters(self, robot, joint):
        scale, high = 0.1 * joint.torque, 3 * torque_scale(robot, joint)
        least, apart = self._count_bounds(joint)
        return (
            Parameter("amplitude", joint.force, 0.0, 0.0, high, scale),
            Parameter("poles", "1", 2.5 * least, least, 50 * least, 0.5 * apart),
            Parameter("phase", "rad", 0.0, -10.0, 10.0, 0.5),
        )

    def make_initial_values(self, robot, joint):
        a = 0.01 * joint.torque  # small, so that the answer is linear
        least, apart = self._count_bounds(joint)
        apart = max(1.0, apart) if joint.unit == "rad" else apart
        few, many = 5 * least, 12.5 * least
        counts = np.append(
            np.arange(least, few, apart), np.arange(few, many, 2 * apart)
        )
        return tuple((a, n, p) for n in counts.tolist() for p in (0.0, np.pi / 2))

    @staticmethod
    def _count_bounds(joint) -> tuple[float, float]:
        """The fewest poles, and how far others lie apart.

        So near each other that two waves part by two radians within the joint's range.
        """
        apart = 2.0 / max(joint.range, 0.05)
        return (FEWEST if joint.unit == "rad" else ALONG * np.pi * apart), apart

    def apply_forces(self, state, place, values):
        amplitude, poles, phase = values.T
        angle = state.qpos[:, place["qpos"]]
        state.applied_force[:, place["dof"]] += amplitude * np.sin(
            poles * angle + phase
        )

    def propose_terms(self, robot):
        address = {j.id: j.qpos for j in robot.joints}
        return [
            extend_places(t, qpos=address[t.places[0]["joint"]])
            for t in super().propose_terms(robot)
        ]


class JointCoupling(Effect):
    name = "joint_coupling"
    rarity = 1
    group = "transmission"
    description = "A spring between two joints, a cable that runs over both perhaps."
    equation = "tau = -stiffness (q - ratio q_other), and ratio times its opposite"
    source = "MuJoCo tendon/fixed, stiffness"
    separate_by = "hold one joint and move the other"

    def propose_terms(self, robot):
        return [
            self._make_term(robot, a, b)
            for a in robot.joints
            for b in robot.joints
            if a.id < b.id
        ]

    def _make_term(self, robot, a, b) -> Term:
        # what both bear: the weaker joint's, or a start is far from all that could be
        scale = 0.2 * min(torque_scale(robot, j) / j.range for j in (a, b))
        high = 10 * torque_scale(robot, a) / a.range
        unit = f"{a.force}/{a.unit}"
        parameters = (
            Parameter("stiffness", unit, 0.0, 0.0, high, scale),
            Parameter("ratio", "1", 1.0, -5.0, 5.0, 0.3),
        )
        place = {"joint": a.id, "dof": a.dof, "qpos": a.qpos}
        place |= {"other_dof": b.dof, "other_qpos": b.qpos}
        sizes = (min(k * scale, high) for k in (0.2, 2.0, 15.0))
        starts = tuple((size, ratio) for size in sizes for ratio in (1.0, -1.0))
        return Term(
            self, (f"joint:{a.name}",), (place,), parameters, starts,
            {"other": f"joint:{b.name}"},
        )  # fmt: skip

    def apply_forces(self, state, place, values):
        stiffness, ratio = values.T
        q = state.qpos[:, place["qpos"]]
        pull = stiffness * (q - ratio * state.qpos[:, place["other_qpos"]])
        state.applied_force[:, place["dof"]] -= pull
        state.applied_force[:, place["other_dof"]] += ratio * pull


class Backlash(SecondJointEffect):
    name = "backlash"
    description = (
        "Play in the gear: after a reversal the link waits until the gap is crossed."
    )
    equation = "|q_link - q_motor| <= gap / 2"
    source = "MuJoCo manual, Modeling: Backlash, as two hinges"
    separate_by = "rock the joint slowly about a pose without load"
    regime = "reversal"
    suffix = "_play"
    min_inertia_share = 0.003  # of 0.001 to 0.01 what shows least where the gap is shut

    def make_parameters(self, robot, joint):
        scale = 0.03 * joint.range
        return (Parameter("gap", joint.unit, 0.0, 0.0, joint.range, scale),)

    def make_initial_values(self, robot, joint):
        # one twice as wide as the robot's explains nothing, as does none
        return tuple((share * joint.range,) for share in (0.003, 0.008, 0.02, 0.05))

    def joint_attributes(self, model, values):
        half = max(float(values[0]) / 2, SHUT)
        # the shortest that MuJoCo computes; of 0.7 to 2 what shows least where shut
        hard = 2 * model.opt.timestep, 0.7
        soft = 0.9, 0.95, 0.001, 0.5, 2.0  # MuJoCo's default
        return {"range": (-half, half), "solreflimit": hard, "solimplimit": soft}

    def compute_deflection(self, values, load):
        return float(np.sign(load) * values[0] / 2)


class Compliance(SecondJointEffect):
    name = "compliance"
    description = "A drive that bends: the link lags behind the motor by its load."
    equation = "tau = stiffness (q_motor - q_link) + damping (v_motor - v_link)"
    source = "Spong 1987, elastic joints"
    separate_by = "load the held joint with two known weights"
    regime = "high_load"
    suffix = "_flex"

    def make_parameters(self, robot, joint):
        most = self._max_stiffness(robot, joint)
        damped = most * robot.timestep  # stops all that the joint does in one step
        k = min(joint.torque / (0.03 * joint.range), most / 5)
        d = min(0.3 * np.sqrt(k * joint.inertia), damped / 5)
        unit = f"{joint.force}/{joint.unit}"
        return (
            Parameter("stiffness", unit, np.inf, 0.02 * k, most, k),
            Parameter("damping", f"{joint.force} s/{joint.unit}", d, 0.0, damped, d),
        )

    def _max_stiffness(self, robot, joint) -> float:
        """Stiffness [N m/rad or N/m] at which the joint swings once in six steps.

        MuJoCo takes a spring's torque as constant over a step: at three it diverges.
        """
        place = {"joint": joint.id, "dof": joint.dof, "inertia": joint.inertia}
        motor = self.motor_inertia(robot.model, place)
        link = joint.inertia - float(robot.model.dof_armature[joint.dof])
        link = max(link, self.min_inertia_share * joint.inertia)
        return motor * link / (motor + link) / robot.timestep**2

    def make_initial_values(self, robot, joint):
        k, d = (p.scale for p in self.make_parameters(robot, joint))
        return ((k, d), (0.3 * k, d), (5 * k, d))

    def joint_attributes(self, model, values):
        k, d = map(float, values)
        return {"stiffness": (k, 0.0, 0.0), "damping": (d, 0.0, 0.0)}

    def compute_deflection(self, values, load):
        return float(load / values[0])

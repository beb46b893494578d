"""Physics of the transmission between motor and link: inertia, springs, stops, play."""

import numpy as np

from .base import Term
from .by_target import JointEffect
from .declaration import FindingField, ParameterSpec
from .friction import torque_scale
from .places import Place, add_keys, locate_target
from .second_joint import SecondJointEffect

# fewest periods a turn of magnets or teeth, or in a slide's range; chosen: fewer are
# those of gravity, or of a spring
MIN_POLES, MIN_PERIODS_OF_SLIDE = 4.0, 1.5
MIN_HALF_GAP = 1e-7  # least half of a gap [rad or m]; chosen: MuJoCo asks for a range
# share of a joint's range to which a spring's reference is known; chosen
SPRINGREF_RESOLUTION = 0.3
STIFFER_START = 5.0  # times the stiffness that shows, another start; chosen
MAX_JOINTS_APART = 3  # along a chain, of those that a cable runs over; chosen


class TransmissionEffect(JointEffect):
    """An effect at each hinge and slide, of its transmission."""

    group = "transmission"


class Armature(TransmissionEffect):
    name = "armature"
    description = "Inertia of the rotor, seen through the gear."
    equation = "tau = -armature a"
    source = "MuJoCo joint/armature"
    separate_by = "repeat the motion with another payload"
    phrase = "{at} has a rotor inertia of {armature}, {other}"
    parameters = (
        ParameterSpec("armature", "kg m^2", nonnegative=True, is_in_model=True),
    )
    is_common = True
    overrides = ("armature",)

    def make_parameters(self, robot, joint):
        now = float(robot.model.dof_armature[joint.dof])
        # behind a gear of 200 a rotor weighs hundreds of times as much as a light link;
        # a wrist may have the drive of a shoulder
        alike = [j.inertia for j in robot.joints if j.unit == joint.unit]
        high, scale = now * 10 + 300 * max(alike), 0.3 * joint.inertia
        return (
            self.make_parameter(
                "armature", joint, nominal=now, low=0.0, high=high, scale=scale
            ),
        )

    def make_initial_values(self, robot, joint):
        (p,) = self.make_parameters(robot, joint)
        return (
            (p.nominal + 0.3 * p.scale,),
            (p.nominal + 2 * p.scale,),
            (p.nominal + 100 * p.scale,),
            (p.nominal / 2,),
        )

    def edit_model(self, model, place, values):
        model.dof_armature[place["dof"]] = values[0]


class JointSpring(TransmissionEffect):
    """A spring whose stiffness and springref take the place of the model's."""

    name = "joint_spring"
    description = "A spring across the joint, a cable or a hose perhaps."
    equation = "tau = -stiffness (q - springref)"
    source = "MuJoCo joint/stiffness, springref"
    separate_by = "measure the torque at rest, or re-zero the encoder"
    phrase = "{at} has a spring of {stiffness} {lacks}"
    parameters = (
        ParameterSpec("stiffness", "N m/rad", nonnegative=True, is_in_model=True),
        ParameterSpec("springref", "rad"),
    )
    overrides = ("stiffness",)

    def make_parameters(self, robot, joint):
        scale = 0.2 * joint.torque / joint.range
        high = 10 * torque_scale(robot, joint) / joint.range
        reach = 5 * joint.range + 1
        now = float(robot.model.jnt_stiffness[joint.id])
        ref = float(robot.model.qpos_spring[joint.qpos])
        first = min(ref, joint.range_center) - reach
        last = max(ref, joint.range_center) + reach
        most, known = high + 10 * now, SPRINGREF_RESOLUTION * joint.range
        make = self.make_parameter
        return (
            make("stiffness", joint, nominal=now, low=0.0, high=most, scale=scale),
            make("springref", joint, nominal=ref, low=first, high=last, scale=known),
        )

    def make_initial_values(self, robot, joint):
        stiffness, ref = self.make_parameters(robot, joint)
        k = stiffness.nominal + stiffness.scale
        ends = (joint.range_center + joint.range, joint.range_center - joint.range)
        # a spring too stiff becomes softer in a few steps; one too soft puts its
        # reference so far off that it takes many to become stiffer
        stiff = stiffness.nominal + STIFFER_START * stiffness.scale
        soft = tuple((k, q) for q in (ref.nominal, *ends))
        return (*soft, (stiff, ref.nominal), (stiff, joint.range_center))

    def edit_model(self, model, place, values):
        model.jnt_stiffness[place["joint"]] = values[0]
        model.qpos_spring[model.jnt_qposadr[place["joint"]]] = values[1]


class Cogging(TransmissionEffect):
    name = "cogging"
    description = "A torque that repeats with the angle, of magnets or a gear's teeth."
    equation = "tau = amplitude sin(poles q + phase)"
    source = "MuJoCo actuator/dcmotor, cogging (3.7)"
    separate_by = "turn the joint slowly through its whole range"
    phrase = "{at} has a torque of {amplitude} {lacks}, rippling with its angle"
    parameters = (
        ParameterSpec("amplitude", "N m", nominal=0.0, nonnegative=True),
        ParameterSpec("poles", "1", nonnegative=True),
        ParameterSpec("phase", "rad", nominal=0.0),
    )
    rarity = 1
    is_periodic = True

    def make_parameters(self, robot, joint):
        scale, high = 0.1 * joint.torque, 3 * torque_scale(robot, joint)
        least, apart = self._count_bounds(joint)
        few, many, step = 2.5 * least, 50 * least, 0.5 * apart
        make = self.make_parameter
        return (
            make("amplitude", joint, low=0.0, high=high, scale=scale),
            make("poles", nominal=few, low=least, high=many, scale=step),
            # an angle of the wave, also at a slide
            make("phase", low=-10.0, high=10.0, scale=0.5),
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
        """The fewest poles, and the step to the next count that is tried.

        Two waves of neighboring counts part by two radians within the joint's range.
        """
        apart = 2.0 / max(joint.range, 0.05)
        least = MIN_PERIODS_OF_SLIDE * np.pi * apart
        return MIN_POLES if joint.unit == "rad" else least, apart

    def apply_forces(self, state, place, values):
        amplitude, poles, phase = values.T
        angle = state.qpos[:, place["qpos"]]
        state.applied_force[:, place["dof"]] += amplitude * np.sin(
            poles * angle + phase
        )


class JointCoupling(TransmissionEffect):
    name = "joint_coupling"
    description = "A spring between two joints, a cable that runs over both perhaps."
    equation = "tau = -stiffness (q - ratio q_other), and ratio times its opposite"
    source = "MuJoCo tendon/fixed, stiffness"
    separate_by = "hold one joint and move the other"
    phrase = "{at} is coupled to another joint by {stiffness} {lacks}"
    parameters = (
        ParameterSpec("stiffness", "N m/rad", nominal=0.0, nonnegative=True),
        ParameterSpec("ratio", "1", nominal=1.0),
    )
    finding_fields = (FindingField("other", target_kind="joint"),)
    rarity = 1

    def propose_terms(self, robot):
        """One term for each pair that a cable may run over, at the first of them."""
        return [
            self._make_term(robot, a, b)
            for a in robot.joints
            for b in robot.joints
            if a.id < b.id and _are_near(robot.model.dof_parentid, a.dof, b.dof)
        ]

    def _make_term(self, robot, a, b) -> Term:
        """The term of a spring between two joints.

        Args:
            robot: with the joints.
            a: the joint that the term is at.
            b: the other joint.
        """
        # what both bear: the weaker joint's, or a start is far from all that could be
        scale = 0.2 * min(torque_scale(robot, j) / j.range for j in (a, b))
        high = 10 * torque_scale(robot, a) / a.range
        parameters = (
            self.make_parameter("stiffness", a, low=0.0, high=high, scale=scale),
            self.make_parameter("ratio", low=-5.0, high=5.0, scale=0.3),
        )
        place = _couple(self.make_place(robot, a), self.make_place(robot, b))
        sizes = (min(k * scale, high) for k in (0.2, 2.0, 15.0))
        starts = tuple((size, ratio) for size in sizes for ratio in (1.0, -1.0))
        return Term(
            self, (f"joint:{a.name}",), (place,), parameters, starts,
            {"other": f"joint:{b.name}"},
        )  # fmt: skip

    def find_place(self, model, finding):
        other = locate_target(model, finding["other"])
        return _couple(locate_target(model, finding["target"]), other)

    def apply_forces(self, state, place, values):
        stiffness, ratio = values.T
        q = state.qpos[:, place["qpos"]]
        pull = stiffness * (q - ratio * state.qpos[:, place["other_qpos"]])
        state.applied_force[:, place["dof"]] -= pull
        state.applied_force[:, place["other_dof"]] += ratio * pull


def _are_near(parents: np.ndarray, dof: int, later: int) -> bool:
    """Whether joints are few apart along a chain, or are side by side.

    Args:
        parents: (nv) `dof_parentid` of the model.
        dof: of a joint.
        later: degree of freedom of another joint, with a larger number.
    """
    if parents[dof] == parents[later]:
        return True
    for _ in range(MAX_JOINTS_APART):
        later = parents[later]
        if later <= dof:
            break
    return later == dof


def _couple(place: Place, other: Place) -> Place:
    """The place of a joint that is coupled to another one."""
    return add_keys(place, other_dof=other["dof"], other_qpos=other["qpos"])


class Backlash(SecondJointEffect):
    name = "backlash"
    description = (
        "Play in the gear: after a reversal the link waits until the gap is crossed."
    )
    equation = "|q_link - q_motor| <= gap / 2"
    source = "MuJoCo manual, Modeling: Backlash, as two hinges"
    separate_by = "rock the joint slowly about a pose without load"
    phrase = "{at} has play of {gap} {lacks}"
    parameters = (ParameterSpec("gap", "rad", nominal=0.0, nonnegative=True),)
    suffix = "_play"
    # compared between 0.001 and 0.01: changes least where the gap is shut
    min_inertia_share = 0.003

    def make_parameters(self, robot, joint):
        scale = 0.03 * joint.range
        return (
            self.make_parameter("gap", joint, low=0.0, high=joint.range, scale=scale),
        )

    def make_initial_values(self, robot, joint):
        # a gap twice as wide as the true one explains as little as none
        return tuple((share * joint.range,) for share in (0.003, 0.008, 0.02, 0.05))

    def joint_attributes(self, model, values):
        half = max(float(values[0]) / 2, MIN_HALF_GAP)
        # the shortest time constant that MuJoCo computes; the damping ratio was
        # compared between 0.7 and 2: this one changes least where the gap is shut
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
    phrase = "{at} gives way, with a stiffness of {stiffness} {lacks}"
    parameters = (
        ParameterSpec("stiffness", "N m/rad", nominal=np.inf, nonnegative=True),
        ParameterSpec("damping", "N m s/rad", nonnegative=True),
    )
    suffix = "_flex"

    def make_parameters(self, robot, joint):
        most = self._max_stiffness(robot, joint)
        damped = most * robot.timestep  # stops all that the joint does in one step
        k = min(joint.torque / (0.03 * joint.range), most / 5)
        d = min(0.3 * np.sqrt(k * joint.inertia), damped / 5)
        make = self.make_parameter
        return (
            make("stiffness", joint, low=0.02 * k, high=most, scale=k),
            make("damping", joint, nominal=d, low=0.0, high=damped, scale=d),
        )

    def _max_stiffness(self, robot, joint) -> float:
        """Stiffness [N m/rad or N/m] at which the joint swings once in six steps.

        MuJoCo takes a spring's torque as constant over a step: at three it diverges.
        """
        motor = self.motor_inertia(robot.model, self.make_place(robot, joint))
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

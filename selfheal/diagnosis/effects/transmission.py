"""What lies between motor and link."""

import numpy as np

from ..terms import Effect, Parameter, Term, saying
from .friction import Friction, strength
from .second_joint import Extra

FREE = 1e6  # [rad or m] where a joint without a stop has it; chosen: none gets there
# periods a turn of magnets or teeth, or in a slide's range; chosen: fewer are those
# of gravity, or of a spring
FEWEST, ALONG = 4.0, 1.5
SHUT = 1e-7  # least half of a gap [rad or m]; chosen: MuJoCo asks for a range
REFERS = 0.3  # of a joint's range, what a spring's reference is known to; chosen
STIFF = 5.0  # times the spring that shows, where another search begins; chosen


class AtJoint(Friction):
    """As friction, at every hinge and slide, but of the transmission."""

    group = "transmission"


class Armature(AtJoint):
    name = "armature"
    common = True
    instead = ("armature",)
    says = "Inertia of the rotor, seen through the gear."
    equation = "tau = -armature a"
    source = "MuJoCo joint/armature"
    separate_by = "repeat the motion with another payload"
    regime = "fast"

    def parameters(self, scene, joint):
        unit = "kg m^2" if joint.unit == "rad" else "kg"
        now = float(scene.model.dof_armature[joint.dof])
        high = now * 10 + 20 * joint.inertia
        return (Parameter("armature", unit, now, 0.0, high, 0.3 * joint.inertia),)

    def starts(self, scene, joint):
        (p,) = self.parameters(scene, joint)
        return ((p.absent + 0.3 * p.scale,), (p.absent + 2 * p.scale,), (p.absent / 2,))

    def edit(self, model, place, values):
        model.dof_armature[place["dof"]] = values[0]


class JointSpring(AtJoint):
    """Stiffness and springref in the place of those that the model states."""

    name = "joint_spring"
    instead = ("stiffness",)
    says = "A spring across the joint, a cable or a hose perhaps."
    equation = "tau = -stiffness (q - springref)"
    source = "MuJoCo joint/stiffness, springref"
    separate_by = "measure the torque at rest, or re-zero the encoder"

    def parameters(self, scene, joint):
        unit = f"{joint.force}/{joint.unit}"
        scale = 0.2 * joint.torque / joint.range
        high = 10 * strength(scene, joint) / joint.range
        reach = 5 * joint.range + 1
        now = float(scene.model.jnt_stiffness[joint.id])
        ref = float(scene.model.qpos_spring[joint.qpos])
        return (
            Parameter("stiffness", unit, now, 0.0, high + 10 * now, scale),
            Parameter(
                "springref", joint.unit, ref, min(ref, joint.middle) - reach,
                max(ref, joint.middle) + reach, REFERS * joint.range,
            ),
        )  # fmt: skip

    def starts(self, scene, joint):
        stiffness, ref = self.parameters(scene, joint)
        k = stiffness.absent + stiffness.scale
        ends = (joint.middle + joint.range, joint.middle - joint.range)
        # a spring too stiff becomes softer in a few steps; one too soft puts its
        # reference so far off that it takes many to become stiffer
        stiff = stiffness.absent + STIFF * stiffness.scale
        soft = tuple((k, q) for q in (ref.absent, *ends))
        return (*soft, (stiff, ref.absent), (stiff, joint.middle))

    def oddity(self, term, values):
        """A reference far from where the joint was stands for a constant torque."""
        ref = term.parameters[1]
        off = abs(values[1] - (ref.low + ref.high) / 2)
        return int(off > ref.scale / REFERS)

    def edit(self, model, place, values):
        model.jnt_stiffness[place["joint"]] = values[0]
        model.qpos_spring[model.jnt_qposadr[place["joint"]]] = values[1]


class HardStop(AtJoint):
    """A stop inside the range that the model states: it takes none away."""

    name = "hard_stop"
    says = "A stop, or an obstacle, that the joint cannot pass."
    equation = "q <= range (or >=), as soft as timeconst says"
    source = "MuJoCo joint/range, joint/solreflimit"
    separate_by = "move slowly towards the angle from the free side"
    regime = "near_limit"

    def terms(self, scene):
        return [
            self._one_sided(scene, joint, side)
            for joint in scene.joints
            for side in (-1, 1)
        ]

    def edit(self, model, place, values):
        joint, (stop, *soft) = place["joint"], values
        inside = _range(model, place, stop)
        if not model.jnt_limited[joint] or inside != tuple(model.jnt_range[joint]):
            model.jnt_solref[joint, : len(soft)] = soft
        model.jnt_range[joint], model.jnt_limited[joint] = inside, 1

    def _one_sided(self, scene, joint, side: int) -> Term:
        end = joint.middle + side * joint.range / 2  # where the robot was seen to go
        reach = 0.5 * joint.range
        stop = Parameter(
            "range", joint.unit, side * np.inf, end - reach, end + reach,
            0.1 * joint.range,
        )  # fmt: skip
        starts = end - side * 0.02 * joint.range, end - side * 0.1 * joint.range
        place = {"joint": joint.id, "side": side, "dof": joint.dof}
        soft = self._softness(scene, joint)
        return Term(
            self, (f"joint:{joint.name}",), (place,), (stop, *soft),
            tuple((start, *(p.absent for p in soft)) for start in starts),
            {"side": side},
        )  # fmt: skip

    def _softness(self, scene, joint) -> tuple[Parameter, ...]:
        """How soon it stops, where solref says such a time and poses are not all."""
        time, hard = scene.model.jnt_solref[joint.id, 0], 2 * scene.step
        if time < hard or scene.is_posed:
            return ()
        return (Parameter("timeconst", "s", float(time), hard, 0.2, 0.2 * time),)


def _range(model, place, value) -> tuple[float, float]:
    joint = place["joint"]
    low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-FREE, FREE)
    if place["side"] < 0:
        return max(low, value), high
    return low, min(high, value)


class Cogging(AtJoint):
    name = "cogging"
    rare = 1
    says = "A torque that repeats with the angle, of magnets or a gear's teeth."
    equation = "tau = amplitude sin(poles q + phase)"
    source = "MuJoCo actuator/dcmotor, cogging (3.7)"
    separate_by = "turn the joint slowly through its whole range"
    regime = "slow"
    waves = True

    def parameters(self, scene, joint):
        scale, high = 0.1 * joint.torque, 3 * strength(scene, joint)
        least, apart = self._counts(joint)
        return (
            Parameter("amplitude", joint.force, 0.0, 0.0, high, scale),
            Parameter("poles", "1", 2.5 * least, least, 50 * least, 0.5 * apart),
            Parameter("phase", "rad", 0.0, -10.0, 10.0, 0.5),
        )

    def starts(self, scene, joint):
        a = 0.01 * joint.torque  # small, so that the answer is linear
        least, apart = self._counts(joint)
        apart = max(1.0, apart) if joint.unit == "rad" else apart
        few, many = 5 * least, 12.5 * least
        counts = np.append(
            np.arange(least, few, apart), np.arange(few, many, 2 * apart)
        )
        return tuple((a, n, p) for n in counts.tolist() for p in (0.0, np.pi / 2))

    @staticmethod
    def _counts(joint) -> tuple[float, float]:
        """The fewest poles, and how far others lie apart.

        So near each other that two waves part by two radians within the joint's range.
        """
        apart = 2.0 / max(joint.range, 0.05)
        return (FEWEST if joint.unit == "rad" else ALONG * np.pi * apart), apart

    def act(self, moment, place, values):
        amplitude, poles, phase = values.T
        angle = moment.qpos[:, place["qpos"]]
        moment.applied[:, place["dof"]] += amplitude * np.sin(poles * angle + phase)

    def terms(self, scene):
        address = {j.id: j.qpos for j in scene.joints}
        return [
            saying(t, qpos=address[t.places[0]["joint"]]) for t in super().terms(scene)
        ]


class JointCoupling(Effect):
    name = "joint_coupling"
    rare = 1
    group = "transmission"
    says = "A spring between two joints, a cable that runs over both perhaps."
    equation = "tau = -stiffness (q - ratio q_other), and ratio times its opposite"
    source = "MuJoCo tendon/fixed, stiffness"
    separate_by = "hold one joint and move the other"

    def terms(self, scene):
        return [
            self._between(scene, a, b)
            for a in scene.joints
            for b in scene.joints
            if a.id < b.id
        ]

    def _between(self, scene, a, b) -> Term:
        # what both bear: the weaker joint's, or a start is far from all that could be
        scale = 0.2 * min(strength(scene, j) / j.range for j in (a, b))
        high = 10 * strength(scene, a) / a.range
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

    def act(self, moment, place, values):
        stiffness, ratio = values.T
        q = moment.qpos[:, place["qpos"]]
        pull = stiffness * (q - ratio * moment.qpos[:, place["other_qpos"]])
        moment.applied[:, place["dof"]] -= pull
        moment.applied[:, place["other_dof"]] += ratio * pull


class Backlash(Extra):
    name = "backlash"
    says = "Play in the gear: after a reversal the link waits until the gap is crossed."
    equation = "|q_link - q_motor| <= gap / 2"
    source = "MuJoCo manual, Modeling: Backlash, as two hinges"
    separate_by = "rock the joint slowly about a pose without load"
    regime = "reversal"
    suffix = "_play"
    light = 0.003  # of 0.001 to 0.01 what shows least where the gap is shut

    def parameters(self, scene, joint):
        scale = 0.03 * joint.range
        return (Parameter("gap", joint.unit, 0.0, 0.0, joint.range, scale),)

    def starts(self, scene, joint):
        # one twice as wide as the robot's explains nothing, as does none
        return tuple((share * joint.range,) for share in (0.003, 0.008, 0.02, 0.05))

    def numbers(self, model, values):
        half = max(float(values[0]) / 2, SHUT)
        # the shortest that MuJoCo computes; of 0.7 to 2 what shows least where shut
        hard = 2 * model.opt.timestep, 0.7
        soft = 0.9, 0.95, 0.001, 0.5, 2.0  # MuJoCo's default
        return {"range": (-half, half), "solreflimit": hard, "solimplimit": soft}

    def yields(self, values, load):
        return float(np.sign(load) * values[0] / 2)


class Compliance(Extra):
    name = "compliance"
    says = "A drive that bends: the link lags behind the motor by its load."
    equation = "tau = stiffness (q_motor - q_link) + damping (v_motor - v_link)"
    source = "Spong 1987, elastic joints"
    separate_by = "load the held joint with two known weights"
    regime = "high_load"
    suffix = "_flex"

    def parameters(self, scene, joint):
        most = self._stiffest(scene, joint)
        damped = most * scene.step  # stops all that the joint does in one step
        k = min(joint.torque / (0.03 * joint.range), most / 5)
        d = min(0.3 * np.sqrt(k * joint.inertia), damped / 5)
        unit = f"{joint.force}/{joint.unit}"
        return (
            Parameter("stiffness", unit, np.inf, 0.02 * k, most, k),
            Parameter("damping", f"{joint.force} s/{joint.unit}", d, 0.0, damped, d),
        )

    def _stiffest(self, scene, joint) -> float:
        """Stiffness [N m/rad or N/m] at which the joint swings once in six steps.

        MuJoCo takes a spring's torque as constant over a step: at three it diverges.
        """
        place = {"joint": joint.id, "dof": joint.dof, "inertia": joint.inertia}
        motor = self.rotor(scene.model, place)
        link = joint.inertia - float(scene.model.dof_armature[joint.dof])
        link = max(link, self.light * joint.inertia)
        return motor * link / (motor + link) / scene.step**2

    def starts(self, scene, joint):
        k, d = (p.scale for p in self.parameters(scene, joint))
        return ((k, d), (0.3 * k, d), (5 * k, d))

    def numbers(self, model, values):
        k, d = map(float, values)
        return {"stiffness": (k, 0.0, 0.0), "damping": (d, 0.0, 0.0)}

    def yields(self, values, load):
        return float(load / values[0])

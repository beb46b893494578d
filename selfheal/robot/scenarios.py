"""Scenarios: a number of Table 4 and a seed in, what breaks in a legged robot out."""

import numpy as np

from ..body.legged import HIDDEN, LeggedRobot
from ..damage.kinds import Damage
from ..errors import InputError

# 1 to 10: overview.txt, Table 4. What follows is what it proposes for later (4.3, 4.5):
# damage by degrees, and a world that changes.
TABLE = range(1, 11)
SCENARIOS = {
    1: "a lower leg breaks off",
    2: "a whole leg breaks off",
    3: "a touch sensor fails",
    4: "a whole leg breaks off, and a touch sensor of an intact leg fails",
    5: "an angle sensor fails",
    6: "an upper-leg joint jams",
    7: "a whole leg breaks off, and an upper-leg joint of an intact leg jams",
    8: "a whole leg breaks off, an upper-leg joint of an intact leg jams, and an angle "
    "sensor of another intact leg fails",
    9: "nothing breaks",
    10: "a hidden neuron fails",
    11: "a motor keeps 40 % of its strength",
    12: "a sensor keeps 80 % of what it reads",
    13: "the ground tilts",
    14: "the ground is slippery",
    15: "a steady wind blows",
}


def draw_scenario(number: int, robot: LeggedRobot, seed: int) -> tuple[Damage, ...]:
    """The damages of a scenario; which legs they strike is drawn.

    Raises:
        InputError: there is no such scenario.
    """
    if number not in SCENARIOS:
        said = f"scenarios are 1 to {len(SCENARIOS)}, or all (1 to 10); not {number}"
        raise InputError(said)
    rng = np.random.default_rng([seed, number, 40])
    legs = [part.removesuffix("_lower") for part in robot.parts if "_lower" in part]
    one, two, three = (str(leg) for leg in rng.permutation(legs)[:3])
    leg = Damage("limb_loss", f"body:{one}_upper")
    strikes = {
        1: lambda: (Damage("limb_loss", f"body:{one}_lower"),),
        2: lambda: (leg,),
        3: lambda: (_break_touch_sensor(one),),
        4: lambda: (leg, _break_touch_sensor(two)),
        5: lambda: (_break_angle_sensor(robot, one),),
        6: lambda: (_jam_hip(robot, one, rng),),
        7: lambda: (leg, _jam_hip(robot, two, rng)),
        8: lambda: (
            leg,
            # of two draws the second, so that a seed's damages stay what they were
            [_jam_hip(robot, two, rng) for _ in range(2)][1],
            _break_angle_sensor(robot, three),
        ),
        9: lambda: (),
        10: lambda: (Damage("neuron_dead", f"neuron:{rng.integers(HIDDEN)}"),),
    }
    if number in strikes:
        return strikes[number]()
    return (_draw_later_damage(number, robot, rng),)


def _draw_later_damage(
    number: int, robot: LeggedRobot, rng: np.random.Generator
) -> Damage:
    """What the overview proposes for later; sizes chosen."""
    azimuth = float(rng.uniform(0, 2 * np.pi))
    return {
        11: Damage("weak_motor", f"actuator:{rng.choice(robot.motors)}", 0.4),
        12: Damage("weak_sensor", f"sensor:{rng.choice(robot.sensors)}", 0.8),
        13: Damage("slope", value=float(np.radians(6.0)), azimuth=azimuth),
        14: Damage("ground_friction", value=0.25),
        15: Damage("wind", value=8.0, azimuth=azimuth),
    }[number]


def _break_touch_sensor(leg: str) -> Damage:
    """The death of a leg's touch sensor."""
    return Damage("sensor_dead", f"sensor:{leg}_lower_touch")


def _break_angle_sensor(robot: LeggedRobot, leg: str) -> Damage:
    """The death of a leg's angle sensor."""
    (name,) = (s for s in robot.sensors if s.startswith(leg) and "_position" in s)
    return Damage("sensor_dead", f"sensor:{name}")


def _jam_hip(robot: LeggedRobot, leg: str, rng: np.random.Generator) -> Damage:
    """The jam of a leg's hip, or of one degree of freedom of it."""
    hips = [p.name for p in robot.damage_sites if p.part == f"{leg}_upper"]
    return Damage("joint_jam", f"joint:{rng.choice(hips)}")

"""The other cases: what is wrong with each hidden robot, and what its key says."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from benchmarks.other_cases import effects as put
from benchmarks.other_cases.jointed_robots import (
    ARM,
    FURUTA,
    FURUTA_IMU,
    GANTRY,
    HOPPER,
    ROVER,
    SCARA,
)
from benchmarks.other_cases.motions import command_sines
from benchmarks.other_cases.robot import Robot, measure_angle
from benchmarks.other_cases.simple_robots import (
    BALL,
    CARTPOLE,
    COARSE_ENCODER,
    DRONE,
    ELEVATOR,
    ENCODER_AND_TACHO,
    PENDULUM,
    PLANAR,
    SLED,
    TILTED_POLE,
)


@dataclass(frozen=True)
class OtherCase:
    """One case.

    Attributes:
        name: of its folders.
        robot: as given.
        stated: seed of the errors in what the model states.
        seed: of the recording.
        effects: what is missing from the model.
        change: installs those that are a change of the model.
        kind: as the sealed benchmark's.
        delay: [s] of the commands.
        jitter: share that the time between samples varies by.
        missing: share of the samples.
        state: True where episodes state where they start.
    """

    name: str
    robot: Robot
    stated: int
    seed: int
    effects: Sequence[put.TrueEffect] = ()
    change: put.SpecEdit = lambda spec: None
    kind: str = "single"
    delay: float = 0.0
    jitter: float = 0.0
    missing: float = 0.0
    state: bool = False


OTHER_CASES = (
    OtherCase(
        "gantry_viscous",
        GANTRY,
        0,
        1,
        [put.state_viscous_friction("y", 9.0, "N s/m")],
        put.set_joint("y", damping=[9.0, 0, 0]),
    ),
    OtherCase("gantry_null", GANTRY, 4, 2, kind="null"),
    OtherCase(
        "gantry_friction",
        GANTRY,
        5,
        3,
        [put.state_coulomb_friction("swing_x", 0.15)],
        put.set_joint("swing_x", frictionloss=0.15),
        jitter=0.3,
    ),
    OtherCase(
        "arm_coulomb",
        ARM,
        0,
        1,
        [put.state_coulomb_friction("elbow", 0.9)],
        put.set_joint("elbow", frictionloss=0.9),
        missing=0.02,
    ),
    OtherCase(
        "arm_payload",
        ARM,
        2,
        2,
        [put.state_payload("hand", 0.3, x=0.09, y=0.0, z=0.0)],
        put.add_ball("hand", 0.3, [0.09, 0, 0]),
        state=True,
    ),
    # a gear 10 % off lies inside what a refit may do
    OtherCase(
        "arm_gain",
        ARM,
        3,
        3,
        change=put.set_actuator("m_shoulder", gear=[80 * 0.9, 0, 0, 0, 0, 0]),
        kind="null",
    ),
    OtherCase(
        "arm_bias",
        replace(
            ARM, signals={**ARM.signals, "q_wrist": measure_angle("wrist", 3e-4, 0.06)}
        ),
        6,
        5,
        [put.state_sensor_bias("q_wrist", 0.06)],
    ),
    OtherCase(
        "furuta_delay",
        FURUTA,
        0,
        1,
        [put.state_command_delay("drive", 0.017)],
        delay=0.017,
    ),
    OtherCase(
        "furuta_gyro",
        FURUTA_IMU,
        3,
        2,
        [put.TrueEffect("sensor_bias", "sensor:imu", {"bias_y": (0.08, "rad/s")})],
    ),
    OtherCase(
        "hopper_payload",
        HOPPER,
        0,
        1,
        [put.state_payload("torso", 0.6, x=0.1, z=0.06)],
        put.add_ball("torso", 0.6, [0.1, 0, 0.06]),
        state=True,
    ),
    OtherCase(
        "hopper_weak",
        HOPPER,
        7,
        2,
        [put.state_servo_gain("fk", 30.0, "N m/rad")],
        put.halve_knee_stiffness,
        state=True,
    ),
    OtherCase(
        "hopper_slope", HOPPER, 5, 5, [put.state_slope(0.06)], put.tilt_gravity(0.06)
    ),
    OtherCase(
        "rover_friction",
        ROVER,
        0,
        1,
        [put.state_coulomb_friction("left", 0.06)],
        put.set_joint("left", frictionloss=0.06),
    ),
    OtherCase("rover_null", ROVER, 9, 3, kind="null"),
    OtherCase(
        "sled_friction",
        SLED,
        3,
        1,
        [put.TrueEffect("ground_friction", "world", {"friction": (0.17, "1")})],
        put.halve_friction,
    ),
    OtherCase("sled_null", SLED, 4, 2, kind="null"),
    OtherCase(
        "scara_slope", SCARA, 0, 1, [put.state_slope(0.08)], put.tilt_gravity(0.08)
    ),
    OtherCase(
        "scara_two",
        SCARA,
        3,
        2,
        [
            put.state_coulomb_friction("q2", 0.5),
            put.TrueEffect("actuator_lag", "actuator:ar", {"timeconst": (0.04, "s")}),
        ],
        put.add_friction_and_lag,
        kind="double",
    ),
    OtherCase(
        "drone_com",
        DRONE,
        0,
        1,
        [
            put.TrueEffect(
                "com_shift",
                "body:drone",
                {"x": (0.012, "m"), "y": (0.0, "m"), "z": (0.0, "m")},
            )
        ],
        put.shift_drone_mass,
    ),
    OtherCase(
        "drone_weak",
        DRONE,
        4,
        2,
        [put.state_servo_gain("t2", 0.55, "N/ctrl")],
        put.set_actuator("t2", gear=[0, 0, 0.55, 0, 0, -0.011]),
    ),
    OtherCase(
        "pen_single_episode",
        replace(PENDULUM, signals=COARSE_ENCODER, seconds=60, episodes=1),
        1,
        1,
        [put.state_coulomb_friction("hinge", 0.12)],
        put.set_joint("hinge", frictionloss=0.12),
    ),
    OtherCase("pen_null_drift", PENDULUM, 2, 2, kind="null"),
    OtherCase(
        "pen_two_effects",
        replace(
            PENDULUM,
            signals=ENCODER_AND_TACHO,
            motion=command_sines(1.0, 0.3, 2.5),
            seconds=10,
            episodes=6,
            rate=100,
        ),
        3,
        3,
        [
            put.TrueEffect("armature", "joint:hinge", {"armature": (0.03, "kg m^2")}),
            put.state_command_delay("srv", 0.03),
        ],
        put.set_joint("hinge", armature=0.03),
        kind="double",
        delay=0.03,
    ),
    OtherCase(
        "planar_backlash",
        PLANAR,
        1,
        1,
        [
            put.TrueEffect(
                "backlash", "joint:b", {"gap": (0.04, "rad")}, measured="motor"
            )
        ],
        put.add_backlash,
    ),
    OtherCase(
        "planar_spring",
        PLANAR,
        2,
        2,
        [
            put.TrueEffect(
                "joint_spring",
                "joint:c",
                {"stiffness": (1.2, "N m/rad"), "springref": (0.0, "rad")},
            )
        ],
        put.set_joint("c", stiffness=[1.2, 0, 0]),
    ),
    OtherCase(
        "planar_length",
        PLANAR,
        3,
        3,
        [put.TrueEffect("link_length", "body:l2", {"length": (0.29, "m")})],
        put.lengthen_link,
    ),
    OtherCase(
        "elevator_payload",
        ELEVATOR,
        1,
        1,
        [put.state_payload("car", 4.0)],
        put.add_ball("car", 4.0, [0, 0, 0]),
    ),
    OtherCase(
        "elevator_sat",
        ELEVATOR,
        2,
        2,
        [
            put.TrueEffect(
                "torque_saturation", "actuator:winch", {"limit": (150.0, "N")}
            )
        ],
        put.set_actuator("winch", forcerange=[-150.0, 150.0], forcelimited=1),
    ),
    OtherCase(
        "ball_drag",
        BALL,
        1,
        1,
        [put.TrueEffect("fluid_drag", "world", {"density": (4.8, "kg/m^3")})],
        put.thicken_air,
    ),
    OtherCase(
        "cartpole_sensors",
        CARTPOLE,
        1,
        1,
        [put.state_viscous_friction("hinge", 0.02, "N m s/rad")],
        put.set_joint("hinge", damping=[0.02, 0, 0]),
        state=True,
    ),
    OtherCase(
        "cartpole_bias",
        replace(CARTPOLE, signals=TILTED_POLE),
        2,
        2,
        [put.state_sensor_bias("pole", -0.05)],
    ),
)

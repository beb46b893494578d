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
    Robot,
    angle,
)
from benchmarks.other_cases.motions import sines
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
class Other:
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
    effects: Sequence[put.Effect] = ()
    change: put.Change = lambda spec: None
    kind: str = "single"
    delay: float = 0.0
    jitter: float = 0.0
    missing: float = 0.0
    state: bool = False


OTHERS = (
    Other(
        "gantry_viscous",
        GANTRY,
        0,
        1,
        [put.viscous("y", 9.0, "N s/m")],
        put.on_joint("y", damping=[9.0, 0, 0]),
    ),
    Other("gantry_null", GANTRY, 4, 2, kind="null"),
    Other(
        "gantry_friction",
        GANTRY,
        5,
        3,
        [put.dry("swing_x", 0.15)],
        put.on_joint("swing_x", frictionloss=0.15),
        jitter=0.3,
    ),
    Other(
        "arm_coulomb",
        ARM,
        0,
        1,
        [put.dry("elbow", 0.9)],
        put.on_joint("elbow", frictionloss=0.9),
        missing=0.02,
    ),
    Other(
        "arm_payload",
        ARM,
        2,
        2,
        [put.payload("hand", 0.3, x=0.09, y=0.0, z=0.0)],
        put.weight("hand", 0.3, [0.09, 0, 0]),
        state=True,
    ),
    # a gear 10 % off lies inside what a refit may do
    Other(
        "arm_gain",
        ARM,
        3,
        3,
        change=put.on_actuator("m_shoulder", gear=[80 * 0.9, 0, 0, 0, 0, 0]),
        kind="null",
    ),
    Other(
        "arm_bias",
        replace(ARM, signals=ARM.signals | {"q_wrist": angle("wrist", 3e-4, 0.06)}),
        6,
        5,
        [put.bias("q_wrist", 0.06)],
    ),
    Other("furuta_delay", FURUTA, 0, 1, [put.late("drive", 0.017)], delay=0.017),
    Other(
        "furuta_gyro",
        FURUTA_IMU,
        3,
        2,
        [put.Effect("sensor_bias", "sensor:imu", {"bias_y": (0.08, "rad/s")})],
    ),
    Other(
        "hopper_payload",
        HOPPER,
        0,
        1,
        [put.payload("torso", 0.6, x=0.1, z=0.06)],
        put.weight("torso", 0.6, [0.1, 0, 0.06]),
        state=True,
    ),
    Other(
        "hopper_weak",
        HOPPER,
        7,
        2,
        [put.gain("fk", 30.0, "N m/rad")],
        put.half_stiff,
        state=True,
    ),
    Other("hopper_slope", HOPPER, 5, 5, [put.slope(0.06)], put.tilt(0.06)),
    Other(
        "rover_friction",
        ROVER,
        0,
        1,
        [put.dry("left", 0.06)],
        put.on_joint("left", frictionloss=0.06),
    ),
    Other("rover_null", ROVER, 9, 3, kind="null"),
    Other(
        "sled_friction",
        SLED,
        3,
        1,
        [put.Effect("ground_friction", "world", {"friction": (0.17, "1")})],
        put.slippery,
    ),
    Other("sled_null", SLED, 4, 2, kind="null"),
    Other("scara_slope", SCARA, 0, 1, [put.slope(0.08)], put.tilt(0.08)),
    Other(
        "scara_two",
        SCARA,
        3,
        2,
        [
            put.dry("q2", 0.5),
            put.Effect("actuator_lag", "actuator:ar", {"timeconst": (0.04, "s")}),
        ],
        put.stiff_and_late,
        kind="double",
    ),
    Other(
        "drone_com",
        DRONE,
        0,
        1,
        [
            put.Effect(
                "com_shift",
                "body:drone",
                {"x": (0.012, "m"), "y": (0.0, "m"), "z": (0.0, "m")},
            )
        ],
        put.off_center,
    ),
    Other(
        "drone_weak",
        DRONE,
        4,
        2,
        [put.gain("t2", 0.55, "N/ctrl")],
        put.on_actuator("t2", gear=[0, 0, 0.55, 0, 0, -0.011]),
    ),
    Other(
        "pen_single_episode",
        replace(PENDULUM, signals=COARSE_ENCODER, seconds=60, episodes=1),
        1,
        1,
        [put.dry("hinge", 0.12)],
        put.on_joint("hinge", frictionloss=0.12),
    ),
    Other("pen_null_drift", PENDULUM, 2, 2, kind="null"),
    Other(
        "pen_two_effects",
        replace(
            PENDULUM,
            signals=ENCODER_AND_TACHO,
            motion=sines(1.0, 0.3, 2.5),
            seconds=10,
            episodes=6,
            rate=100,
        ),
        3,
        3,
        [
            put.Effect("armature", "joint:hinge", {"armature": (0.03, "kg m^2")}),
            put.late("srv", 0.03),
        ],
        put.on_joint("hinge", armature=0.03),
        kind="double",
        delay=0.03,
    ),
    Other(
        "planar_backlash",
        PLANAR,
        1,
        1,
        [put.Effect("backlash", "joint:b", {"gap": (0.04, "rad")}, measured="motor")],
        put.play,
    ),
    Other(
        "planar_spring",
        PLANAR,
        2,
        2,
        [
            put.Effect(
                "joint_spring",
                "joint:c",
                {"stiffness": (1.2, "N m/rad"), "springref": (0.0, "rad")},
            )
        ],
        put.on_joint("c", stiffness=[1.2, 0, 0]),
    ),
    Other(
        "planar_length",
        PLANAR,
        3,
        3,
        [put.Effect("link_length", "body:l2", {"length": (0.29, "m")})],
        put.longer,
    ),
    Other(
        "elevator_payload",
        ELEVATOR,
        1,
        1,
        [put.payload("car", 4.0)],
        put.weight("car", 4.0, [0, 0, 0]),
    ),
    Other(
        "elevator_sat",
        ELEVATOR,
        2,
        2,
        [put.Effect("torque_saturation", "actuator:winch", {"limit": (150.0, "N")})],
        put.on_actuator("winch", forcerange=[-150.0, 150.0], forcelimited=1),
    ),
    Other(
        "ball_drag",
        BALL,
        1,
        1,
        [put.Effect("fluid_drag", "world", {"density": (4.8, "kg/m^3")})],
        put.thick_air,
    ),
    Other(
        "cartpole_sensors",
        CARTPOLE,
        1,
        1,
        [put.viscous("hinge", 0.02, "N m s/rad")],
        put.on_joint("hinge", damping=[0.02, 0, 0]),
        state=True,
    ),
    Other(
        "cartpole_bias",
        replace(CARTPOLE, signals=TILTED_POLE),
        2,
        2,
        [put.bias("pole", -0.05)],
    ),
)

"""The other cases' robots: MJCF in many styles, what is measured, how each moves."""

from dataclasses import replace

from benchmarks.other_cases import motions as move
from benchmarks.other_cases.robot import (
    Robot,
    Sensor,
    measure_angle,
    measure_pose,
    measure_slide,
    measure_speed,
)

GANTRY = Robot(
    "gantry",
    """<mujoco model="gantry">
  <!-- crane with a load -->
  <option timestep="0.002"/>
  <default><motor ctrllimited="true" ctrlrange="-1 1"/></default>
  <worldbody>
    <body name="bridge" pos="0 0 2">
      <joint name="x" type="slide" axis="1 0 0" frictionloss="1.5"/>
      <geom type="box" size=".5 .05 .05" mass="6"/>
      <body name="trolley">
        <joint name="y" type="slide" axis="0 1 0"/>
        <geom type="box" size=".05 .05 .05" mass="2"/>
        <body name="load" pos="0 0 -.05">
          <joint name="swing_x" axis="0 1 0"/>
          <joint name="swing_y" axis="1 0 0"/>
          <geom type="sphere" size=".05" pos="0 0 -.6" mass="1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="mx" joint="x" gear="40"/>
    <motor name="my" joint="y" gear="20"/>
  </actuator>
</mujoco>
""",
    {
        "px": measure_slide("x", 2e-4),
        "py": measure_slide("y", 2e-4),
        "sx": measure_angle("swing_x", 1e-3),
        "sy": measure_angle("swing_y", 1e-3),
    },
    move.drive_crane,
    seconds=8,
    episodes=8,
    rate=200,
    piece=0.5,
)

_ARM_JOINTS = ("yaw", "shoulder", "elbow", "wrist")
ARM = Robot(
    "geared_arm",
    """<mujoco model="geared">
  <compiler angle="degree"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <default>
    <default class="big"><joint armature="0.05" damping="0.8"/></default>
    <default class="small"><joint armature="0.01" damping="0.1"/></default>
  </default>
  <worldbody>
    <body name="base" pos="0 0 1" euler="0 0 30">
      <joint name="yaw" axis="0 0 1" class="big"/>
      <geom type="cylinder" size=".05 .1" mass="2"/>
      <body name="upper" pos="0 0 .1">
        <joint name="shoulder" axis="0 1 0" class="big" range="-120 120"
               limited="true"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1.2"/>
        <body name="fore" pos=".3 0 0">
          <joint name="elbow" axis="0 1 0" class="small"/>
          <geom type="capsule" fromto="0 0 0 .25 0 0" size=".025" mass=".7"/>
          <body name="hand" pos=".25 0 0">
            <joint name="wrist" axis="0 1 0" class="small"/>
            <geom type="box" size=".04 .02 .02" pos=".04 0 0" mass=".25"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="m_yaw" joint="yaw" gear="60"/>
    <motor name="m_shoulder" joint="shoulder" gear="80"/>
    <motor name="m_elbow" joint="elbow" gear="50"/>
    <motor name="m_wrist" joint="wrist" gear="20"/>
  </actuator>
</mujoco>
""",
    {f"q_{j}": measure_angle(j, 3e-4) for j in _ARM_JOINTS}
    | {f"dq_{j}": measure_speed(j, 1e-2) for j in _ARM_JOINTS},
    move.drive_arm,
    seconds=10,
    episodes=6,
    rate=250,
    start=move.start_arm,
    piece=0.5,
)

FURUTA = Robot(
    "furuta",
    """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="table">
      <joint name="turn" axis="0 0 1" damping=".02"/>
      <geom type="cylinder" size=".2 .01" mass="1"/>
      <body name="stick" pos=".2 0 0">
        <joint name="swing" axis="1 0 0" damping=".001"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".01" mass=".15"/>
      </body>
    </body>
  </worldbody>
  <actuator><velocity name="drive" joint="turn" kv="0.6"/></actuator>
</mujoco>
""",
    {"enc": measure_angle("turn", 5e-4), "stick": measure_angle("swing", 1.5e-3)},
    move.command_sines(4.0, 0.3, 1.5),
    seconds=6,
    episodes=8,
    rate=100,
    piece=2.0,  # a stick that whirls does so at another moment
)

FURUTA_IMU = replace(
    FURUTA,
    name="furuta_imu",
    xml=FURUTA.xml.replace(
        'mass=".15"/>\n', 'mass=".15"/>\n        <site name="s" pos="0 0 -.2"/>\n'
    ).replace(
        "</mujoco>",
        '  <sensor><gyro name="imu" site="s"/><accelerometer name="acc" site="s"/>'
        "</sensor>\n</mujoco>",
    ),
    signals={
        "enc": measure_angle("turn", 5e-4),
        "swing": measure_angle("swing", 1.5e-3),
        "imu": Sensor("sensor", "imu", "rad/s", 5e-3, bias=(0, 0.08, 0)),
    },
)

_HOPPER_JOINTS = ("pitch", "f_hip", "f_knee", "b_hip", "b_knee")
HOPPER = Robot(
    "hopper",
    """<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1" friction=".8"/>
    <body name="torso" pos="0 0 .45">
      <joint name="rx" type="slide" axis="1 0 0"/>
      <joint name="rz" type="slide" axis="0 0 1"/>
      <joint name="pitch" axis="0 1 0" damping=".5"/>
      <geom type="box" size=".15 .06 .05" mass="2.5"/>
      <body name="f_thigh" pos=".12 0 0">
        <joint name="f_hip" axis="0 1 0" damping=".05" armature=".005"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".3"/>
        <body name="f_shin" pos="0 0 -.2">
          <joint name="f_knee" axis="0 1 0" damping=".05" armature=".005"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".2"/>
        </body>
      </body>
      <body name="b_thigh" pos="-.12 0 0">
        <joint name="b_hip" axis="0 1 0" damping=".05" armature=".005"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".3"/>
        <body name="b_shin" pos="0 0 -.2">
          <joint name="b_knee" axis="0 1 0" damping=".05" armature=".005"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="fh" joint="f_hip" kp="60" kv="1"/>
    <position name="fk" joint="f_knee" kp="60" kv="1"/>
    <position name="bh" joint="b_hip" kp="60" kv="1"/>
    <position name="bk" joint="b_knee" kp="60" kv="1"/>
  </actuator>
</mujoco>
""",
    {j: measure_slide(j, 5e-4) for j in ("rx", "rz")}
    | {j: measure_angle(j, 5e-4) for j in _HOPPER_JOINTS},
    move.command_hops,
    seconds=4,
    episodes=8,
    rate=200,
    start=move.start_hopper,
    fine=0.00025,
    piece=1.0,
)

ROVER = Robot(
    "rover",
    """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 .1" friction="1 .005 .0001"/>
    <body name="chassis" pos="0 0 .05">
      <freejoint name="root"/>
      <geom type="box" size=".15 .1 .02" mass="2" contype="0" conaffinity="0"/>
      <geom name="caster" type="sphere" size=".02" pos=".12 0 -.03" mass=".05"
            friction=".01"/>
      <body name="lw" pos="-.05 .12 0">
        <joint name="left" axis="0 1 0" damping=".002" armature=".001"/>
        <geom type="cylinder" size=".05 .01" zaxis="0 1 0" mass=".15"/>
      </body>
      <body name="rw" pos="-.05 -.12 0">
        <joint name="right" axis="0 1 0" damping=".002" armature=".001"/>
        <geom type="cylinder" size=".05 .01" zaxis="0 1 0" mass=".15"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <velocity name="vl" joint="left" kv=".05"/>
    <velocity name="vr" joint="right" kv=".05"/>
  </actuator>
</mujoco>
""",
    {"left": measure_angle("left", 1e-3), "right": measure_angle("right", 1e-3)}
    | measure_pose("chassis", 1e-3, 1e-3),
    move.command_sines(8.0, 0.1, 0.6),
    seconds=6,
    episodes=8,
    rate=100,
    fine=0.0005,
    piece=1.0,
)

SCARA = Robot(
    "scara",
    """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <position kp="60" kv="4"/>
    <joint damping=".3" armature=".02"/>
  </default>
  <worldbody>
    <body name="arm1" pos="0 0 .5">
      <joint name="q1" axis="0 0 1"/>
      <geom type="box" size=".15 .03 .02" pos=".15 0 0" mass="1.5"/>
      <body name="arm2" pos=".3 0 0">
        <joint name="q2" axis="0 0 1"/>
        <geom type="box" size=".12 .03 .02" pos=".12 0 0" mass="1"/>
        <body name="quill" pos=".24 0 0">
          <joint name="z" type="slide" axis="0 0 1" damping="5" armature=".2"/>
          <geom type="cylinder" size=".01 .1" mass=".3"/>
          <body name="tool">
            <joint name="r" axis="0 0 1" damping=".01" armature=".001"/>
            <geom type="box" size=".05 .01 .01" pos=".03 0 0" mass=".2"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a1" joint="q1"/>
    <position name="a2" joint="q2"/>
    <position name="az" joint="z" kp="800" kv="40"/>
    <position name="ar" joint="r" kp="5" kv=".2"/>
  </actuator>
</mujoco>
""",
    {
        "q1": measure_angle("q1", 2e-4),
        "q2": measure_angle("q2", 2e-4),
        "z": measure_slide("z", 5e-5),
        "r": measure_angle("r", 1e-3),
    },
    move.command_sines([0.8, 0.8, 0.05, 1.5], 0.1, 0.8, 0.2),
    seconds=8,
    episodes=6,
    rate=100,
)

"""More robots of the other cases: those of few joints, one that flies, one thrown."""

from benchmarks.other_cases import motions as move
from benchmarks.other_cases.robot import (
    Robot,
    Sensor,
    measure_angle,
    measure_pose,
    measure_slide,
    measure_speed,
)

DRONE = Robot(
    "drone",
    """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="drone" pos="0 0 1">
      <freejoint/>
      <geom type="box" size=".1 .1 .02" mass=".6"/>
      <site name="p1" pos=".12 .12 0"/>
      <site name="p2" pos="-.12 .12 0"/>
      <site name="p3" pos="-.12 -.12 0"/>
      <site name="p4" pos=".12 -.12 0"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="t1" site="p1" gear="0 0 1 0 0 .02"/>
    <motor name="t2" site="p2" gear="0 0 1 0 0 -.02"/>
    <motor name="t3" site="p3" gear="0 0 1 0 0 .02"/>
    <motor name="t4" site="p4" gear="0 0 1 0 0 -.02"/>
  </actuator>
</mujoco>
""",
    measure_pose("drone", 1e-3, 1e-3),
    move.fly_drone,
    seconds=8,
    episodes=6,
    rate=120,
    piece=0.5,
)

PENDULUM = Robot(
    "belt_pendulum",
    """<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="rod">
      <joint name="hinge" axis="0 1 0" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".015" mass=".5"/>
    </body>
  </worldbody>
  <actuator>
    <position name="srv" joint="hinge" kp="8" kv=".3" ctrlrange="-2 2"/>
  </actuator>
</mujoco>
""",
    {"angle": measure_angle("hinge", 1e-3)},
    move.command_sines(1.0, 0.1, 0.8),
    seconds=20,
    episodes=3,
    rate=50,
)
COARSE_ENCODER = {"angle": measure_angle("hinge", 0.0, step=0.0015)}
ENCODER_AND_TACHO = {**PENDULUM.signals, "speed": measure_speed("hinge", 2e-2)}

PLANAR = Robot(
    "planar_arm",
    """<mujoco>
  <option timestep="0.001" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="l1">
      <joint name="a" axis="0 0 1" damping=".05" armature=".01"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass=".8"/>
      <body name="l2" pos=".3 0 0">
        <joint name="b" axis="0 0 1" damping=".03" armature=".005"/>
        <geom type="capsule" fromto="0 0 0 .25 0 0" size=".02" mass=".5"/>
        <body name="l3" pos=".25 0 0">
          <joint name="c" axis="0 0 1" damping=".01" armature=".002"/>
          <geom type="capsule" fromto="0 0 0 .15 0 0" size=".015" mass=".2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general name="ga" joint="a" gainprm="30" biastype="affine" biasprm="0 -30 -2"/>
    <general name="gb" joint="b" gainprm="15" biastype="affine" biasprm="0 -15 -1"/>
    <general name="gc" joint="c" gainprm="5" biastype="affine" biasprm="0 -5 -.2"/>
  </actuator>
</mujoco>
""",
    {f"p{j}": measure_angle(j, 2e-4) for j in "abc"},
    move.command_sines(0.8),
    seconds=8,
    episodes=6,
    rate=250,
    fine=0.00025,
)

ELEVATOR = Robot(
    "elevator",
    """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="car">
      <joint name="z" type="slide" axis="0 0 1" damping="20"/>
      <geom type="box" size=".2 .2 .3" mass="12"/>
    </body>
  </worldbody>
  <actuator><motor name="winch" joint="z"/></actuator>
</mujoco>
""",
    {"h": measure_slide("z", 5e-4)},
    move.drive_lift,
    seconds=10,
    episodes=5,
    rate=100,
    piece=0.5,
)

SLED = Robot(
    "sled",
    """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 .1" friction=".34 .005 .0001"/>
    <body name="sled" pos="0 0 .05">
      <freejoint/>
      <geom name="hull" type="box" size=".2 .15 .05" mass="2.8"
            friction=".34 .005 .0001"/>
      <site name="left" pos="-.2 .12 0"/>
      <site name="right" pos="-.2 -.12 0"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="fan_l" site="left" gear="1 0 0 0 0 0"/>
    <motor name="fan_r" site="right" gear="1 0 0 0 0 0"/>
  </actuator>
</mujoco>
""",
    measure_pose("sled", 1e-3, 1e-3),
    move.command_sines(5.0, 0.1, 0.6),
    seconds=8,
    episodes=6,
    rate=100,
    fine=0.0005,
    piece=1.0,
)

BALL = Robot(
    "ball",
    """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="ground" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 1">
      <freejoint/>
      <geom type="sphere" size=".08" mass=".06"/>
    </body>
  </worldbody>
</mujoco>
""",
    measure_pose("ball", 1e-3, 2e-3),
    move.command_nothing,
    seconds=0.8,
    episodes=20,
    rate=240,
    start=move.throw_ball,
    fine=0.0005,
)

CARTPOLE = Robot(
    "cartpole",
    """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" damping="1"/>
      <geom type="box" size=".1 .05 .05" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".01" mass=".2"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="rail"/></actuator>
  <sensor>
    <jointpos name="rail_enc" joint="rail"/>
    <jointpos name="pole_enc" joint="hinge"/>
    <jointvel name="tacho" joint="rail"/>
  </sensor>
</mujoco>
""",
    {
        "rail_enc": Sensor("sensor", "rail_enc", "m", 3e-4),
        "pole_enc": Sensor("sensor", "pole_enc", "rad", 1e-3),
        "tacho": Sensor("sensor", "tacho", "m/s", 1e-2),
    },
    move.push_cart,
    seconds=8,
    episodes=6,
    rate=125,
    piece=0.5,
)
TILTED_POLE = {
    "rail": measure_slide("rail", 3e-4),
    "pole": measure_angle("hinge", 1e-3, bias=-0.05),
}

"""Models of an arm with much in them, to be damaged: MJCF and URDF."""

RICH = """<mujoco model="rich">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <size nuserdata="4"/>
  <include file="part.xml"/>
  <default>
    <joint damping="0.05" armature="0.01"/>
    <default class="light">
      <geom density="100" rgba="1 0 0 1"/>
    </default>
  </default>
  <custom>
    <numeric name="version" data="1 2 3"/>
  </custom>
  <asset>
    <texture name="squares" type="2d" builtin="checker" width="64" height="64"
      rgb1="0 0 0" rgb2="1 1 1"/>
    <material name="tiles" texture="squares" texrepeat="4 4"/>
    <hfield name="hills" nrow="3" ncol="3" size="1 1 0.1 0.1"
      elevation="0 1 0 1 2 1 0 1 0"/>
    <mesh name="cube" file="asset.obj"/>
    <mesh name="wedge" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="hfield" hfield="hills" pos="0 0 -2" material="tiles"/>
    <replicate count="4" offset="0.2 0 0">
      <geom class="light" size="0.01" pos="0 2 0"/>
    </replicate>
    <frame pos="0 0 1" euler="0 0 0.1">
      <body name="upper">
        <joint name="shoulder" axis="0 1 0" range="-3 3"/>
        <geom name="upper" type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"
          mass="0.4"/>
        <body name="lower" pos="0.2 0 0">
          <inertial pos="0.1 0 0" mass="0.2" diaginertia="1e-4 1e-3 1e-3"/>
          <joint name="elbow" axis="0 1 0" range="-3 3"/>
          <geom name="lower" type="mesh" mesh="cube" pos="0.1 0 0"/>
          <geom class="light" type="mesh" mesh="wedge"/>
          <site name="tip" pos="0.2 0 0"/>
        </body>
      </body>
    </frame>
  </worldbody>
  <contact>
    <exclude body1="upper" body2="lower"/>
  </contact>
  <tendon>
    <fixed name="both">
      <joint joint="shoulder" coef="1"/>
      <joint joint="elbow" coef="-1"/>
    </fixed>
  </tendon>
  <equality>
    <tendon tendon1="both" active="false"/>
  </equality>
  <actuator>
    <position name="shoulder_servo" joint="shoulder" kp="20" kv="0.8"/>
    <position name="elbow_servo" joint="elbow" kp="10" kv="0.4" forcerange="-5 5"/>
  </actuator>
  <sensor>
    <jointpos name="elbow_angle" joint="elbow"/>
    <framepos name="tip_place" objtype="site" objname="tip"/>
  </sensor>
  <keyframe>
    <key name="home" qpos="0.1 -0.1" ctrl="0 0"/>
  </keyframe>
</mujoco>
"""
PART = """<mujoco>
  <worldbody>
    <geom name="wall" type="box" size="1 1 0.1" pos="0 0 -3"/>
  </worldbody>
</mujoco>
"""
_INERTIA = (
    '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>'
)
URDF = f"""<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="0.1 0 0"/><mass value="0.4"/>{_INERTIA}
    <collision><origin xyz="0.1 0 0" rpy="0 1.57 0"/>
      <geometry><cylinder length="0.2" radius="0.02"/></geometry></collision>
  </link>
  <link name="lower">
    <inertial><origin xyz="0.1 0 0"/><mass value="0.2"/>{_INERTIA}
    <visual><geometry><mesh filename="asset.obj" scale="1 1 1"/></geometry></visual>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/>
    <origin xyz="0 0 1" rpy="0 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="10" velocity="10"/>
    <dynamics damping="0.05" friction="0.0"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="lower"/>
    <origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="10" velocity="10"/>
    <dynamics damping="0.03"/>
  </joint>
</robot>
"""

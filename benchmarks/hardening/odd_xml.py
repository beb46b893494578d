"""Elements that a model may hold and that are odd: where, and their XML."""

_NESTED = (
    '<replicate count="1000" offset="0 0 1"><replicate count="1000" offset="0 1 0">'
    '<geom size="0.01"/></replicate></replicate>'
)
# (element of the root that it goes into, XML)
ODD_ELEMENTS: tuple[tuple[str, str], ...] = (
    ("asset", '<hfield name="h" nrow="65536" ncol="65536" size="1 1 1 1"/>'),
    ("asset", '<hfield name="h" nrow="2" ncol="2" size="1 1 1 1" elevation="1 nan"/>'),
    ("asset", '<hfield name="h" nrow="-2" ncol="2" size="1 1 1 1"/>'),
    ("asset", '<hfield name="h" file="asset.bin" size="1 1 1 1"/>'),
    ("asset", '<texture name="t" type="2d" builtin="flat" width="30000" '
              'height="30000"/>'),
    ("asset", '<texture name="t" type="cube" builtin="checker" width="12000" '
              'height="72000"/>'),
    ("asset", '<texture name="t" type="2d" file="asset.bin"/>'),
    ("asset", '<texture name="t" type="2d" file="pipe"/>'),
    ("asset", '<mesh name="m" file="no_such.stl"/>'),
    ("asset", '<mesh name="m" file="asset.bin"/>'),
    ("asset", '<mesh name="m" file="pipe"/>'),
    ("asset", '<mesh name="m" vertex="0 0 0 1 0 0 0 1 0 nan 0 1"/>'),
    ("asset", '<mesh name="m" vertex="0 0 0 1e30 0 0 0 1e30 0 0 0 1e30"/>'),
    ("asset", '<mesh name="m" vertex="0 0 0 0 0 0 0 0 0 0 0 0"/>'),
    ("asset", '<mesh name="m" builtin="sphere" params="9"/>'),
    ("asset", '<material name="no" texture="no_such"/>'),
    ("asset", '<model name="a" file="model.xml"/>'),
    ("worldbody", '<replicate count="1000000000"><geom size="0.01"/></replicate>'),
    ("worldbody", '<replicate count="-1"><geom size="0.01"/></replicate>'),
    ("worldbody", _NESTED),
    ("worldbody", '<nest300frame><geom size="0.01"/></nest300frame>'),
    ("worldbody", '<include file="pipe"/>'),
    ("worldbody", '<include file="."/>'),
    ("worldbody", '<geom type="mesh" mesh="no_such"/>'),
    ("worldbody", '<geom type="hfield" hfield="no_such"/>'),
    ("worldbody", '<geom type="sphere" size="nan" mass="1"/>'),
    ("worldbody", '<geom type="sphere" size="0.1" mass="1e308"/>'),
    ("worldbody", '<body name="b"><joint name="j" axis="0 0 0"/></body>'),
    ("worldbody", '<body name="b"><joint type="free"/><joint/></body>'),
    ("worldbody", '<body name="b"><freejoint/><inertial pos="nan 0 0" mass="1" '
                  'diaginertia="1 1 1"/></body>'),
    ("worldbody", '<body name="b"><inertial pos="0 0 0" mass="-1" '
                  'diaginertia="-1 1 9"/><joint/></body>'),
    ("worldbody", '<body mocap="true" quat="0 0 0 0"><geom size="1"/></body>'),
    ("worldbody", '<flexcomp name="f" type="grid" count="1000 1000 1000" '
                  'spacing="1 1 1" dim="3"/>'),
    ("worldbody", '<composite type="cable" count="100000 1 1" prefix="c" '
                  'size="1"><geom size="0.1"/></composite>'),
    ("worldbody", '<attach model="a" body="upper" prefix="x"/>'),
    ("worldbody", '<plugin plugin="mujoco.no_such"/>'),
    ("worldbody", '<camera resolution="100000 100000"/>'),
    ("mujoco", '<include file="pipe"/>'),
    ("mujoco", '<include file="model.xml"/>'),
    ("mujoco", '<include file="no_such.xml"/>'),
    ("mujoco", '<include file="/etc/passwd"/>'),
    ("mujoco", '<include file="/dev/zero"/>'),
    ("mujoco", '<option timestep="nan"/>'),
    ("mujoco", '<option timestep="1e-12"/>'),
    ("mujoco", '<option timestep="1e9"/>'),
    ("mujoco", '<option gravity="nan 0 1e308"/>'),
    ("mujoco", '<option iterations="2000000000" tolerance="0"/>'),
    ("mujoco", '<size memory="1000G"/>'),
    ("mujoco", '<size memory="1"/>'),
    ("mujoco", '<size nuserdata="2000000000"/>'),
    ("mujoco", '<size nuser_body="100000000"/>'),
    ("mujoco", '<compiler meshdir="/no/such" texturedir="" autolimits="false"/>'),
    ("mujoco", '<compiler boundmass="nan" inertiafromgeom="true"/>'),
    ("mujoco", '<compiler eulerseq="abc"/>'),
    ("mujoco", '<default><geom size="nan"/></default>'),
    ("mujoco", '<default class="x"><default class="x"/></default>'),
    ("mujoco", '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'),
    ("custom", '<numeric name="n" size="1000000000"/>'),
    ("custom", '<text name="t" data=""/>'),
    ("sensor", '<user name="u" dim="500000000" needstage="pos"/>'),
    ("sensor", '<jointpos name="s" joint="no_such"/>'),
    ("sensor", '<clock name="c" cutoff="nan"/>'),
    ("actuator", '<motor name="a" joint="no_such"/>'),
    ("actuator", '<general name="a" joint="elbow" dyntype="integrator" actdim="99"/>'),
    ("actuator", '<position name="a" joint="elbow" kp="nan" timeconst="-1"/>'),
    ("actuator", '<position name="a" joint="elbow" kp="1e300" kv="1e300"/>'),
    ("equality", '<joint joint1="elbow" joint2="elbow"/>'),
    ("equality", '<weld body1="no_such"/>'),
    ("tendon", '<fixed name="t"><joint joint="elbow" coef="nan"/></fixed>'),
    ("tendon", '<spatial name="t"><site site="tip"/></spatial>'),
    ("keyframe", '<key name="k" qpos="1 2 3 4 5 6 7 8 9 10 11 12"/>'),
    ("keyframe", '<key name="k" qpos="nan nan" ctrl="nan"/>'),
    ("contact", '<pair geom1="upper" geom2="no_such"/>'),
    ("contact", '<exclude body1="upper" body2="upper"/>'),
    # of a URDF
    ("robot", '<link name="upper"/>'),
    ("robot", '<joint name="round" type="revolute"><parent link="lower"/>'
              '<child link="upper"/><limit lower="1" upper="-1"/></joint>'),
    ("robot", '<joint name="odd" type="planar"><parent link="lower"/></joint>'),
    ("robot", '<link name="l"><visual><geometry><mesh '
              'filename="package://no/such.stl"/></geometry></visual></link>'),
    ("robot", '<link name="l"><collision><geometry><sphere radius="nan"/>'
              "</geometry></collision></link>"),
)  # fmt: skip
_ENTITIES = "".join(
    f'<!ENTITY e{k} "{10 * f"&e{k - 1};"}">' if k else '<!ENTITY e0 "lol">'
    for k in range(10)
)
# what may stand before the root
ODD_PREFIXES = (
    f"<!DOCTYPE mujoco [{_ENTITIES}]>\n",
    '<!DOCTYPE mujoco SYSTEM "/etc/passwd">\n',
    '<?xml version="1.0" encoding="utf-16"?>\n',
    "\ufeff",
    "text\n",
    "<!-- -- -->\n",
    1_000_000 * "\n",
    "\x00",
)

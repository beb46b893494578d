"""Small robots of people who come with a log: models in, runs of them out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from selfheal.example.simulate import Run

Floats = NDArray[np.float64]
_OPTION = '<option timestep="0.002" integrator="implicitfast"/>'


@dataclass(frozen=True)
class StandingRun(Run):
    """A run of a robot whose base is free.

    Attributes:
        base: (T, 7) position of the base [m], and its quaternion w, x, y, z.
    """

    base: Floats


def make_chain(
    limits: dict[str, tuple[float, float]], drive: str, base: str = ""
) -> str:
    """MJCF of links in a row that touch nothing.

    Args:
        limits: of the joints, by their names.
        drive: of every joint, as MJCF, with {} for its name.
        base: what the first body holds: a free joint and a geom, say.
    """
    links = "".join(
        f'<body pos="{0.25 * bool(k)} 0 0"><joint name="{name}" range="{low} {high}" '
        f'axis="{int(k % 3 == 2)} {int(k % 3 != 2)} 0" damping="0.1" armature="0.01"/>'
        '<geom type="capsule" size="0.03" fromto="0 0 0 0.25 0 0" mass="0.6" '
        'contype="0" conaffinity="0"/>'
        for k, (name, (low, high)) in enumerate(limits.items())
    ) + "</body>" * len(limits)
    drives = "".join(drive.format(name, name) for name in limits)
    return f"""<mujoco><compiler angle="radian"/>{_OPTION}<worldbody><body name="base">
      {base}{links}</body></worldbody><actuator>{drives}</actuator></mujoco>"""


def make_urdf(joints: Sequence[str]) -> str:
    """URDF of links in a row, which no drive turns."""
    links, parent = '<link name="base"/>', "base"
    for k, name in enumerate(joints):
        links += f"""<link name="link{k}"><inertial><origin xyz="0.12 0 0"/>
          <mass value="0.6"/><inertia ixx="0.001" iyy="0.004" izz="0.004" ixy="0"
          ixz="0" iyz="0"/></inertial></link><joint name="{name}" type="revolute">
          <parent link="{parent}"/><child link="link{k}"/><axis xyz="0 1 0"/>
          <origin xyz="{0.25 * bool(k)} 0 0"/>
          <limit lower="-2" upper="2" effort="60" velocity="9"/></joint>"""
        parent = f"link{k}"
    return f'<robot name="arm">{links}</robot>'


def make_quadruped(joints: Sequence[str]) -> str:
    """MJCF of a trunk that is free, on four feet on the ground."""
    corners = [(x, y) for x in (0.15, -0.15) for y in (0.1, -0.1)]
    legs = "".join(
        f'<body pos="{x} {y} 0"><joint name="{name}" axis="0 1 0" range="-1.5 1.5" '
        'damping="0.1" armature="0.01"/><geom type="capsule" size="0.015" mass="0.3" '
        'fromto="0 0 0 0 0 -0.2" contype="0" conaffinity="0"/>'
        '<geom size="0.02" pos="0 0 -0.2" mass="0.05"/></body>'
        for name, (x, y) in zip(joints, corners, strict=True)
    )
    drive = '<position name="{0}" joint="{0}" kp="25" kv="1"/>'
    drives = "".join(map(drive.format, joints))
    return f"""<mujoco><compiler angle="radian"/>{_OPTION}<worldbody>
      <geom type="plane" size="5 5 .1"/><body name="trunk" pos="0 0 0.22"><freejoint/>
      <geom type="box" size=".18 .08 .04" mass="3" contype="0" conaffinity="0"/>{legs}
      </body></worldbody><actuator>{drives}</actuator></mujoco>"""


def simulate_standing(
    text: str, conceal: Callable[[mujoco.MjModel], None]
) -> list[StandingRun]:
    """Runs of a quadruped that stands and moves its legs, three of 6 s at 100 Hz."""
    model = mujoco.MjModel.from_xml_string(text)
    conceal(model)
    model.opt.timestep /= 2
    time, found = np.arange(600) / 100, list[StandingRun]()
    for number in range(3):
        rng, data = np.random.default_rng(number), mujoco.MjData(model)
        rates, phases = rng.uniform(0.3, 1.2, 4), rng.uniform(0, 6, 4)
        wave = np.sin(2 * np.pi * np.outer(time, rates) + phases)
        goal = 0.15 * wave * np.minimum(time, 1)[:, None]
        position = np.empty((time.size, model.nq))
        velocity = np.empty((time.size, model.nv))
        for k, command in enumerate(goal):
            while data.time < 1 + time[k] - 1e-9:  # it stands after a second
                mujoco.mj_step(model, data)
            position[k], velocity[k] = data.qpos, data.qvel
            data.ctrl[:] = command
        found.append(
            StandingRun(time, goal, position[:, 7:], velocity[:, 6:], position[:, :7])
        )
    return found

"""What several tests start from: a small recording, and the real ones."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from selfheal.recording import Episode, Recording, Signal, write
from tests.support.paths import RECORDINGS

# a film takes seconds; who tests one takes `renderer`
os.environ["MUJOCO_GL"] = "disable"


@pytest.fixture
def renderer(monkeypatch) -> None:
    """What the page renders is rendered."""
    monkeypatch.delenv("MUJOCO_GL")


@pytest.fixture(scope="session")
def shared_recordings() -> Path:
    """The folder of real recordings, which stands beside the repository."""
    if not RECORDINGS.is_dir():
        pytest.skip(f"no real recordings at {RECORDINGS}")
    return RECORDINGS


@pytest.fixture(scope="session")
def walker() -> np.ndarray:
    """Weights with which the whole quadruped walks."""
    from tests.support.short_recover import find_walker

    return find_walker()


@pytest.fixture(scope="module")
def short_heal() -> Iterator[None]:
    """Searches of a heal that take a second, from a gait that walks."""
    from tests.support.short_heal import shorten

    with pytest.MonkeyPatch.context() as patch:
        shorten(patch.setattr)
        yield


@pytest.fixture(scope="session")
def walks() -> tuple[Recording, Recording]:
    """Recordings of 40 s of walking: whole, and breaking after 25 s."""
    from tests.support.short_heal import record_walks

    return record_walks()


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in every test."""
    return np.random.default_rng(7)


@pytest.fixture
def recording() -> Recording:
    """Two episodes of an arm on a cart with every kind of signal."""
    return Recording(
        {"zeta": _episode(12, qpos0=np.array([0.1, -0.0])), "alpha": _episode(5)},
        robot="arm on a cart",
        source="made up",
        file="arm.h5",
    )


def _episode(samples: int, qpos0: np.ndarray | None = None) -> Episode:
    rng = np.random.default_rng(samples)
    kinds = {
        "cart_position": ("joint_position", "cart", "m", ()),
        "arm_position": ("joint_position", "arm", "rad", ()),
        "arm_velocity": ("joint_velocity", "arm", "rad/s", ()),
        "arm_torque": ("joint_torque", "motor", "N m", ()),
        "tip_position": ("body_position", "tip", "m", (3,)),
        "tip_orientation": ("body_orientation", "tip", "quaternion", (4,)),
        "tip_speed": ("body_linear_velocity", "tip", "m/s", (3,)),
        "tip_turn": ("body_angular_velocity", "tip", "rad/s", (3,)),
        "up": ("sensor", "up", "1", (3,)),
        "voltage": ("supply_voltage", "", "V", ()),
        "heat": ("temperature", "motor", "degC", ()),
    }
    signals = {}
    for name, (kind, target, unit, width) in kinds.items():
        values = rng.normal(size=(samples, *width))
        if kind == "body_orientation":
            values /= np.linalg.norm(values, axis=1, keepdims=True)
        values[1] = np.nan
        signals[name] = Signal(values, kind, target, unit)
    return Episode(
        np.cumsum(rng.uniform(0.001, 0.1, samples)),
        rng.normal(size=(samples, 2)),
        ("motor", "pusher"),
        signals,
        qpos0=qpos0,
        qvel0=None if qpos0 is None else np.zeros(2),
        motion="wave",
    )


@pytest.fixture
def file(recording, tmp_path) -> Path:
    """That recording on disk."""
    path = tmp_path / "arm.h5"
    write(recording, path)
    return path


@pytest.fixture
def model(tmp_path) -> Path:
    """The MJCF of that arm."""
    path = tmp_path / "arm.xml"
    path.write_text(
        """
        <mujoco>
          <worldbody>
            <body name="base">
              <joint name="cart" type="slide" axis="1 0 0"/>
              <geom size="0.1" mass="1"/>
              <body name="tip">
                <joint name="arm" type="hinge"/>
                <geom size="0.1" pos="0 0 1" mass="1"/>
                <site name="tip"/>
              </body>
            </body>
          </worldbody>
          <actuator>
            <motor name="motor" joint="arm"/>
            <motor name="pusher" joint="cart"/>
          </actuator>
          <sensor>
            <framezaxis name="up" objtype="site" objname="tip"/>
            <jointpos name="angle" joint="arm"/>
          </sensor>
        </mujoco>
        """
    )
    return path

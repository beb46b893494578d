"""What the hidden robot's sensors say: takes runs, gives a recording with noise."""

from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from benchmarks.sealed.hidden_robot import SensorModel
from benchmarks.sealed.mjcf import Robot
from benchmarks.sealed.simulator import MotionPlan, Rollout
from selfheal.recording import Episode, Recording, Signal, find_output

Rng = np.random.Generator


@dataclass(frozen=True)
class Noise:
    """What disturbs a recording.

    Attributes:
        position: [rad or m] standard deviation of joint positions.
        velocity: [rad/s or m/s] of joint velocities.
        torque: [1] of actuator forces, as a share of the joint's typical load.
        place: [m] of body positions.
        turn: [rad] of body orientations.
        memory: correlation of a sample's noise with the one before; 0 is white.
        lattice: [rad or m] encoder step below the noise, 0: none.
        dropout: share of samples missing.
    """

    position: float
    velocity: float
    torque: float
    place: float
    turn: float
    memory: float
    lattice: float
    dropout: float


@dataclass(frozen=True)
class SensorSet:
    """Which signals are recorded, and what is said of the start.

    Attributes:
        velocity: joint velocities too.
        torque: actuator forces too.
        state: episodes state qpos0 and qvel0.
        epoch: [s] time of the first sample.
    """

    velocity: bool
    torque: bool
    state: bool
    epoch: float


def draw_noise(rng: Rng) -> Noise:
    """Noise of one case; chosen: that of good to middling encoders and cameras."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    position = between(3e-4, 1.5e-3)
    colored, coarse, gaps = rng.random(3)
    return Noise(
        position,
        between(5e-3, 4e-2),
        between(0.01, 0.04),
        between(4e-4, 1.5e-3),
        between(2e-3, 6e-3),
        float(rng.uniform(0.5, 0.95)) if colored < 0.35 else 0.0,
        position if coarse < 0.2 else 0.0,
        float(rng.uniform(0.005, 0.05)) if gaps < 0.3 else 0.0,
    )


def draw_sensors(robot: Robot, rng: Rng) -> SensorSet:
    """Which signals one case has, and what is said of the start."""
    velocity, torque, state, epoch = rng.random(4)
    return SensorSet(
        bool(robot.joints) and velocity < 0.35,
        bool(robot.actuators) and torque < 0.3,
        bool(state < 0.5),
        round(float(rng.uniform(0, 60)), 3) if epoch < 0.3 else 0.0,
    )


def draw_disturbance(shape: tuple[int, ...], memory: float, rng: Rng) -> np.ndarray:
    """Noise of unit variance, AR(1) along the first axis where it is correlated.

    Args:
        shape: of the result, samples first.
        memory: correlation of a sample with the one before, 0: white.
        rng: draws it.
    """
    noise = rng.normal(size=shape)
    if not memory:
        return noise
    for i in range(1, len(noise)):
        noise[i] = memory * noise[i - 1] + np.sqrt(1 - memory**2) * noise[i]
    return noise


@dataclass(frozen=True)
class Instruments:
    """Turns runs into recordings.

    Attributes:
        robot: of the runs.
        readings: measurement effects, by signal.
        noise: that disturbs them.
        sensors: which signals there are.
    """

    robot: Robot
    readings: dict[str, SensorModel]
    noise: Noise
    sensors: SensorSet

    def read_clean(self, run: Rollout) -> dict[str, Signal]:
        """Every signal, measurement effects included, noise not."""
        model = mujoco.MjModel.from_xml_string(self.robot.xml)
        signals: dict[str, Signal] = {}
        for name in self.robot.joints:
            self._read_joint(signals, model.joint(name), run)
        if self.sensors.torque:
            for name, joint in self.robot.actuators.items():
                unit = "N" if _is_slide(model.joint(joint)) else "N m"
                force = run.force[:, find_output(model, model.actuator(name).id)]
                torque = Signal(force.copy(), "joint_torque", name, unit)
                signals[f"{name}_torque"] = torque
        if body := self.robot.free:
            place, turn = run.qpos[:, :3].copy(), run.qpos[:, 3:7].copy()
            signals[f"{body}_position"] = Signal(place, "body_position", body, "m")
            signals[f"{body}_orientation"] = Signal(
                turn, "body_orientation", body, "quaternion"
            )
        return signals

    def _read_joint(self, signals: dict[str, Signal], joint: Any, run: Rollout) -> None:
        name, unit = joint.name, "m" if _is_slide(joint) else "rad"
        reading = self.readings.get(f"{name}_position", SensorModel())
        delay = round(reading.delay / self.robot.fine)
        true = (run.late[delay] if delay else run.qpos)[:, joint.qposadr[0]]
        values = reading.gain * true + reading.bias
        signals[f"{name}_position"] = Signal(values, "joint_position", name, unit)
        if self.sensors.velocity:
            speed = run.qvel[:, joint.dofadr[0]].copy()
            signals[f"{name}_velocity"] = Signal(
                speed, "joint_velocity", name, f"{unit}/s"
            )

    def find_sigma(self, signal: Signal) -> float:
        """Standard deviation of a signal's noise."""
        noise = self.noise
        if signal.kind == "joint_torque":
            return noise.torque * self.robot.load[self.robot.actuators[signal.target]]
        return {
            "joint_position": noise.position,
            "joint_velocity": noise.velocity,
            "body_position": noise.place,
            "body_orientation": noise.turn,
        }[signal.kind]

    def add_noise(self, name: str, signal: Signal, rng: Rng) -> Signal:
        """The signal as recorded."""
        values = signal.values
        size = self.find_sigma(signal)
        if signal.kind == "body_orientation":
            error = draw_disturbance((len(values), 3), self.noise.memory, rng) * size
            pairs = zip(values, error, strict=True)
            values = np.array([_turn_quaternion(q, e) for q, e in pairs])
        else:
            values = values + size * draw_disturbance(
                values.shape, self.noise.memory, rng
            )
        step = self.readings.get(name, SensorModel()).step
        if signal.kind == "joint_position" and (step := step or self.noise.lattice):
            values = np.round(values / step) * step
        if self.noise.dropout:
            values = values.copy()
            values[rng.random(len(values)) < self.noise.dropout] = np.nan
        return Signal(values, signal.kind, signal.target, signal.unit)

    def record_episode(
        self, plan: MotionPlan, run: Rollout, rng: Rng, *, state: bool
    ) -> Episode:
        """One episode as recorded."""
        signals = {
            name: self.add_noise(name, signal, rng)
            for name, signal in self.read_clean(run).items()
        }
        return Episode(
            np.round(self.sensors.epoch + run.rows * self.robot.fine, 9),
            run.ctrl,
            tuple(self.robot.actuators),
            signals,
            run.qpos[0].copy() if state else None,
            run.qvel[0].copy() if state else None,
            plan.motion,
        )

    def record_episodes(self, plans, runs, rng: Rng, *, state: bool) -> Recording:
        """All episodes as a file."""
        made = [
            self.record_episode(plan, run, rng, state=state)
            for plan, run in zip(plans, runs, strict=True)
        ]
        episodes = {f"{i:03d}": episode for i, episode in enumerate(made)}
        return Recording(episodes, robot=self.robot.name, file="recording.h5")

    def describe(self) -> dict[str, Any]:
        """What the key says of it."""
        return {"noise": asdict(self.noise), "sensors": asdict(self.sensors)}


def _is_slide(joint: Any) -> bool:
    return joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE


def _turn_quaternion(quaternion: np.ndarray, error: np.ndarray) -> np.ndarray:
    turned = quaternion.copy()
    mujoco.mju_quatIntegrate(turned, error, 1.0)
    return turned


def cut_segments(recording: Recording, runs, seconds: float) -> Recording:
    """Cut every episode into segments that state where they start.

    Args:
        recording: that is cut.
        runs: rollouts behind its episodes, which know the states.
        seconds: [s] of a segment.
    """
    cut: dict[str, Episode] = {}
    for (name, episode), run in zip(recording.episodes.items(), runs, strict=True):
        since = episode.time - episode.time[0]
        for k in range(int(since[-1] / seconds + 1e-6)):
            at = (since >= k * seconds) & (since < (k + 1) * seconds)
            cut[f"{name}_{k}"] = _cut_segment(episode, run, at)
    return Recording(cut, robot=recording.robot, file=recording.file)


def _cut_segment(episode: Episode, run: Rollout, at: np.ndarray) -> Episode:
    first = int(np.argmax(at))
    signals = {
        name: Signal(s.values[at], s.kind, s.target, s.unit)
        for name, s in episode.signals.items()
    }
    return Episode(
        episode.time[at],
        episode.ctrl[at],
        episode.ctrl_names,
        signals,
        run.qpos[first].copy(),
        run.qvel[first].copy(),
        episode.motion,
    )

"""What the hidden robot's sensors say: takes runs, gives a recording with noise."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from benchmarks.hidden.robots.robot import Rng, Robot
from benchmarks.hidden.simulator import MotionPlan, Rollout, Simulator
from benchmarks.hidden.truth import HiddenRobot, SensorModel
from benchmarks.recordings import select_rows
from selfheal.recording import Episode, Recording, Signal, find_output


@dataclass(frozen=True)
class Sensor:
    """What one signal is.

    Attributes:
        noise: its standard deviation; [rad] of an orientation.
        step: of an encoder, 0: none.
        repeats: whether a torque that is reported is the one commanded.
    """

    kind: str
    target: str
    unit: str
    noise: float
    step: float = 0.0
    repeats: bool = False


Sensors = Mapping[str, Sensor]
# [s] before and after a segment's start, in which commands should change little
BEFORE, AFTER = 0.06, 0.04


def measure_joints(
    robot: Robot, joints: Iterable[str], noise: float, speed: float = 0.0
) -> dict[str, Sensor]:
    """Signals of positions, and of velocities where they have noise.

    Args:
        noise: [rad or m] of the positions.
        speed: [rad/s or m/s] of the velocities, 0: not measured.
    """
    found = {}
    for joint in joints:
        unit = "m" if robot.is_slide(joint) else "rad"
        found[f"{joint}_position"] = Sensor("joint_position", joint, unit, noise)
        if speed:
            found[f"{joint}_velocity"] = Sensor(
                "joint_velocity", joint, f"{unit}/s", speed
            )
    return found


def measure_torque(robot: Robot, joint: str, noise: float) -> Sensor:
    """The torque of what moves a joint, with noise [N m or N]."""
    unit = "N" if robot.is_slide(joint) else "N m"
    return Sensor("joint_torque", robot.find_actuator(joint), unit, noise)


def measure_pose(body: str, place: float, turn: float) -> dict[str, Sensor]:
    """A camera's two signals of a body, with noise [m] and [rad]."""
    return {
        f"{body}_position": Sensor("body_position", body, "m", place),
        f"{body}_orientation": Sensor("body_orientation", body, "quaternion", turn),
    }


def draw_disturbance(shape: tuple[int, ...], memory: float, rng: Rng) -> np.ndarray:
    """Noise of unit variance, AR(1) along the first axis where it is correlated.

    Args:
        memory: correlation of a sample with the one before, 0: white.
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
        memory: correlation of a sample's noise with the one before; 0 is white.
        dropout: share of samples missing.
        epoch: [s] time of the first sample.
        readings: measurement effects, by signal.
    """

    robot: Robot
    sensors: Sensors
    memory: float = 0.0
    dropout: float = 0.0
    epoch: float = 0.0
    readings: Mapping[str, SensorModel] = field(default_factory=dict)

    def silence(self) -> "Instruments":
        """The same without noise, encoder steps and missing samples."""
        sensors = {n: replace(s, noise=0.0, step=0.0) for n, s in self.sensors.items()}
        return replace(self, sensors=sensors, dropout=0.0)

    def read_clean(self, run: Rollout, model: mujoco.MjModel) -> dict[str, Signal]:
        """Every signal, measurement effects included, noise not."""
        found = {}
        for name, sensor in self.sensors.items():
            reading = self.readings.get(name, SensorModel())
            true = self._read_true(sensor, reading, run, model)
            values = reading.gain * true + np.asarray(reading.bias)
            found[name] = Signal(values, sensor.kind, sensor.target, sensor.unit)
        return found

    def _read_true(
        self, sensor: Sensor, reading: SensorModel, run: Rollout, hidden: mujoco.MjModel
    ) -> np.ndarray:
        model, target = self.robot.model, sensor.target
        if sensor.kind == "joint_position":
            delay = round(reading.delay / self.robot.fine)
            qpos = run.late[delay] if delay else run.qpos
            return qpos[:, model.joint(target).qposadr[0]]
        if sensor.kind == "joint_velocity":
            return run.qvel[:, model.joint(target).dofadr[0]]
        if sensor.kind == "joint_torque":
            number = model.actuator(target).id
            if sensor.repeats:
                return run.ctrl[:, number]
            return run.force[:, find_output(model, number)]
        if target == self.robot.free:
            pose = run.qpos[:, :7]
            return pose[:, :3] if sensor.kind == "body_position" else pose[:, 3:]
        return _read_state(sensor, run, hidden)

    def add_noise(self, name: str, signal: Signal, rng: Rng) -> Signal:
        """The signal as recorded."""
        values, sensor = signal.values, self.sensors[name]
        if signal.kind == "body_orientation":
            error = draw_disturbance((len(values), 3), self.memory, rng) * sensor.noise
            pairs = zip(values, error, strict=True)
            values = np.array([_turn_quaternion(q, e) for q, e in pairs])
        else:
            noise = draw_disturbance(values.shape, self.memory, rng)
            values = values + sensor.noise * noise
        if step := self.readings.get(name, SensorModel()).step or sensor.step:
            values = np.round(values / step) * step
        if self.dropout:
            values = values.copy()
            values[rng.random(len(values)) < self.dropout] = np.nan
        return replace(signal, values=values)

    def record_episode(
        self, plan: MotionPlan, run: Rollout, clean, rng: Rng, *, state: bool
    ) -> Episode:
        """One episode as recorded."""
        return Episode(
            np.round(self.epoch + run.rows * self.robot.fine, 9),
            run.ctrl,
            tuple(self.robot.actuators),
            {name: self.add_noise(name, signal, rng) for name, signal in clean.items()},
            run.qpos[0].copy() if state else None,
            run.qvel[0].copy() if state else None,
            plan.motion,
        )


def _read_state(sensor: Sensor, run: Rollout, model: mujoco.MjModel) -> np.ndarray:
    """What a body's pose or a sensor of the model is in the hidden robot's states."""
    data, found = mujoco.MjData(model), []
    for state, ctrl in zip(run.whole, run.ctrl, strict=True):
        data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq :]
        data.ctrl[:] = ctrl
        mujoco.mj_forward(model, data)
        if sensor.kind == "body_position":
            value = data.body(sensor.target).xpos
        elif sensor.kind == "body_orientation":
            value = data.body(sensor.target).xquat
        else:
            value = data.sensor(sensor.target).data
        found.append(value.copy() if len(value) > 1 else value[0])
    return np.array(found)


def _turn_quaternion(quaternion: np.ndarray, error: np.ndarray) -> np.ndarray:
    turned = quaternion.copy()
    mujoco.mju_quatIntegrate(turned, error, 1.0)
    return turned


@dataclass(frozen=True)
class Record:
    """A recording, with what is known of it.

    Attributes:
        clean: the same without noise.
        runs: the rollouts behind its episodes.
    """

    seen: Recording
    clean: Recording
    runs: list[Rollout]

    def cut(self, seconds: float, calm: float = 0.0) -> "Record":
        """Every episode in segments that state where they start.

        Args:
            seconds: [s] of a segment; 0: whole episodes.
            calm: [s] in which the next segment begins, where commands change least:
                what was commanded before a segment is not known to who predicts it.
        """
        if not seconds:
            return self
        seen, clean = dict[str, Episode](), dict[str, Episode]()
        for (name, one), run in zip(self.seen.episodes.items(), self.runs, strict=True):
            for k, at in enumerate(_list_segments(one, seconds, calm)):
                seen[f"{name}_{k}"] = _cut_segment(one, run, at)
                whole = self.clean.episodes[name]
                clean[f"{name}_{k}"] = _cut_segment(whole, run, at)
        return replace(
            self,
            seen=replace(self.seen, episodes=seen),
            clean=replace(self.clean, episodes=clean),
        )


def _list_segments(
    episode: Episode, seconds: float, calm: float
) -> Iterator[np.ndarray]:
    """Which samples (T) each segment has; a shorter episode is one segment."""
    since, start = episode.time - episode.time[0], 0.0
    seconds = min(seconds, since[-1])
    while start + seconds <= since[-1] + 1e-6:
        yield (since >= start) & (since < start + seconds)
        start += seconds
        soon = np.flatnonzero((since >= start - 1e-9) & (since <= start + calm))
        if calm and len(soon):
            start = since[min(soon, key=lambda i: _measure_change(episode, int(i)))]


def _measure_change(episode: Episode, at: int) -> float:
    """How much the commands moved just around a sample, over their spread."""
    now, ctrl = episode.time[at], episode.ctrl
    rows = slice(*np.searchsorted(episode.time, [now - BEFORE, now + AFTER]))
    moved = np.abs(ctrl[rows] - ctrl[at]) / (ctrl.std(0) + 1e-12)
    return float(moved.sum(1).max()) if ctrl.size else 0.0


def record_plans(
    instruments: Instruments,
    truth: HiddenRobot,
    plans: Iterable[MotionPlan],
    rng: Rng,
    *,
    state: bool,
    check: Callable[[Rollout], None] = lambda run: None,
) -> Record:
    """Simulate and record plans, one after the other.

    Args:
        plans: may be drawn, by the same generator, as they are asked for.
        check: raises `UnfitDraw` where a rollout makes no case.

    Raises:
        UnfitDraw: the simulation diverged.
    """
    simulator = Simulator(truth)
    instruments = replace(instruments, readings=truth.readings)
    silent, none, runs = instruments.silence(), np.random.default_rng(0), []
    seen, clean = dict[str, Episode](), dict[str, Episode]()
    for k, plan in enumerate(plans):
        run = simulator.run(plan)
        check(run)
        signals = instruments.read_clean(run, simulator.compiled)
        args = plan, run, signals
        seen[f"{k:03d}"] = instruments.record_episode(*args, rng, state=state)
        clean[f"{k:03d}"] = silent.record_episode(*args, none, state=state)
        runs.append(run)
    head = {"robot": truth.robot.name, "file": "recording.h5"}
    return Record(Recording(seen, **head), Recording(clean, **head), runs)


def _cut_segment(episode: Episode, run: Rollout, at: np.ndarray) -> Episode:
    first = int(np.argmax(at))
    state = {"qpos0": run.qpos[first].copy(), "qvel0": run.qvel[first].copy()}
    return replace(select_rows(episode, at), **state)

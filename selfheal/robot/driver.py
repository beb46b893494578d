"""Real robots: a Python class that moves one and reads its sensors in, a Robot out."""

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from ..body.body import Anatomy, Bodies, Floats
from ..engine.walk import PERIOD
from ..errors import InputError
from ..files import check_file
from ..printable import join_names, quote_name
from ..recording import Episode, Recording, Signal
from .read_channels import list_signals_over_time
from .rest_readings import make_rest_episode, name_signal_of


class Driver(Protocol):
    """What moves a real robot."""

    def move(self, targets: Mapping[str, float]) -> None:
        """Go from all joints at zero to targets [rad], and come to rest."""
        ...

    def read(self) -> Mapping[str, object]:
        """By signal, what the sensors say now; see docs/any-robot.md."""
        ...


@dataclass(frozen=True)
class DrivenByClass:
    """A real robot behind a Python class; see `base.Robot` for the attributes."""

    name: str
    anatomy: Anatomy
    actions: Floats
    driver: Driver
    truth: Bodies | None = None

    def act(self, action: int) -> Recording:
        """Move, and read the sensors.

        Raises:
            InputError: the class does not give what its sensors need.
        """
        target, joints = self.actions[action], self.anatomy.joints
        self.driver.move(dict(zip(joints, target.tolist(), strict=True)))
        said, found = self.driver.read(), {}
        for sensor in self.anatomy.sensors:
            signal = name_signal_of(sensor, self.anatomy)
            if signal not in said:
                raise InputError(
                    f"{self.name}: read() gave no {quote_name(signal)}, for the sensor "
                    f"{sensor}; it gave {join_names(sorted(map(str, said))) or 'none'}"
                )
            try:
                found[sensor] = np.asarray(said[signal], float)
            except (TypeError, ValueError) as error:
                raise InputError(
                    f"{self.name}: read() gave no numbers for {quote_name(signal)}"
                ) from error
        episode = make_rest_episode(self.anatomy, np.arange(3.0), target, found)
        return Recording(
            {f"action_{action:03d}": episode}, self.name, "driver", file=self.name
        )


@dataclass(frozen=True)
class FollowsByClass(DrivenByClass):
    """A real robot whose class can also follow commands over time; see `base.Mover`."""

    def move(self, commands: Floats, *, trial: int = 0) -> Recording:
        """Follow joint commands (T, P) [rad], and read meanwhile; see `base.Mover`.

        Raises:
            InputError: the class does not give what was read, and when.
        """
        joints = self.anatomy.joints
        targets = dict(zip(joints, commands.T.tolist(), strict=True))
        said = self.driver.follow(targets, PERIOD)  # type: ignore[attr-defined]
        kinds = list_signals_over_time(self.anatomy)
        if "time" not in said or not kinds.keys() & said.keys():
            gave = join_names(sorted(map(str, said)))
            fits = f"time, and some of {join_names(kinds)}"
            raise InputError(f"{self.name}: follow() gave {gave}; would fit: {fits}")
        try:
            read = {name: np.asarray(said[name], float) for name in said}
            time = read.pop("time")
            # a command stands at its own time, between samples too
            sent = np.arange(len(commands)) * PERIOD
            every = np.union1d(sent, time)
            at = np.searchsorted(every, time)
            signals = {}
            for name in kinds.keys() & read.keys():
                values = np.full((len(every), *read[name].shape[1:]), np.nan)
                values[at] = read[name]
                signals[name] = Signal(values, *kinds[name])
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{self.name}: follow() gave no arrays of one length: {error}"
            ) from error
        held = np.searchsorted(sent, every, side="right") - 1
        servos = tuple(f"{joint}_servo" for joint in joints)
        episode = Episode(every, commands[np.maximum(held, 0)], servos, signals)
        return Recording({"move": episode}, self.name, "driver", file=self.name)


def drive_by_class(
    path: str, anatomy: Anatomy, actions: Floats, driver: str, truth: Bodies | None
) -> DrivenByClass:
    """The robot behind a class, which follows commands over time if that does.

    Args:
        anatomy: what is known of its parts.
        actions: (A, P) joint targets that it offers [rad].
        truth: its body, None if nobody knows it.

    Raises:
        InputError: there is no such file or class, or a method is missing.
    """
    made = _load_driver(path, driver)
    kind = FollowsByClass if callable(getattr(made, "follow", None)) else DrivenByClass
    return kind(path, anatomy, actions, made, truth)


def _load_driver(path: str, driver: str) -> Driver:
    """The object of a class that moves a robot.

    Raises:
        InputError: there is no such file or class, or a method is missing.
    """
    file, _, name = driver.rpartition(":")
    place = Path(path).parent / file
    check_file(place)
    spec = importlib.util.spec_from_file_location(place.stem, place)
    if spec is None or spec.loader is None:
        raise InputError(f"{place}: no Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        made: Driver = getattr(module, name)()
    except Exception as error:  # of the user's own code
        said = f"{type(error).__name__}: {error}"
        raise InputError(f"{path}: driver {driver} cannot be made: {said}") from error
    for method in ("move", "read"):
        if not callable(getattr(made, method, None)):
            raise InputError(f"{place}: class {name} has no method {method}()")
    return made

"""Robots that answer from a recording: its file in, a Robot with its actions out."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..body.body import Anatomy, Bodies, Floats
from ..errors import InputError
from ..recording import Recording, find_single_columns, read
from .actions import load_published_body
from .rest_readings import read_rest_channels


@dataclass(frozen=True)
class ReplayRobot:
    """Answers an action with the episode that holds it; see `base.Robot`.

    Attributes:
        actions: (A, P) joint targets that the recording holds [rad].
        episodes: name of the episode of each action.
    """

    name: str
    anatomy: Anatomy
    actions: Floats
    truth: Bodies | None
    recording: Recording
    episodes: tuple[str, ...]

    def act(self, action: int) -> Recording:
        """The recording, cut to the action's episode."""
        name = self.episodes[action]
        return replace(self.recording, episodes={name: self.recording.episodes[name]})


def replay(
    name: str, recording: Recording, anatomy: Anatomy, truth: Bodies | None
) -> ReplayRobot:
    """A robot that offers the actions of a recording, each once.

    Args:
        recording: an episode an action; the last row of its ctrl is the target.
        truth: its body, None if nobody knows it.

    Raises:
        RecordingError: an episode has no command of a servo, or no reading of the
            sensors at its last sample.
    """
    servos = [f"{joint}_servo" for joint in anatomy.joints]
    actions: dict[bytes, tuple[Floats, str]] = {}
    for key, episode in recording.episodes.items():
        where = f"{recording.file}, episode {key!r}"
        read_rest_channels(replace(recording, episodes={key: episode}), anatomy)
        columns = find_single_columns(episode.ctrl_names, servos, where)
        target = episode.ctrl[-1, columns]
        actions.setdefault(np.round(target, 6).tobytes(), (target, key))
    targets, episodes = zip(*actions.values(), strict=True)
    return ReplayRobot(name, anatomy, np.array(targets), truth, recording, episodes)


def starfish_2006(argument: str, seed: int, recordings: Path | None) -> ReplayRobot:
    """The physical robot of 2006, answering from --recordings intact.h5."""
    if argument:
        raise InputError(
            f"robot 'starfish-2006' takes no argument, so not {argument!r}"
        )
    if recordings is None:
        raise InputError(
            "robot 'starfish-2006' answers from its readings; give their file, "
            "as in --recordings intact.h5"
        )
    truth = load_published_body()
    return replay("starfish-2006", read(recordings), truth.anatomy, truth)

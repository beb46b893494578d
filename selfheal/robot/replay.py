"""Robots that answer from a recording: its file in, a Robot offering its actions out."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..body.body import Anatomy, Bodies, Floats
from ..errors import InputError, RecordingError
from ..recording import Recording, read
from .actions import published


@dataclass(frozen=True)
class ReplayRobot:
    """Answers an action with the episode that holds it; see `base.Robot`."""

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


def replay(name: str, recording: Recording, truth: Bodies) -> ReplayRobot:
    """A robot that offers the actions of a recording, each once.

    Args:
        name: of the robot.
        recording: an episode an action; the last row of its ctrl is the target.
        truth: gives the anatomy.

    Raises:
        RecordingError: an episode lacks a servo of the anatomy or the signal vertical.
    """
    servos = [f"{joint}_servo" for joint in truth.anatomy.joints]
    actions: dict[bytes, tuple[Floats, str]] = {}
    for key, episode in recording.episodes.items():
        missing = sorted(set(servos) - set(episode.ctrl_names))
        if missing:
            raise RecordingError(
                f"{recording.file}, episode {key!r}: ctrl lacks {', '.join(missing)}"
            )
        if "vertical" not in episode.signals:
            raise RecordingError(
                f"{recording.file}, episode {key!r}: no signal 'vertical' (the two tilts)"
                f"; it has: {', '.join(sorted(episode.signals)) or 'none'}"
            )
        columns = [episode.ctrl_names.index(s) for s in servos]
        target = np.asarray(episode.ctrl[-1, columns], float)
        actions.setdefault(np.round(target, 6).tobytes(), (target, key))
    targets, episodes = zip(*actions.values(), strict=True)
    return ReplayRobot(
        name, truth.anatomy, np.array(targets), truth, recording, episodes
    )


def starfish_2006(argument: str, seed: int, recordings: Path | None) -> ReplayRobot:
    """The physical robot of 2006, answering from --recordings intact.h5."""
    if argument:
        raise InputError(f"robot 'starfish-2006' takes no argument, so not {argument!r}")
    if recordings is None:
        raise InputError(
            "robot 'starfish-2006' answers from its readings; give their file, "
            "as in --recordings intact.h5"
        )
    return replay("starfish-2006", read(recordings), published())

"""What the name of a column says: kind, unit and whose it is."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ..units import find_unit

# words of names of columns, topics and fields, as ROS messages, LeRobot, robomimic,
# Unitree's SDK, servo and PLC tools write them; a later kind wins over an earlier one
_WORDS: Mapping[str, tuple[str, ...]] = {
    "joint_position": (
        "position", "positions", "pos", "qpos", "q", "angle", "angles", "theta",
        "state", "dof", "encoder", "enc", "sensor", "measured", "actual", "present",
        "joint", "joints", "data", "feedback",
    ),
    "joint_velocity": (
        "velocity", "velocities", "vel", "qvel", "dq", "qd", "speed", "omega",
        "qdot", "dtheta", "rpm",
    ),
    "joint_torque": (
        "effort", "efforts", "torque", "torques", "tau", "force", "load", "current",
        "tauest",
    ),
    "supply_voltage": ("voltage", "volt", "volts", "vbat", "battery", "vbus", "vin"),
    "temperature": ("temperature", "temp", "temperatures"),
    "command": (
        "command", "commands", "cmd", "action", "actions", "target", "targets", "goal",
        "des", "desired", "ref", "reference", "setpoint", "ctrl", "control", "u",
        "commanded", "demand", "sp", "input", "output", "points",
    ),
}  # fmt: skip
# more that a word is worth where it leaves little doubt; chosen
_WEIGHTS = {"state": 0.3, "dof": 0.3, "actual": 0.3, "measured": 0.3, "present": 0.3,
            "velocities": 1.4, "torques": 1.4, "efforts": 1.4,
            "joint": 0.2, "joints": 0.2, "data": 0.1,
            "sensor": 0.3, "input": 0.5, "force": 0.7, "current": 0.9, "load": 0.9,
            "u": 0.8, "q": 0.9, "feedback": 0.3,
            # of ros2_control, the nearer to the drive the more
            "output": 1.3, "reference": 1.2, "points": 1.1,
            "command": 2.0, "commands": 2.0,
            "cmd": 2.0, "action": 2.0, "actions": 2.0, "target": 1.6, "targets": 1.6,
            "goal": 2.0, "des": 2.0, "desired": 2.0, "setpoint": 2.0, "ctrl": 2.0,
            "commanded": 2.0, "effort": 1.4, "velocity": 1.4,
            "torque": 1.4}  # fmt: skip
# what stands beside the name of a joint and is no part of it
FILLERS = frozenset(
    word for words in _WORDS.values() for word in words
) | {"motor", "servo", "act", "actuator", "link", "axis", "observation", "main",
     "rad", "deg", "header", "stamp", "x", "y", "z", "w"}  # fmt: skip
# of a column that is computed from a command and its reading
DIFFERENCES = frozenset({"error", "errors", "err"})
_SHARED = 0.8  # what a shared name says beside an own one; chosen
_SPLIT = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_TRAILING_UNIT = re.compile(r"[ _]*[(\[]([^)\]]*)[)\]]\s*$")


@dataclass(frozen=True)
class NameFacts:
    """What the name of a column says.

    Attributes:
        tokens: its words and numbers in lower case, those of its stream before them.
        own: those of the column alone.
        unit: that it states; "" if none.
    """

    tokens: tuple[str, ...]
    own: tuple[str, ...]
    unit: str


def read_name(stream: str, column: str) -> NameFacts:
    """Take the name of a column apart."""
    unit, name = "", column
    match = _TRAILING_UNIT.search(column)
    if match and find_unit(match[1]) and not match[1].isdigit():
        unit, name = match[1], column[: match.start()]
    own = split_words(name)
    if not unit and len(own) > 1:
        # "q1_deg", "time_ms"; one letter may be anything
        last = own[-1]
        if len(last) > 1 and find_unit(last):
            unit, own = last, own[:-1]
    return NameFacts((*split_words(stream), *own), own, unit)


def split_words(name: str) -> tuple[str, ...]:
    """Words and numbers of a name, in lower case: "LeftHip_pos[3]" has four."""
    return tuple(word.lower() for word in _SPLIT.findall(name))


def score_kinds(facts: NameFacts) -> dict[str, float]:
    """How much the words of a name speak for each kind; 0 where none does."""
    scores = dict.fromkeys(_WORDS, 0.0)
    for kind, words in _WORDS.items():
        for tokens, weight in ((facts.own, 1.0), (facts.tokens, 0.5)):
            scores[kind] += weight * max(
                (_WEIGHTS.get(t, 1.0) for t in tokens if t in words), default=0.0
            )
    unit = find_unit(facts.unit) if facts.unit else None
    if unit is not None:
        by_unit = {"rad/s": "joint_velocity", "m/s": "joint_velocity",
                   "N m": "joint_torque", "N": "joint_torque",
                   "V": "supply_voltage", "degC": "temperature"}  # fmt: skip
        if unit.si in by_unit:
            scores[by_unit[unit.si]] += 1.0
        elif unit.si in ("rad", "m"):
            scores["joint_position"] += 0.5
    return scores


def score_names(facts: NameFacts, name: str, aliases: Iterable[str] = ()) -> float:
    """How much of a name of the model a column's name repeats, 0 to 1.

    Args:
        aliases: names that several things in the model may share.
    """
    shared = max((_score_name(facts, alias) for alias in aliases), default=0.0)
    return max(_score_name(facts, name), _SHARED * shared)


def _score_name(facts: NameFacts, name: str) -> float:
    wanted = split_words(name)
    if _contains(facts.own, wanted):
        return 1.0
    bare = tuple(word for word in wanted if word not in FILLERS)
    if all(word.isdigit() for word in bare):  # "data[1]" need not be of "joint_1"
        return 0.0
    if bare and _contains(facts.own, bare):
        return 0.95
    left = {word for word in facts.own if word not in FILLERS}
    if not left:
        return 0.0
    shared = len(left & set(bare)) / len(left | set(bare))
    joined, other = "".join(sorted(bare)), "".join(sorted(left))
    return max(0.9 * shared, 0.9 if joined == other else 0.0)


def _contains(tokens: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether words stand in a row among others."""
    size = len(wanted)
    return any(tuple(tokens[k : k + size]) == tuple(wanted)
               for k in range(len(tokens) - size + 1))  # fmt: skip


def find_stem(column: str) -> tuple[str, int]:
    """A name without its last number, and that number; -1 if it has none."""
    numbers = list(re.finditer(r"\d+", column))
    if not numbers:
        return column, -1
    last = numbers[-1]
    return column[: last.start()] + "#" + column[last.end() :], int(last[0])

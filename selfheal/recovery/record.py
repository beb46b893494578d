"""Heals as records: settings, the phases so far, the gaits in them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ..damage.apply import Strike
from ..damage.kinds import Damage
from ..gait.synthesis import Gait
from ..schema import ArraySchema, Count, Finite, Number, Probability
from .phased_run import (
    Document,
    KeptDamage,
    Phase,
    PhasedRun,
    PhaseSchema,
    declare_phase,
)


@dataclass(frozen=True)
class HealSettings:
    """Settings of a heal.

    Attributes:
        run: path of the self-modeling run that it starts from.
        damage: what happens to the hidden robot.
        onset: when, in the walk that is watched [s].
        gait: name of the gaits' pattern.
        heading: direction to walk [rad].
        seed: of everything random.
        hours: that it walks, healing as often as it breaks; 0 = it breaks once.
        onsets: when each damage of these hours happens [s]; none otherwise.
    """

    run: str
    damage: tuple[Damage, ...]
    onset: Finite = 0.0
    gait: str = "waves"
    heading: Finite = 0.0
    seed: Count = 0
    hours: Finite = 0.0
    onsets: tuple[Finite, ...] = ()

    @property
    def strikes(self) -> list[Strike]:
        """What happens in its hours."""
        pairs = zip(self.onsets, self.damage, strict=True)
        return [Strike(time, damage) for time, damage in pairs]


@dataclass(frozen=True)
class KeptGait:
    """A gait as a phase keeps it; see `gait.synthesis.Gait`."""

    pattern: str
    genes: Annotated[list[Finite], Field(min_length=1)]
    heading: Finite
    predicted: Number
    low: Number
    high: Number
    simulations: Count
    failed: Count


@dataclass(frozen=True, kw_only=True)
class Belief(KeptDamage):
    """A hypothesis as a phase keeps it."""

    probability: Probability


Beliefs = Annotated[list[Belief], Field(min_length=1)]


@dataclass(frozen=True)
class KeptAlarm:
    """An alarm as a result has it; see `monitor.Alarm`."""

    time: Finite
    sensor: str
    p_value: Finite


@dataclass(frozen=True)
class Distances:
    """How far a robot came in its walks [m]."""

    intact: Number | None
    damaged: Number | None  # as it walked before
    healed: Number | None  # broken, with what was found for that
    best_known: Number | None  # made knowing the damage; None where nobody knows it


@dataclass(frozen=True)
class _HealDistances(Distances):
    intact: Number
    damaged: Number
    healed: Number


@dataclass(frozen=True)
class _Predicted:
    """Distances of the gaits [m]."""

    intact: Number
    healed: Number


@dataclass(frozen=True)
class HealResult:
    """What `heal --json` prints, as the schema of a heal's result."""

    robot: str
    alarm: KeptAlarm | None  # None where none was raised
    actions: Count  # taken after it
    distance: _HealDistances
    predicted: _Predicted
    seconds: Number


@dataclass(frozen=True)
class HoursEvent:
    """A damage, the alarm after it, or both, as the result of hours has it.

    The last four are speeds along the heading [m/min].
    """

    time: Finite  # of the damage; of an alarm that none came before, its own [s]
    damage: KeptDamage | None  # None where the alarm is a false one
    alarm: KeptAlarm | None  # None where none came before the next damage
    delay: Finite | None  # from the damage to the alarm [s]
    believed: Belief | None
    right: bool  # whether kind and target are the true ones
    actions: Count  # taken to find that
    before: Number | None
    damaged: Number | None
    healed: Number | None  # with the gait found for it
    first: Number | None  # with the whole robot's gait


@dataclass(frozen=True)
class HoursResult:
    """What `heal --hours --json` prints, as the schema of such a result."""

    robot: str
    hours: Number  # that it walked, alarms and all [h]
    intact: Number  # speed when whole [m/min]
    distance: Number  # walked, see `gait.synthesis.measure_distance` [m]
    kept: Number  # share of what a robot that stays whole would have walked [1]
    kept_first: Number  # the same with its first gait, by a walk after each alarm [1]
    events: list[HoursEvent]  # in order of time
    false_alarms: Count
    seconds: Number


def _list_path_arrays(rows: str, prefix: str = "") -> dict[str, ArraySchema]:
    """What is kept of a walk of so many rows; see `HealPhases._extract_path`."""
    return {
        f"{prefix}position": ArraySchema((rows, 3), has_gaps=True),
        f"{prefix}orientation": ArraySchema((rows, 4), has_gaps=True),
        f"{prefix}angles": ArraySchema((rows, "P"), has_gaps=True),
    }


_FIRST, _LAST = ("gait", "whole", "alarm"), ("healed", "walked", "known")
_ROUND = " of "  # between a phase's name and the number of its heal, in hours of them
# P joints, C channels; a walk has as many rows as samples
_SCHEMAS = {
    "gait": declare_phase(gait=KeptGait),
    "whole": declare_phase(
        distance=Number,
        felt=ArraySchema(("whole rows", "C"), has_gaps=True),
        **_list_path_arrays("whole rows"),
    ),
    "alarm": declare_phase(
        {"ways": list[Number]},
        alarm=KeptAlarm | None,
        threshold=Annotated[float, Field(gt=0, le=1e6)],
        angles=ArraySchema(("P",), has_gaps=True),
        time=ArraySchema(("windows",)),
        sums=ArraySchema(("windows", "sums"), has_gaps=True),
    ),
    "ask": declare_phase(
        probe=Count,
        why=str,
        expected=Number,
        believed=Beliefs,
        values=ArraySchema((None,), has_gaps=True),
    ),
    "verdict": declare_phase(believed=Beliefs),
    "healed": declare_phase(gait=KeptGait, kept=bool),
    "walked": declare_phase(
        damaged=Number,
        healed=Number,
        **_list_path_arrays("rows", "damaged_"),
        **_list_path_arrays("rows", "healed_"),
    ),
    "known": declare_phase({"gait": KeptGait | None}, distance=Number | None),
    "first": declare_phase(distance=Number, **_list_path_arrays("rows")),
}


@dataclass(frozen=True, repr=False)
class HealRun(PhasedRun):
    """A heal, or hours of walking with one after the other; finished or not."""

    WHAT: ClassVar[str] = "heal's file"
    FORMAT: ClassVar[str] = "selfheal-heal-run"
    VERSION: ClassVar[int] = 1
    SETTINGS: ClassVar[type] = HealSettings
    RESULT: ClassVar[type] = HealResult

    settings: HealSettings

    @property
    def actions(self) -> list[Phase]:
        """The actions taken after the alarm."""
        return [p for name, p in self.phases.items() if name.startswith("ask")]

    @property
    def heals(self) -> "list[HealRun]":
        """The heals of its hours, each with its own phases; the last one goes on."""
        settings = replace(self.settings, hours=0.0, onsets=())
        heals = [HealRun(settings, {})]
        for name, phase in self.phases.items():
            own, _, number = name.partition(_ROUND)
            if int(number or 1) > len(heals):
                heals.append(HealRun(settings, {"gait": heals[-1].phases["healed"]}))
            heals[-1] = replace(heals[-1], phases={**heals[-1].phases, own: phase})
        return heals

    @staticmethod
    def name_phase(name: str, heal: int) -> str:
        """The name that a phase of a heal, the first is 1, has among those of hours."""
        return name if name == "gait" else f"{name}{_ROUND}{heal}"

    def list_next_phases(self, done: Sequence[str]) -> Sequence[str]:
        """See `PhasedRun`."""
        if self.settings.hours:
            return self._list_next_of_hours(done)
        if len(done) < len(_FIRST):
            return _FIRST[len(done) :][:1]
        if "verdict" not in done:
            return f"ask-{len(done) - len(_FIRST) + 1:02d}", "verdict"
        return _LAST[len(done) - done.index("verdict") - 1 :][:1]

    def _list_next_of_hours(self, done: Sequence[str]) -> Sequence[str]:
        last = done[-1] if done else ""
        heal = int(last.partition(_ROUND)[2] or 1)
        here = [n for n in done if n == "gait" or n.endswith(f"{_ROUND}{heal}")]
        own = [name.partition(_ROUND)[0] for name in here]
        left = self.heals[0].list_next_phases(own)
        if not left:
            left, heal = ["whole"], heal + 1
        named = ["first" if name == "known" else name for name in left]
        return [self.name_phase(name, heal) for name in named]

    def find_schema(self, name: str) -> PhaseSchema:
        """See `PhasedRun`."""
        return _SCHEMAS[name.partition(_ROUND)[0].partition("-")[0]]

    @property
    def result_schema(self) -> type:
        """See `PhasedRun`."""
        return HoursResult if self.settings.hours else HealResult

    def explain_misfit(self) -> str:
        """What does not fit together; a result needs all phases."""
        if len(self.settings.onsets) != len(self.settings.damage) * bool(
            self.settings.hours
        ):
            return "the settings have not as many onsets as damages"
        if self.settings.hours:
            raised = [heal.phases.get("alarm", {}).get("alarm") for heal in self.heals]
            listed = [event["alarm"] for event in self.result.get("events", ())]
            if self.result and sum(map(bool, raised)) != sum(map(bool, listed)):
                return "the result and the phases differ in how many alarms there were"
            return ""
        left = self.list_next_phases(tuple(self.phases))
        if self.result and left:
            return f"there is a result, but no phase {' or '.join(left)}"
        if self.result:
            raised = [bool(a["alarm"]) for a in (self.result, self.phases["alarm"])]
            if raised[0] != raised[1]:
                return "the result and the phase alarm differ in whether one was raised"
        return ""


def serialize_gait(gait: Gait) -> Document:
    """A gait as a phase keeps it."""
    return asdict(gait)


def read_gait(phase: Phase) -> Gait:
    """The gait that `serialize_gait` kept in a phase."""
    kept = phase["gait"]
    return Gait(**{**kept, "genes": np.asarray(kept["genes"], float)})

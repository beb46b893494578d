"""The parts of a hypothesis: an effect, the places where it acts, its parameters.

A `Term` is one effect at one place with the parameters to be fitted. A subclass of
`Effect` says where the effect could be, and acts in one or two of the ways of
`protocols`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...recording.data import Floats
from .declaration import (
    PHASE,
    UNUSUAL,
    USUAL,
    Finding,
    FindingField,
    Parameter,
    ParameterSpec,
    Proposal,
    Starts,
    convert_unit,
)
from .places import Place, locate_target
from .protocols import CommandFilter, JointForce, SensorMap, TextForm

if TYPE_CHECKING:
    from mujoco import MjModel

    from ..data.robot_summary import Actuator, Channel, Joint, RobotSummary


# share of a parameter's scale within which it counts as its nominal value; chosen:
# below any change that a fit distinguishes from rounding
ABSENT_TOLERANCE = 1e-6
# share of a parameter's range within which it is at its bound; chosen
BOUND_SHARE = 0.01


@dataclass(frozen=True)
class Onset:
    """When an effect set in.

    Attributes:
        number: of the episode, among all that were recorded.
        episode: its id.
        time: since the episode began [s].
        low, high: ends of the 90 % interval of `time`, in the same episode [s].
    """

    number: int
    episode: str
    time: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Term:
    """An effect at one place, or at several places that share its parameters.

    Attributes:
        effect: the physics that is added.
        targets: where, as the contract writes it ("joint:knee"); one for each place.
        places: indices of the given model that the effect needs; one for each target.
        parameters: to be fitted, in the order of the values.
        initial_values: values that a fit may begin at, each (p).
        log_odds: of the effect there before any data, beside what is usual [nats].
        onset: when the effect set in; None: it was there all the time.
    """

    effect: "Effect"
    targets: tuple[str, ...]
    places: tuple[Place, ...]
    parameters: tuple[Parameter, ...]
    initial_values: Starts
    log_odds: float = UNUSUAL
    onset: Onset | None = None

    @cached_property
    def low(self) -> Floats:
        """Smallest values (p) [each parameter's unit]."""
        return np.array([p.low for p in self.parameters], float)

    @cached_property
    def high(self) -> Floats:
        """Largest values (p) [each parameter's unit]."""
        return np.array([p.high for p in self.parameters], float)

    @cached_property
    def scale(self) -> Floats:
        """Natural steps of the values (p) [each parameter's unit]."""
        return np.array([p.scale for p in self.parameters], float)

    @property
    def is_usual(self) -> bool:
        """Whether most robots have some of it there, whatever else is missing."""
        return self.log_odds >= USUAL

    @property
    def is_wave(self) -> bool:
        """Whether its parameters are amplitude, frequency and phase.

        Its initial values come in pairs a quarter turn apart then.
        """
        return any(p.name == PHASE for p in self.parameters)

    @cached_property
    def finding_fields(self) -> dict[str, Any]:
        """What a finding says beside the target and the parameters."""
        place, names = self.places[0], [f.name for f in self.effect.finding_fields]
        values = {name: getattr(place, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def is_negligible(self, values: Floats) -> bool:
        """Whether values (p) are as good as nominal, or contradict the effect."""
        each = zip(self.parameters, values, strict=True)
        apart = [(abs(v - p.nominal), p) for p, v in each]
        near = any(off < p.resolution for off, p in apart)
        tiny = [off <= ABSENT_TOLERANCE * p.scale for off, p in apart]
        near |= bool(tiny) and all(tiny)
        return bool(near or not self.effect.is_consistent(self.parameters, values))

    def is_at_bound(self, values: Floats) -> bool:
        """Whether one of the values (p) is at a bound that is no zero of nature.

        Nor is it the nominal value, where the effect is absent.
        """
        reach = BOUND_SHARE * (self.high - self.low)
        nominal = np.array([p.nominal for p in self.parameters], float)
        is_low = (values <= self.low + reach) & (nominal > self.low) & (self.low != 0)
        is_high = (values >= self.high - reach) & (nominal < self.high)
        return bool((is_low | is_high).any())

    @property
    def key(self) -> tuple:
        """What distinguishes it from other candidates, whatever its initial values."""
        return self.effect.name, self.targets, tuple(self.finding_fields.items())

    @property
    def label(self) -> str:
        """Effect and targets in one line, for messages; of many targets the first."""
        shown = ", ".join(self.targets)
        if len(self.targets) > 2:
            shown = f"{self.targets[0]} and {len(self.targets) - 1} others"
        return f"{self.effect.name} at {shown}"


class Effect(ABC):
    """Physics that a model may lack; at its nominal values it changes nothing.

    A subclass declares the attributes, overrides `propose_terms`, and has one or two
    of the methods of `protocols`, by which it acts. Values are (p), or (N, p)
    where N simulations run at once. The schema of diagnosis.json, the report and
    docs/effects.md are derived from the attributes.

    Attributes:
        name: in diagnosis.json.
        group: of the catalogue (`effects.GROUPS`).
        description: one sentence on what happens.
        equation: of the effect, in ASCII.
        source: of the equation: a paper, or MuJoCo's element and attribute.
        separate_by: an experiment that distinguishes it from effects with like motions.
        phrase: clause of the report. `{at}` stands for the target, a parameter's name
            for its value, `{all}` for all values, `{lacks}` and `{other}` for the
            difference to the model. Empty: "TARGET shows NAME that the model lacks".
        target_kinds: of what a finding may name as its target; the first one is where
            the effect is proposed.
        parameters: that a finding states, in their order.
        parameter_sets: names that a finding states together, one tuple for each form;
            empty: all parameters, always.
        finding_fields: what a finding says beside its target and parameters; its place
            has attributes of these names, None where the finding says nothing.
        place_type: subclass of the target's place that has these; None: that place.
        overrides: names of nominal parameters at its target whose place it takes, so
            that they have no influence beside it.
        log_odds: before any data, at one place, beside what is usual [nats].
        needs: fields of `StepState`, beyond the state, commands and what is added to,
            that `apply_forces` reads or changes.
    """

    name = ""
    group = ""
    description = ""
    equation = ""
    source = ""
    separate_by = ""
    phrase = ""
    target_kinds: tuple[str, ...] = ()
    parameters: tuple[ParameterSpec, ...] = ()
    parameter_sets: tuple[tuple[str, ...], ...] = ()
    finding_fields: tuple[FindingField, ...] = ()
    place_type: type[Place] | None = None
    overrides: tuple[str, ...] = ()
    log_odds = UNUSUAL
    needs: frozenset[str] = frozenset()

    def __init_subclass__(cls) -> None:
        """Make the docstring of an effect that has none of its own."""
        super().__init_subclass__()
        if cls.__doc__ is None and cls.description:
            cls.__doc__ = f"{cls.description}\n\n    {cls.equation}\n\n{cls.source}"

    @abstractmethod
    def propose_terms(self, robot: "RobotSummary") -> list[Term]:
        """One term for each place where the effect could be."""

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        """The place of a finding in any model, for a replay.

        Raises:
            InputError: the model lacks what the finding is about.
        """
        return self.complete_place(locate_target(model, finding["target"]), finding)

    def complete_place(self, place: Place, finding: Finding) -> Place:
        """A target's place as a `place_type`, with what a finding says beside."""
        if not self.place_type:
            return place
        beside = {f.name: finding.get(f.name) for f in self.finding_fields}
        return place.extend(self.place_type, **beside)

    def is_consistent(self, parameters: Sequence[Parameter], values: Floats) -> bool:
        """Whether values (p) of parameters agree with the effect's description."""
        return True

    def is_whole_in_text(self, place: Place) -> bool:
        """Whether a patched model that has the native form predicts all of it there."""
        return True

    @property
    def is_native(self) -> bool:
        """Whether plain MuJoCo can do all that the effect does."""
        acts_outside = isinstance(self, CommandFilter | JointForce | SensorMap)
        return isinstance(self, TextForm) or not acts_outside

    def list_parameter_sets(self) -> tuple[tuple[str, ...], ...]:
        """Names of parameters that a finding may state, one tuple for each form."""
        return self.parameter_sets or (tuple(p.name for p in self.parameters),)

    def bound(
        self,
        name: str,
        bounds: tuple[float, float],
        *,
        scale: float,
        at: "Joint | Actuator | Channel | None" = None,
        nominal: float | None = None,
        resolution: float = 0.0,
    ) -> Parameter:
        """A declared parameter, with its bounds on a robot.

        Args:
            bounds: the smallest and the largest value that make sense.
            scale: a change that the robot would show.
            at: element whose unit counts; None: the declared unit is the parameter's.
            nominal: value at which the effect is absent, where none is declared.
            resolution: distance from the nominal value that simulation errors hide.

        Raises:
            TypeError: no nominal value is declared, and none is given.
        """
        spec = next(p for p in self.parameters if p.name == name)
        absent = spec.nominal if nominal is None else nominal
        if absent is None:
            raise TypeError(f"{self.name}: {name} declares no nominal value; give one")
        unit = (spec.unit or "") if at is None else convert_unit(spec.unit, at.unit)
        return Parameter(name, unit, absent, *bounds, scale, resolution)

    def make_term(self, target: str, place: Place, proposal: Proposal) -> Term:
        """A term of the effect at one place; `target` as in "joint:knee"."""
        parameters, starts, log_odds = proposal
        odds = self.log_odds if log_odds is None else log_odds
        return Term(self, (target,), (place,), parameters, starts, odds)

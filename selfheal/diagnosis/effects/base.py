"""The parts of a hypothesis: an effect, the places where it acts, its parameters.

A `Term` is one effect at one place with the parameters to be fitted. A subclass of
`Effect` says where the effect could be and how it changes a simulation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...recording.data import Floats
from .declaration import FindingField, Parameter, ParameterSpec, convert_unit
from .places import Place, add_keys, locate_target
from .step_state import StepState as StepState  # a simulation imports it from here

if TYPE_CHECKING:
    import mujoco

    from ...mjcf.edit import Insert, Rename, Set
    from ..data.robot_summary import Actuator, Channel, Joint, RobotSummary


# share of a parameter's scale within which it counts as its nominal value; chosen:
# below any change that a fit tells from rounding
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
        finding_fields: what a finding says beside the target and the parameters.
        onset: when the effect set in; None: it was there all the time.
    """

    effect: "Effect"
    targets: tuple[str, ...]
    places: tuple[Place, ...]
    parameters: tuple[Parameter, ...]
    initial_values: tuple[tuple[float, ...], ...]
    finding_fields: Mapping[str, Any] = field(default_factory=dict)
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

    def is_negligible(self, values: Floats) -> bool:
        """Whether values (p) are as good as nominal, or contradict the effect."""
        each = zip(self.parameters, values, strict=True)
        apart = [(abs(v - p.nominal), p) for p, v in each]
        near = any(off < p.resolution for off, p in apart)
        tiny = [off <= ABSENT_TOLERANCE * p.scale for off, p in apart]
        near |= bool(tiny) and all(tiny)
        # a wave at its lowest frequency is a bend within the range, of another effect
        bend = self.effect.is_periodic and values[1] < 1.01 * self.low[1]
        return bool(near or bend or not self.effect.is_consistent(values))

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
        """What tells it from other candidates, whatever its initial values."""
        return self.effect.name, self.targets, tuple(self.finding_fields.items())

    @property
    def label(self) -> str:
        """Effect and targets in one line, for messages; of many targets the first."""
        shown = ", ".join(self.targets)
        if len(self.targets) > 2:
            shown = f"{self.targets[0]} and {len(self.targets) - 1} others"
        return f"{self.effect.name} at {shown}"


class Effect:
    """Physics that a model may lack; at its nominal values it changes nothing.

    A subclass declares the attributes, overrides `propose_terms`, and one or two of the
    methods by which an effect acts: `edit_model`, `edit_spec`, `transform_command`,
    `apply_forces`, `transform_reading`. Values are (p), or (N, p) where N simulations
    run at once. The schema of diagnosis.json, the report and docs/effects.md are
    derived from the attributes.

    Attributes:
        name: in diagnosis.json.
        group: of the catalogue (`effects.GROUPS`).
        description: one sentence on what happens.
        equation: of the effect, in ASCII.
        source: of the equation: a paper, or MuJoCo's element and attribute.
        separate_by: an experiment that tells it from effects with like motions.
        phrase: clause of the report. `{at}` stands for the target, a parameter's name
            for its value, `{all}` for all values, `{lacks}` and `{other}` for the
            difference to the model. Empty: "TARGET shows NAME that the model lacks".
        target_kinds: of what a finding may name as its target; the first one is where
            the effect is proposed.
        parameters: that a finding states, in their order.
        parameter_sets: names that a finding states together, one tuple for each form;
            empty: all parameters, always.
        finding_fields: what a finding says beside its target and parameters.
        is_common: whether most robots have some of it at each single target.
        rarity: a rank of how seldom a model lacks it, 0 to 2; chosen: people measure
            lengths (2) better than loads (1), and those better than friction (0).
        restates_nominal: whether it says that a value or law of the model is wrong.
        overrides: names of nominal parameters at its target whose place it takes, so
            that they have no influence beside it.
        holds_previous_command: whether `transform_command` gives the command as it was
            when a step began.
        looks_ahead: how far ahead `transform_command` may look [s].
        writes_forcerange: whether `apply_forces` writes `StepState.forcerange`.
        reads_torques: whether `apply_forces` reads `StepState.actuator_torque`.
        reads_actuators: whether `apply_forces` reads laws and lengths of actuators from
            `StepState`.
        native_is_stepwise: whether MuJoCo's native form acts by whole time steps, so
            that a replay applies the effect itself.
        rounds_readings: whether its readings jump, so that fits leave it out.
        is_periodic: whether its parameters are amplitude, frequency and phase, and its
            initial values come in pairs a quarter turn apart.
    """

    # what it is
    name = ""
    group = ""
    description = ""
    equation = ""
    source = ""
    separate_by = ""
    phrase = ""
    # what a finding of it states
    target_kinds: tuple[str, ...] = ()
    parameters: tuple[ParameterSpec, ...] = ()
    parameter_sets: tuple[tuple[str, ...], ...] = ()
    finding_fields: tuple[FindingField, ...] = ()
    # how likely it is before any data
    is_common = False
    rarity = 0
    restates_nominal = False
    overrides: tuple[str, ...] = ()
    # what a simulation, a fit and a replay have to know of it
    holds_previous_command = False
    looks_ahead = 0.0
    writes_forcerange = False
    reads_torques = False
    reads_actuators = False
    native_is_stepwise = False
    rounds_readings = False
    is_periodic = False

    # ---- derived from the declaration

    def __init_subclass__(cls) -> None:
        """Make the docstring of an effect that has none of its own."""
        super().__init_subclass__()
        if cls.__doc__ is None and cls.description:
            cls.__doc__ = f"{cls.description}\n\n    {cls.equation}\n\n{cls.source}"

    @property
    def is_native(self) -> bool:
        """Whether plain MuJoCo can do all that the effect does."""
        ways = ("transform_command", "apply_forces", "transform_reading")
        acts_outside = any(implements(self, way) for way in ways)
        return implements(self, "edit_text") or not acts_outside

    def list_parameter_sets(self) -> tuple[tuple[str, ...], ...]:
        """Names of parameters that a finding may state, one tuple for each form."""
        return self.parameter_sets or (tuple(p.name for p in self.parameters),)

    def make_parameter(
        self,
        name: str,
        element: "Joint | Actuator | Channel | None" = None,
        *,
        low: float,
        high: float,
        scale: float,
        nominal: float | None = None,
        resolution: float = 0.0,
        component: str = "",
    ) -> Parameter:
        """A declared parameter, with its bounds on a robot.

        Args:
            name: of a parameter that the effect declares.
            element: at which the effect acts, whose unit counts; None: the declared
                unit is the parameter's.
            low: the smallest value that makes sense.
            high: the largest.
            scale: a change that the robot would show.
            nominal: value at which the effect is absent, where none is declared.
            resolution: distance from the nominal value that simulation errors hide.
            component: of a parameter that is a vector; its name gets "_COMPONENT".

        Raises:
            TypeError: no nominal value is declared, and none is given.
        """
        spec = next(p for p in self.parameters if p.name == name)
        absent = spec.nominal if nominal is None else nominal
        if absent is None:
            raise TypeError(f"{self.name}: {name} declares no nominal value; give one")
        unit = spec.unit or ""
        if element is not None:
            unit = convert_unit(spec.unit, element.unit)
        full_name = f"{name}_{component}" if component else name
        return Parameter(full_name, unit, absent, low, high, scale, resolution)

    # ---- where it could be

    def propose_terms(self, robot: "RobotSummary") -> list[Term]:
        """One term for each place where the effect could be."""
        raise NotImplementedError

    def find_place(self, model: "mujoco.MjModel", finding: Mapping[str, Any]) -> Place:
        """The place of a finding in any model, for a replay.

        Raises:
            InputError: the model lacks what the finding is about.
        """
        own = [f.name for f in self.finding_fields if f.name in finding]
        place = locate_target(model, finding["target"])
        return add_keys(place, **{name: finding[name] for name in own})

    # ---- how likely it is

    def is_usual(self, term: Term) -> bool:
        """Whether most robots have some of it there, whatever else is missing."""
        return self.is_common and len(term.targets) == 1

    def is_consistent(self, values: Floats) -> bool:
        """Whether values (p) agree with the effect's description."""
        return True

    # ---- how it acts

    def edit_model(
        self, model: "mujoco.MjModel", place: Mapping[str, Any], values: Floats
    ) -> None:
        """Change fields of a compiled model.

        Args:
            model: compiled, to be changed.
            place: where the effect acts, in that model.
            values: (p) of the parameters.
        """

    def edit_spec(self, spec: "mujoco.MjSpec", place: Mapping[str, Any]) -> None:
        """Add elements to a model before it is compiled."""

    def transform_command(
        self, ctrl: Floats, step: float, place: Mapping[str, Any], values: Floats
    ) -> Floats:
        """Commands as they reach the actuators.

        Args:
            ctrl: (1 or N, G, nu) as they were sent, on a grid.
            step: of the grid [s].
            place: where the effect acts; nothing but its `controls` may change.
            values: (N, p) of the parameters.

        Returns:
            (N, G, nu) on the same grid.
        """
        return ctrl

    def apply_forces(
        self, state: StepState, place: Mapping[str, Any], values: Floats
    ) -> None:
        """Add forces, or change friction and limits, at one step.

        Args:
            state: of N simulations, to be read and changed.
            place: where the effect acts, in the simulated model.
            values: (N, p) of the parameters.
        """

    def transform_reading(
        self, place: Mapping[str, Any], values: Floats
    ) -> Mapping[str, Floats]:
        """What a sensor makes of the true signal place["signal"], from values (N, p).

        Returns:
            Of the keys "bias" (N, width) [signal's unit], "gain" (N) [1], "delay" (N)
            [s] and "step" (N) [signal's unit] those that it changes.
        """
        return {}

    def compute_deflection(self, values: Floats, load: float) -> float:
        """Rest position [rad or m] of the joint that `edit_spec` adds.

        Args:
            values: (p) of the parameters.
            load: torque or force that the joint bears [N m or N].
        """
        return 0.0

    def edit_text(
        self, model: "mujoco.MjModel", place: Mapping[str, Any], values: Floats
    ) -> "Sequence[Set | Insert | Rename] | None":
        """Edits of the MJCF's text with the same effect; None: the text cannot say it.

        Args:
            model: compiled, as given or with the joints that effects add.
            place: where the effect acts, in that model.
            values: (p) of the parameters.
        """
        return None


def implements(effect: Effect, method: str) -> bool:
    """Whether an effect overrides a method ("edit_model", "apply_forces", ...)."""
    return getattr(type(effect), method) is not getattr(Effect, method)

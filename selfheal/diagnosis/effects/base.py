"""What a hypothesis is made of: an effect, the places it acts at, its parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco

    from ...mjcf.edit import Insert, Rename, Set
    from ..data.robot_summary import RobotSummary

Floats = NDArray[np.float64]


NIL = 1e-6  # of a parameter's scale: as good as absent


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: MJCF's own where it has one.
        unit: of the value; for a slide joint N and m stand for N m and rad.
        absent: the value at which the effect is exactly not there.
        low: the smallest value that makes sense.
        high: the largest.
        scale: a change that the robot would show; the unit of a search step.
        least: distance from `absent` below which the simulation's own errors are.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    scale: float
    resolution: float = 0.0


@dataclass(frozen=True)
class Onset:
    """When something set in.

    Attributes:
        number: of the episode, among all that were recorded.
        episode: its id.
        time: in it [s].
        low, high: where the 90 % interval of that ends, in the same episode [s].
    """

    number: int
    episode: str
    time: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Term:
    """An effect at one place, or at several that share its parameters.

    Attributes:
        effect: what happens.
        targets: where, as the contract writes it ("joint:knee"); one a place.
        places: what the effect needs to act there (indices of the model); one a place.
        parameters: in the order of the values.
        starts: values a search may begin at, each (p).
        note: what else a finding of it says.
        onset: when it set in; None: it was there all the time.
    """

    effect: "Effect"
    targets: tuple[str, ...]
    places: tuple[Mapping[str, Any], ...]
    parameters: tuple[Parameter, ...]
    initial_values: tuple[tuple[float, ...], ...]
    finding_fields: Mapping[str, Any] = field(default_factory=dict)
    onset: Onset | None = None

    @property
    def low(self) -> Floats:
        """Smallest values (p)."""
        return np.array([p.low for p in self.parameters], float)

    @property
    def high(self) -> Floats:
        """Largest values (p)."""
        return np.array([p.high for p in self.parameters], float)

    @property
    def scale(self) -> Floats:
        """Values' natural steps (p)."""
        return np.array([p.scale for p in self.parameters], float)

    def is_negligible(self, values: Floats) -> bool:
        """Whether values (p) are too near to absent to tell, or not what it says."""
        each = zip(self.parameters, values, strict=True)
        apart = [(abs(v - p.nominal), p) for p, v in each]
        near = any(off < p.resolution for off, p in apart)
        near |= bool(apart) and all(off <= NIL * p.scale for off, p in apart)
        # a wave as slow as may be is a bend, of something else
        bend = self.effect.is_periodic and values[1] < 1.01 * self.low[1]
        return bool(near or bend or not self.effect.is_consistent(values))

    @property
    def key(self) -> tuple:
        """What tells it from other candidates, whatever its starts."""
        return self.effect.name, self.targets, tuple(self.finding_fields.items())

    @property
    def label(self) -> str:
        """As a person reads it."""
        return f"{self.effect.name} at {', '.join(self.targets)}"


def is_distinct(term: Term, kept: Sequence[Term]) -> bool:
    """Whether a term says something new beside those kept."""
    return not any(
        term.effect.name == t.effect.name and set(term.targets) & set(t.targets)
        for t in kept
    )


def find_other_forms(term: Term, among: Sequence[Term]) -> list[Term]:
    """The same effect at the same place by other laws."""
    own = term.effect.name, term.targets
    same = [t for t in among if (t.effect.name, t.targets) == own]
    return [t for t in same if t.key != term.key]


def extend_places(term: Term, **more) -> Term:
    """The same term whose place says more."""
    return replace(term, places=tuple({**place, **more} for place in term.places))


def restates_nominal_value(term: Term, nominal_terms: Sequence[Term]) -> bool:
    """Whether an effect's parameters are those of the model, and one is stated."""
    if not np.isfinite([p.nominal for p in term.parameters]).all():
        return False
    said = {target for t in nominal_terms for target in t.targets}
    own = {f"{target}/{p.name}" for target in term.targets for p in term.parameters}
    return bool(own & said)


def find_overridden(term: Term, terms: Sequence[Term]) -> list[int]:
    """Which of the stated values (one a term, the first ones) an effect overrides."""
    own = {f"{at}/{name}" for at in term.targets for name in term.effect.overrides}
    return [i for i, t in enumerate(terms) if own & set(t.targets)]


def remove_rounding(terms: Sequence[Term], values: Floats) -> Floats:
    """Values (n, P) with which no reading is rounded."""
    each = [(t.effect.rounds_readings, p.nominal) for t in terms for p in t.parameters]
    rounds = np.array([r for r, _ in each], bool)
    return np.where(rounds, [absent for _, absent in each], values)


@dataclass
class StepState:
    """What an effect may read and write at one step of N simulations.

    Attributes:
        time: (N) [s] since each episode began.
        qpos: (N, nq) now.
        qvel: (N, nv) now.
        ctrl: (N, nu) command of this step.
        actuator_torque: (N, nv) at the joints, of the step before.
        bias: (N, nv) torque that weight and motion ask of the joints, of the same step.
        applied: (N, nv) force of effects, to be added to.
        frictionloss: (N, nv) dry friction of this step, to be changed.
        forcerange: (N, nu, 2) of the actuators, to be changed; None where no effect
            says that it does.
        sums: (N) summed error of each integrating servo [rad s], to be added to.
        step: of the simulation [s].
    """

    time: Floats
    qpos: Floats
    qvel: Floats
    ctrl: Floats
    actuator_torque: Floats
    bias_torque: Floats
    applied_force: Floats
    frictionloss: Floats
    forcerange: Floats | None
    integral_errors: Mapping[int, Floats]
    timestep: float


class Effect:
    """A piece of physics that a model may lack; at its absent values it does nothing.

    A subclass says where it could be (`terms`) and overrides the one or two ways in
    which it acts. Values are (p), or (N, p) where N simulations run at once.
    """

    name = ""
    group = ""
    description = ""
    equation = ""
    source = ""
    separate_by = ""
    regime = "always"
    is_common = False  # see `is_usual`
    # people measure lengths (2) better than loads (1), those than friction (0)
    rarity = 0
    overrides: tuple[str, ...] = ()  # names of stated values whose place it takes
    restates_nominal = (
        False  # says that a number or a law which the model states is not so
    )
    holds_previous_command = False  # gives a command as it was when a step began
    is_periodic = (
        False  # amplitude, frequency, phase; starts in pairs, a quarter turn apart
    )
    writes_forcerange = False  # writes Moment.forcerange
    native_is_stepwise = (
        False  # MuJoCo does it by whole time steps, and a replay exactly
    )
    rounds_readings = False  # its readings jump; fits are made to what they were before
    vector_parameter = (
        ""  # the parameter that a finding states as one vector, of NAME_x, NAME_y
    )

    def propose_terms(self, robot: "RobotSummary") -> list[Term]:
        """Every place where it could be."""
        raise NotImplementedError

    def is_usual(self, term: Term) -> bool:
        """Whether most robots have some of it there, whatever else is missing."""
        return self.is_common and len(term.targets) == 1

    def is_directly_observed(self, term: Term) -> bool:
        """Whether readings show just that, and not only what some size of it does."""
        return False

    def rate_rarity(self, term: Term, values: Floats) -> int:
        """How rare (`rare`) what it says with values (p) is."""
        return self.rarity

    def is_consistent(self, values: Floats) -> bool:
        """Whether values (p) together are what its sentence says."""
        return True

    def edit_model(self, model: "mujoco.MjModel", place, values: Floats) -> None:
        """Change a compiled model; values (p)."""

    def edit_spec(self, spec: "mujoco.MjSpec", place) -> None:
        """Add to the model what an edit of numbers cannot."""

    def transform_command(
        self, ctrl: Floats, step: float, place, values: Floats
    ) -> Floats:
        """Commands (N, G, nu) on a grid of `step` s, as they reach the actuators."""
        return ctrl

    def apply_forces(self, state: StepState, place, values: Floats) -> None:
        """Add forces, or change limits, at one step; values (N, p)."""

    def transform_reading(self, place, values: Floats) -> Mapping[str, Floats]:
        """Of signal place["signal"] what it changes: bias (N, p), gain, delay (N)."""
        return {}

    def compute_deflection(self, values: Floats, load: float) -> float:
        """Where a joint that it adds rests under a load [N m or N]."""
        return 0.0

    def edit_text(
        self, model: "mujoco.MjModel", place, values: Floats
    ) -> "Sequence[Set | Insert | Rename] | None":
        """The edit of the MJCF's text that is the same; None: MuJoCo has no such."""
        return None


def implements(effect: Effect, verb: str) -> bool:
    """Whether an effect acts in the way `verb` ("edit", "act", ...)."""
    return getattr(type(effect), verb) is not getattr(Effect, verb)

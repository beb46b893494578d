"""What an effect states of itself, once: its parameters, and a finding's fields."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

TARGET_KINDS = ("joint", "actuator", "body", "geom", "sensor", "world")
# names that a phrase may use beside the parameters': the target, all parameters, and
# the two ways to say that a model differs (`selfheal.report.phrases.COMMON`)
PLACEHOLDERS = ("at", "all", "lacks", "other")
PHASE = "phase"  # the last parameter of a wave, after its amplitude and frequency

# Log-odds [nats] of an effect at one place before any data, beside one that most robots
# have some of, whatever else is missing. Chosen: people measure lengths better than
# loads, and those better than friction, each ten times.
_TENFOLD = float(np.log(10.0))
USUAL, UNUSUAL, SELDOM, RARE = 0.0, -0.5 * _TENFOLD, -1.5 * _TENFOLD, -2.5 * _TENFOLD

Finding = Mapping[str, Any]  # one of diagnosis.json's "findings"
Starts = tuple[tuple[float, ...], ...]  # values (p) that a fit may begin at


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter of an effect, as every finding states it.

    Attributes:
        name: MJCF's own where it has one.
        unit: at a hinge; `convert_unit` gives it at a slide. None: the unit of the
            signal that the effect acts on.
        nominal: the value at which the effect is exactly absent; None: what the model
            states, or what the effect computes of the robot.
        nonnegative: whether a finding with a value below 0 is refused.
        size: how many numbers a finding states: 1 a number, 3 a list of three; None a
            number, or a list with one for each column of a signal.
        is_in_model: whether the nominal value is one that a model states, so that a
            finding says it beside the new one ("given").
    """

    name: str
    unit: str | None
    nominal: float | None = None
    nonnegative: bool = False
    size: int | None = 1
    is_in_model: bool = False


@dataclass(frozen=True)
class Parameter:
    """One number of an effect, with its bounds on a robot.

    Attributes:
        name: MJCF's own where it has one.
        unit: of the value; at a slide joint N and m stand for N m and rad.
        nominal: the value at which the effect is exactly absent.
        low: the smallest value that makes sense.
        high: the largest.
        scale: a change that the robot would show; the unit of a search step.
        resolution: distance from `nominal` that the simulation's own errors hide.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    scale: float
    resolution: float = 0.0


class Proposal(NamedTuple):
    """An effect at one element of a robot, before any fit.

    Attributes:
        parameters: to be fitted, with their bounds there.
        initial_values: that a fit may begin at, each (p).
        log_odds: of the effect there, beside what is usual [nats]; None: its own.
    """

    parameters: tuple[Parameter, ...]
    initial_values: Starts
    log_odds: float | None = None


def start_beside(parameters: Iterable[Parameter], *shares: float) -> Starts:
    """Initial values beside the nominal ones, by shares of the parameters' scales."""
    each = tuple(parameters)
    return tuple(tuple(p.nominal + share * p.scale for p in each) for share in shares)


@dataclass(frozen=True)
class FindingField:
    """What a finding says beside its target and its parameters.

    Attributes:
        name: its key in the finding.
        values: those that it may have; empty: it names a target.
        target_kind: what that target is; empty where `values` are listed.
        is_required: whether a finding without it is refused.
        note: what the report adds to the finding's name, `{value}` in it; empty:
            nothing.
    """

    name: str
    values: tuple[str | int, ...] = ()
    target_kind: str = ""
    is_required: bool = True
    note: str = ""


def convert_unit(unit: str | None, element_unit: str) -> str:
    """The unit of a parameter at an element.

    Args:
        unit: as declared; None: the element's own.
        element_unit: "rad" at a hinge, "m" at a slide, or a signal's unit.

    Returns:
        At a slide, N for N m, m for rad and kg for kg m^2.
    """
    if unit is None:
        return element_unit
    if element_unit != "m":
        return unit
    if unit == "kg m^2":
        return "kg"
    return unit.replace("N m", "N").replace("rad", "m")

"""A recording against a model: takes both, refuses what the model does not have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..printable import quote_name
from .check import format_names
from .controls import Control, assign_columns
from .data import KINDS, Episode, EpisodeTable, Location, Signal

# what to do about a model without actuators, at the end of a message
NO_ACTUATORS = (
    "would fit: those that are written, to a URDF or an MJCF, by: selfheal model "
    "prepare ROBOT.urdf --kp KP --kv KV --out m.xml"
)


@dataclass(frozen=True)
class Target:
    """What a model says of something that a signal can belong to.

    Attributes:
        units: of its signals, by kind; a kind that is not in it is not known.
        width: columns of its signal, 0 for a scalar (T) one; None: the kind decides.
        range: of a joint, or of an actuator's joint [rad or m]; None where it has none.
    """

    units: Mapping[str, str]
    width: int | None = None
    range: tuple[float, float] | None = None


@dataclass(frozen=True)
class ModelNames:
    """What a recording can refer to in a model.

    Attributes:
        targets: of each sort (joint, actuator, body, sensor), by name.
        controls: (nu) one for each column of ctrl.
        unnamed: number of actuators without a name.
        nq: length of qpos0.
        nv: length of qvel0.
    """

    targets: Mapping[str, Mapping[str, Target]]
    controls: Sequence[Control]
    unnamed: int
    nq: int
    nv: int

    @property
    def commands(self) -> list[str]:
        """A name for each column of ctrl (nu) that no other column has."""
        return [control.full_name for control in self.controls]


def check_against_model(recording: EpisodeTable, names: ModelNames) -> None:
    """Refuse a recording of what the model does not have.

    Raises:
        RecordingError: the first problem: file, episode, signal and what would fit.
    """
    for name, episode in recording.episodes.items():
        place = Location(recording.file, name)
        _check_actuators(episode, names, place)
        for what, size in (("qpos0", names.nq), ("qvel0", names.nv)):
            state = getattr(episode, what)
            if state is not None and state.size != size:
                raise place.make_error(
                    f"{what} has {state.size} values; the model has {size}"
                )
        for signal_name, signal in episode.signals.items():
            _check_target(signal, names, Location(recording.file, name, signal_name))


def _check_actuators(episode: Episode, names: ModelNames, place: Location) -> None:
    model, given = names.targets["actuator"], episode.ctrl_names
    if given and not model:
        raise place.make_error(
            f"ctrl has a column for {format_names(given)}, but the model has no "
            f"actuator with a name; {NO_ACTUATORS}"
        )
    if names.unnamed:
        raise place.make_error(
            f"{names.unnamed} of the model's actuators have no name, so that no column "
            "of ctrl can be theirs; would fit: a name for each"
        )
    fits = [c.actuator for c in names.controls]
    full = names.commands
    if unknown := [name for name in given if name not in (*model, *full)]:
        raise place.make_error(
            f"the model has no actuator {format_names(unknown)}; would fit: "
            f"{format_names(fits)}"
        )
    assigned = assign_columns(given, names.controls)
    have = {names.controls[i].actuator for i in assigned if i >= 0}
    if missing := [name for name in model if name in fits and name not in have]:
        raise place.make_error(
            f"ctrl has no column for actuator {format_names(missing)} of the model; "
            "each actuator needs its command"
        )
    if sorted(assigned) != list(range(len(fits))):
        raise place.make_error(
            f"ctrl has columns for {format_names(given)}; would fit: "
            f"{format_names(fits)}{f' or {format_names(full)}' * (full != fits)}"
        )


def _check_target(signal: Signal, names: ModelNames, place: Location) -> None:
    kind = KINDS[signal.kind]
    if not signal.target and kind.may_lack_target:
        return
    target = names.targets[kind.target].get(signal.target)
    if target is None:
        raise place.make_error(
            f"the model has no {kind.target} {quote_name(signal.target)} for kind "
            f"{signal.kind!r}; would fit: {format_names(names.targets[kind.target])}"
        )
    unit = target.units.get(signal.kind, signal.unit)
    if unit != signal.unit:
        raise place.make_error(
            f"unit {quote_name(signal.unit)} does not fit {kind.target} "
            f"{quote_name(signal.target)}; would fit: {unit!r}"
        )
    width = signal.values.shape[1] if signal.values.ndim > 1 else 0
    if target.width not in (None, width):
        samples = len(signal.values)
        fits = f"({samples}, {target.width})" if target.width else f"({samples},)"
        raise place.make_error(
            f"shape {signal.values.shape} does not fit {kind.target} "
            f"{quote_name(signal.target)}; would fit: {fits}"
        )

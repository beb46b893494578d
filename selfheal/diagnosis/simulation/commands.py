"""Commands: takes what was sent, gives what reaches the actuators at each step."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..data.episodes import SampledEpisode
from ..data.segments import Segments
from ..effects.base import Term
from ..effects.commands import MAX_LOOK_AHEAD, CommandGrid
from ..effects.places import ControlsPlace
from ..effects.protocols import CommandFilter
from .batch import Hypotheses
from .system import RecordedSystem


def compute_commands(
    system: RecordedSystem,
    hypotheses: Hypotheses,
    segments: Segments,
    grid: CommandGrid,
) -> Floats:
    """Commands of each simulation, as they reach the actuators.

    Returns:
        (n W, K, nu) of K steps [each control's unit].
    """
    terms, values = hypotheses.terms, hypotheses.term_values
    if any(isinstance(t.effect, CommandFilter) for t in terms):
        commands = _cut_commands(system, terms, values, segments, grid)
        return commands.reshape(-1, *commands.shape[2:])
    sent = system.cache.load_or_compute(
        segments,
        ("commands", grid.is_centered),
        lambda: _cut_commands(system, (), (), segments, grid)[0],
    )
    return np.tile(sent, (len(hypotheses.models), 1, 1))


def _cut_commands(
    system: RecordedSystem,
    terms: Sequence[Term],
    term_values: Sequence[Floats],
    segments: Segments,
    grid: CommandGrid,
) -> Floats:
    """Commands (1 or n, W, K, nu) of segments, those of their episodes transformed."""
    n = len(term_values[0]) if terms else 1
    steps = np.arange(int(segments.lengths.max()) + 2)
    out = np.empty((n, len(segments), len(steps), system.compiler.nominal.nu))
    margin = 1 + round(MAX_LOOK_AHEAD / grid.step)
    for i in np.unique(segments.episode):
        rows = np.flatnonzero(segments.episode == i)
        first = segments.first_step[rows]
        episode = system.episodes[i].truncate(int(first.max()) + len(steps) + margin)
        ctrl = transform_commands(terms, term_values, episode, grid)
        at = np.minimum(first[:, None] + steps, ctrl.shape[1] - 1)
        out[:, rows] = ctrl[:, at]
    return out


def transform_commands(
    terms: Sequence[Term],
    term_values: Sequence[Floats],
    episode: SampledEpisode,
    grid: CommandGrid,
) -> Floats:
    """Commands of an episode on its grid, as they reach the actuators.

    Args:
        term_values: (n, p) of each term.

    Returns:
        (1 or n, G, nu) [each control's unit].
    """
    sent = (episode.ctrl_centered if grid.is_centered else episode.ctrl)[None]
    ctrl, earlier = sent, list[tuple[set[int], Floats]]()
    for term, values in zip(terms, term_values, strict=True):
        if not isinstance(term.effect, CommandFilter):
            continue
        for place in term.places:
            assert isinstance(place, ControlsPlace)  # by `CommandFilter`
            own = list(place.controls)
            # most hypotheses differ in values that act on other controls
            acting = [v for controls, v in earlier if not controls.isdisjoint(own)]
            both = np.hstack([*acting, values])
            _, first, which = np.unique(
                both, axis=0, return_index=True, return_inverse=True
            )
            rows = sent if ctrl is sent else ctrl[first]
            each = term.effect.transform_command(rows, grid, place, values[first])
            if ctrl is sent:
                ctrl = np.repeat(sent, len(values), axis=0)
            ctrl[..., own] = each[..., own][which.ravel()]
            earlier.append((set(own), values))
    return ctrl

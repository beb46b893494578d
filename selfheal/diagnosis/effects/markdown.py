"""Effects as Markdown: takes declarations, gives their part of docs/effects.md."""

from collections.abc import Iterable

from . import GROUPS
from .base import Effect

# what a group's heading is followed by
NOTES = {
    "measurement": "\nA reading is round to step (gain x true(t - delay) + bias).\n",
}


def format_catalogue(effects: Iterable[Effect]) -> str:
    """A heading for each group that the contract has, and its effects below it."""
    every, parts = list(effects), []
    for group in GROUPS:
        parts.append(f"\n## {group.capitalize()}\n{NOTES.get(group, '')}")
        parts += [format_effect(e) for e in every if e.group == group]
    return "".join(parts)


def format_effect(effect: Effect) -> str:
    """A heading, the description, the equation, and what the effect declares."""
    names = [f"{p.name} [{p.unit or 'its unit'}]" for p in effect.parameters]
    acts = "native" if effect.is_native else "by `replay`"
    return (
        f"\n### `{effect.name}`\n\n{effect.description}\n\n    {effect.equation}\n\n"
        f"- at: {effect.target_kinds[0]}; {acts}\n"
        f"- parameters: {', '.join(names) or 'none'}\n"
        f"- source: {effect.source}\n"
        f"- told from its like: {effect.separate_by}\n"
    )

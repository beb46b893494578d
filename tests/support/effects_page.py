"""The text of docs/effects.md, made from the catalogue.

`python -m tests.support.effects_page` writes the page anew.
"""

from collections.abc import Iterable

from selfheal.diagnosis.effects import GROUPS, load_catalogue
from selfheal.diagnosis.effects.base import Effect
from tests.support.paths import DOCS

HEAD = """# Effects

The physics that `selfheal diagnose` can name, as `selfheal effects` lists it. Made from
the catalogue by `python -m tests.support.effects_page`.

*Native*: plain MuJoCo can express it, so that patched.xml has it. The others are in
diagnosis.json, and `selfheal replay` applies them. For a slide joint read N and m for
N m and rad. [Add an effect](add-an-effect.md) says how to bring one of your own.
No name is ever changed. New are `gravity_compensation`, `clock_shift`,
`torque_constant`, `velocity_feedforward`, `dead_band`, `base_compliance` and
`thermal_derating`.
"""
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
        f"- to distinguish it: {effect.separate_by}\n"
    )


def make_effects_page() -> str:
    """The text of docs/effects.md: the effects that come with this package."""
    own = [
        e
        for e in load_catalogue().values()
        if type(e).__module__.startswith("selfheal.")
    ]
    return HEAD + format_catalogue(own)


if __name__ == "__main__":
    (DOCS / "effects.md").write_text(make_effects_page())

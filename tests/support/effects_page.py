"""The text of docs/effects.md, made from the catalogue.

`python -m tests.support.effects_page` writes the page anew.
"""

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.markdown import format_catalogue
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

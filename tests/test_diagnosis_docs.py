"""Pages that speak of the code: effects.md is the catalogue, the example works.

`python tests/test_diagnosis_docs.py` writes effects.md anew.
"""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis_effects import CONTRACT
from toys_diagnosis import bench

from selfheal.diagnosis.effects import GROUPS, load_catalogue
from selfheal.diagnosis.output.mjcf_patch import is_native
from selfheal.diagnosis.simulation import score

DOCS = Path(__file__).parents[1] / "docs"
HEAD = """# Effects

The physics that `selfheal diagnose` can name, as `selfheal effects` lists it. Made from
the catalogue by `python tests/test_diagnosis_docs.py`.

*Native*: plain MuJoCo can express it, so that patched.xml has it. The others are in
diagnosis.json, and `selfheal replay` applies them. For a slide joint read N and m for
N m and rad. [Add an effect](add-an-effect.md) says how to bring one of your own.
"""
OF_SENSOR = """
A reading is round to step (gain x true(t - delay) + bias).
"""


def effects_page() -> str:
    """The text of docs/effects.md."""
    parts = [HEAD]
    for group in GROUPS:
        parts.append(f"\n## {group.capitalize()}\n")
        if group == "measurement":
            parts.append(OF_SENSOR)
        parts += [_entry(e) for e in load_catalogue().values() if e.group == group]
    return "".join(parts)


def _entry(effect) -> str:
    sort, units = CONTRACT[effect.name]
    columns = [f"{effect.vector_parameter}_{x}" for x in "xyz"]
    told = {
        effect.vector_parameter if n in columns else n: unit
        for n, unit in units.items()
    }
    named = [f"{n} [{unit or 'its unit'}]" for n, unit in told.items()]
    acts = "native" if is_native(SimpleNamespace(effect=effect)) else "by `replay`"
    return (
        f"\n### `{effect.name}`\n\n{effect.description}\n\n    {effect.equation}\n\n"
        f"- at: {sort}; {acts}\n"
        f"- parameters: {', '.join(named) or 'none'}\n"
        f"- source: {effect.source}\n"
        f"- told from its like: {effect.separate_by}\n"
    )


def test_the_page_of_effects_is_the_catalogue():
    again = "run: python tests/test_diagnosis_docs.py"
    assert (DOCS / "effects.md").read_text() == effects_page(), again


def test_every_effect_has_a_group_that_the_page_shows():
    assert {e.group for e in load_catalogue().values()} == set(GROUPS)


@pytest.fixture
def preload():
    """The effect that add-an-effect.md makes."""
    text = (DOCS / "add-an-effect.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    names: dict = {}
    exec(compile(code, "add-an-effect.md", "exec"), names)
    return names["Preload"]()


def test_the_example_of_an_effect_is_one(preload, tmp_path):
    b = bench("cart_pole", tmp_path, episodes=1, seconds=0.5)
    pieces = score.cut_replay_segments(b.simulator)
    plain = b.simulator.simulate((), np.zeros((1, 0)), pieces)
    terms = preload.propose_terms(b.robot)
    assert [t.targets for t in terms] == [("joint:rail",), ("joint:pivot",)]
    assert [t.parameters[0].unit for t in terms] == ["N", "N m"]
    for term in terms:
        absent = term.parameters[0].nominal
        values = np.array([[absent], *term.initial_values])
        apart = np.abs(b.simulator.simulate((term,), values, pieces) - plain)
        apart = apart.reshape(len(values), -1).max(axis=1)
        assert apart[0] < 1e-12 and (apart[1:] > 1e-4).all()


@pytest.mark.parametrize("page", sorted(p.name for p in DOCS.glob("*.md")))
def test_links_between_pages_lead_somewhere(page):
    text = (DOCS / page).read_text()
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        if "://" not in link:
            assert (DOCS / link).exists(), link


if __name__ == "__main__":
    (DOCS / "effects.md").write_text(effects_page())

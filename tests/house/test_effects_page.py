"""Pages that speak of the code: effects.md is the catalogue, the example works."""

import json
import re
import sys
import tomllib
from importlib.metadata import EntryPoint
from types import ModuleType

import numpy as np
import pytest
from typer.testing import CliRunner

from selfheal.api import diagnose
from selfheal.diagnosis import diagnose as search
from selfheal.diagnosis import effects
from selfheal.diagnosis.effects import GROUPS, load_catalogue
from selfheal.diagnosis.output.document import format_document, list_parameters
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.output.schema import check_entries
from selfheal.diagnosis.simulation import score
from selfheal.errors import InputError
from selfheal.recording import write
from selfheal.report.phrases import state_verdict
from tests.support.effects_page import (
    format_catalogue,
    format_effect,
    make_effects_page,
)
from tests.support.paths import DOCS
from tests.support.recorded_robots import ROBOTS, bench, record


def test_the_page_of_effects_is_the_catalogue():
    again = "run: python -m tests.support.effects_page"
    assert (DOCS / "effects.md").read_text() == make_effects_page(), again


def test_every_effect_has_a_group_that_the_page_shows():
    assert {e.group for e in load_catalogue().values()} == set(GROUPS)


# ---- the example of add-an-effect.md, an effect of another package


def _block(language: str) -> str:
    text = (DOCS / "add-an-effect.md").read_text()
    (code,) = re.findall(rf"```{language}\n(.*?)```", text, flags=re.S)
    return code


@pytest.fixture
def entry(monkeypatch):
    """The entry point of the page's package, which holds the page's class."""
    table = tomllib.loads(_block("toml"))["project"]["entry-points"]
    ((group, entries),) = table.items()
    ((name, value),) = entries.items()
    package = ModuleType(value.partition(":")[0])
    monkeypatch.setitem(sys.modules, package.__name__, package)
    exec(compile(_block("python"), "add-an-effect.md", "exec"), vars(package))
    load_catalogue.cache_clear()
    yield EntryPoint(name, value, group)
    load_catalogue.cache_clear()


@pytest.fixture
def preload(entry, monkeypatch):
    """The page's effect, in the catalogue of a user who installed its package."""
    built_in = effects.entry_points(group=entry.group)
    monkeypatch.setattr(effects, "entry_points", lambda group: [*built_in, entry])
    return load_catalogue()[entry.name]


TORQUE = {"name": "torque", "value": 0.3, "low": 0.2, "high": 0.4, "unit": "N m"}
FINDING = {"effect": "preload", "target": "joint:pivot", "parameters": [TORQUE]}


def test_the_example_is_in_the_catalogue(preload):
    from selfheal.cli import app

    told = json.loads(CliRunner().invoke(app, ["effects", "--json"]).stdout)
    (own,) = (e for e in told["effects"] if e["name"] == "preload")
    assert own["says"] == preload.description
    assert len(told["effects"]) == len(load_catalogue())


def test_the_example_changes_what_is_predicted_and_is_replayed(preload, tmp_path):
    b = bench("cart_pole", tmp_path, episodes=1, seconds=0.5)
    segments = score.cut_replay_segments(b.simulator)
    plain = b.simulator.simulate((), np.zeros((1, 0)), segments)
    terms = preload.propose_terms(b.robot)
    assert [t.targets for t in terms] == [("joint:rail",), ("joint:pivot",)]
    assert [t.parameters[0].unit for t in terms] == ["N", "N m"]
    for n, term in enumerate(terms):
        values = np.array([[term.parameters[0].nominal], *term.initial_values])
        told = b.simulator.simulate((term,), values, segments)
        apart = np.abs(told - plain).reshape(len(values), -1).max(axis=1)
        assert apart[0] < 1e-12 and (apart[1:] > 1e-4).all()

        folder = tmp_path / str(n)
        _write(folder, b.path, _finding(term, values[-1]))
        (played,) = replay_recording(folder, b.recording).episodes.values()
        for c in b.simulator.channels:
            read = played.signals[c.name].values
            np.testing.assert_allclose(read, told[-1][:, c.first_column], atol=1e-9)


def _finding(term, values) -> dict:
    return {
        "effect": term.effect.name,
        "target": term.targets[0],
        "parameters": list_parameters(term, values, 0 * values),
        "native": term.effect.is_native,
    }


def _write(folder, model, finding) -> None:
    folder.mkdir()
    (folder / "patched.xml").write_text(model.read_text())
    document = {"format": "selfheal-diagnosis", "version": 1, "findings": [finding],
                "refit": []}  # fmt: skip
    (folder / "diagnosis.json").write_text(format_document(document))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"target": "body:pole"}, "target is 'body:pole'; would fit: joint: and"),
        ({"parameters": []}, r"names of parameters is \[\]; would fit: torque"),
        ({"parameters": [TORQUE | {"value": "much"}]}, "value is 'much'; would fit"),
    ],
)
def test_a_finding_of_the_example_is_checked(preload, change, said):
    check_entries("diagnosis.json", {"findings": [FINDING], "refit": []})
    entries = {"findings": [FINDING | change], "refit": []}
    with pytest.raises(InputError, match=said):
        check_entries("diagnosis.json", entries)


def test_the_example_has_its_own_words_and_its_place_on_a_page(preload):
    document = {"verdict": "explained", "findings": [FINDING], "fit": {}}
    assert state_verdict(document).startswith(
        "The joint pivot is pulled by a torque of 0.30 N m (0.20 to 0.40) that the "
        "model lacks; "
    )
    section = format_effect(preload)
    assert "### `preload`" in section and "- at: joint; by `replay`" in section
    assert "- parameters: torque [N m]\n" in section
    assert section in format_catalogue(load_catalogue().values())
    assert "preload" not in make_effects_page()


def _pull(data) -> None:
    data.qfrc_applied[0] = 0.25


@pytest.mark.slow
def test_the_example_is_diagnosed(preload, tmp_path, monkeypatch):
    """A recording of a robot that has the effect ends as a sentence of the report."""
    few = {n: load_catalogue()[n] for n in ("viscous_friction", "preload")}
    monkeypatch.setattr(search, "load_catalogue", lambda: few)
    robot = ROBOTS["pendulum"]
    (tmp_path / "model.xml").write_text(robot.xml)
    made = record(
        robot, episodes=4, seconds=1.5, noise=4e-3, seed=3, torque=_pull, finer=1
    )
    write(made, tmp_path / "recording.h5")
    found = diagnose(tmp_path / "model.xml", tmp_path / "recording.h5")
    (finding,) = found.document["findings"]
    assert (finding["effect"], finding["target"]) == ("preload", "joint:hinge")
    (torque,) = finding["parameters"]
    assert torque["low"] < 0.25 < torque["high"] and not finding["native"]
    assert "The joint hinge is pulled by a torque of 0.2" in found.page


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"phrase": "{at} has {force}"}, "phrase names 'force'; would fit: torque, at"),
        ({"target_kinds": ("tendon",)}, r"target_kinds is \('tendon',\); would fit"),
        ({"source": ""}, "effect 'preload' has no source; would fit: a text"),
        ({"parameter_sets": (("force",),)}, "has 'force'; would fit: torque"),
    ],
)
def test_an_effect_that_contradicts_itself_is_refused(entry, change, said, monkeypatch):
    for key, value in change.items():
        monkeypatch.setattr(entry.load(), key, value)
    monkeypatch.setattr(effects, "entry_points", lambda group: [entry])
    with pytest.raises(InputError, match=said):
        load_catalogue()

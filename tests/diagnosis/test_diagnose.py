"""Whole diagnoses of a pendulum that hides something, or nothing."""

import json
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis import diagnose as module
from selfheal.diagnosis.diagnose import diagnose
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.output.document import format_document
from selfheal.diagnosis.output.localization import REGIMES
from tests.support.recorded_robots import ROBOTS, record

PENDULUM = ROBOTS["pendulum"]
DRY = 0.1  # [N m]
STEP = 0.05  # [rad]
long = partial(record, PENDULUM, episodes=6, seconds=2.0, noise=4e-3, seed=1)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("pendulum") / "model.xml"
    path.write_text(PENDULUM.xml)
    return path


def _dry(model) -> None:
    model.dof_frictionloss[0] = DRY


def _within(model) -> None:
    """Errors that a careful user would grant."""
    model.dof_damping[0] *= 1.15
    model.body_mass[1] *= 1.05
    model.body_inertia[1] *= 1.05
    model.actuator_gainprm[0, 0] *= 1.1
    model.actuator_biasprm[0, 1] *= 1.1


def _sticky(data) -> None:
    """One angle that the joint likes: no effect of the catalogue."""
    x = (data.qpos[0] - 0.3) / 0.12
    data.qfrc_applied[0] = -0.3 * x * np.exp(-(x**2))


@pytest.fixture(scope="module")
def dry(model):
    """Dry friction, simulated with a time step four times as fine as the model's."""
    return diagnose(model, [long(change=_dry)])


@pytest.fixture(scope="module")
def null(model):
    """Nothing missing, and parameters that are a little wrong."""
    return diagnose(model, [long(change=_within, finer=1)])


def _rounded(recording, step: float):
    """The recording as an encoder of this step reads it."""
    episodes = {}
    for key, e in recording.episodes.items():
        coarse = {
            name: replace(s, values=step * np.round(s.values / step))
            for name, s in e.signals.items()
        }
        episodes[key] = replace(e, signals=coarse)
    return replace(recording, episodes=episodes)


@pytest.fixture(scope="module")
def dry_and_rounded(model):
    return diagnose(model, [_rounded(long(change=_dry), STEP)])


@pytest.fixture(scope="module")
def sticky(model):
    return diagnose(model, [long(torque=_sticky, finer=1)])


def _claimed(diagnosis) -> list[tuple[str, str]]:
    return [(f["effect"], f["target"]) for f in diagnosis.document["findings"]]


@pytest.fixture(scope="module", params=["refitting", "trying", "fitting everything"])
def stopped(request, model):
    """The same, stopped before the search, in it or after it."""
    said: list[str] = []
    found = diagnose(
        model,
        [long(change=_dry)],
        progress=lambda what, share: said.append(what),
        is_over=lambda share: any(what.startswith(request.param) for what in said),
    )
    return request.param, found


# what is found


def test_dry_friction_alone_is_named_at_its_joint(dry):
    assert dry.document["verdict"] == "explained"
    # nor is the model's own time step a finding
    assert _claimed(dry) == [("coulomb_friction", "joint:hinge")]


@pytest.mark.slow
def test_a_diagnosis_that_is_stopped_says_what_it_left_out(stopped, dry):
    stage, found = stopped
    said = found.document["stopped"]
    assert said["while"] and said["while"] in found.remarks[0]
    assert bool(said["not_tried"]) == (stage != "fitting everything")
    assert said["tried"] + len(said["not_tried"]) == said["of"] > 5
    assert (said["tried"] == 0) == (stage != "fitting everything")
    assert "stopped" not in dry.document


@pytest.mark.slow
def test_a_diagnosis_that_is_stopped_claims_what_it_proved(stopped, dry):
    stage, found = stopped
    if stage == "fitting everything":
        assert _claimed(found) == _claimed(dry)
    else:
        assert not _claimed(found) and found.document["verdict"] == "undecided"
    fit = found.document["fit"]
    assert fit["patched"] <= fit["refit"] * (1 + 1e-9)


def test_its_interval_holds_the_truth(dry):
    (parameter,) = dry.document["findings"][0]["parameters"]
    assert parameter["name"] == "frictionloss" and parameter["unit"] == "N m"
    assert parameter["low"] <= DRY <= parameter["high"]
    assert parameter["high"] - parameter["low"] < 0.3 * DRY


def test_its_evidence_is_strong(dry):
    evidence = dry.document["findings"][0]["evidence"]
    assert evidence["heldout_nll_gain"] > 0.3
    assert evidence["p_value"] < 1e-6 and evidence["stability"] > 0.9
    assert dry.candidates and any(c.named for c in dry.candidates)


def test_the_named_physics_removes_the_error_on_held_out_episodes(dry):
    fit = dry.document["fit"]
    assert fit["given"] > fit["refit"] > 2 * fit["patched"]
    assert fit["explainable_removed"] > 0.9
    assert len(fit["held_out"]) == 2
    assert all(name.startswith("toy.h5:00") for name in fit["held_out"])


def test_the_patched_model_loads_and_has_it(dry, model, tmp_path):
    new = mujoco.MjModel.from_xml_string(dry.patched)
    (parameter,) = dry.document["findings"][0]["parameters"]
    assert new.joint("hinge").frictionloss[0] == pytest.approx(parameter["value"])
    assert "<!-- a weight on a rod, turned by a servo -->" in dry.patched
    assert "frictionloss" in dry.diff and "frictionloss" not in model.read_text()


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_missing(null):
    assert null.document["verdict"] == "nothing"
    assert null.document["findings"] == []
    fit = null.document["fit"]
    assert fit["patched"] == fit["refit"] < fit["given"]
    assert fit["patched"] < 1.2 * fit["floor"]


@pytest.mark.slow
def test_a_coarse_encoder_is_named_beside_what_else_is_missing(dry_and_rounded):
    assert dry_and_rounded.document["verdict"] == "explained"
    assert _claimed(dry_and_rounded)[0] == ("coulomb_friction", "joint:hinge")
    assert ("quantization", "sensor:angle") in _claimed(dry_and_rounded)
    # its step is known better than from any fit
    (step,) = dry_and_rounded.document["findings"][-1]["parameters"]
    assert step["low"] <= STEP <= step["high"]
    assert step["high"] - step["low"] < 0.02 * STEP


@pytest.mark.slow
def test_an_encoder_finer_than_the_noise_is_no_finding(model):
    fine = _rounded(long(change=_within, finer=1), 4e-3)
    assert diagnose(model, [fine]).document["verdict"] == "nothing"


@pytest.mark.slow
def test_what_is_in_no_catalogue_gets_no_name_and_is_reported(sticky):
    assert sticky.document["findings"] == []
    assert sticky.document["verdict"] in ("unlisted", "partly")


# the document


@pytest.mark.parametrize(
    "name",
    ["dry", *(pytest.param(n, marks=pytest.mark.slow) for n in ("null", "sticky"))],
)
def test_the_document_is_the_contracts(name, request):
    diagnosis = request.getfixturevalue(name)
    document = json.loads(
        format_document(diagnosis.document),
        parse_constant=pytest.fail,
    )
    assert document == diagnosis.document
    assert set(document) == {
        "format", "version", "verdict", "findings", "refit", "unidentified", "fit"
    }  # fmt: skip
    for group in document["unidentified"]:
        assert set(group) == {"together", "words", "fixed_by"}
        assert len(group["together"]) > 1
    assert (document["format"], document["version"]) == ("selfheal-diagnosis", 1)
    assert document["verdict"] in ("explained", "partly", "unlisted", "nothing")
    for finding in document["findings"]:
        _check_finding(finding)
    for entry in document["refit"]:
        assert set(entry) == {"parameter", "given", "value", "low", "high", "unit"}
        assert entry["low"] <= entry["value"] <= entry["high"]
        assert isinstance(entry["unit"], str)
    fit = document["fit"]
    assert set(fit) == {
        "held_out", "given", "refit", "patched", "floor", "explainable_removed",
        "horizons", "errors", *(["plain"] if "plain" in fit else [])
    }  # fmt: skip
    numbers = fit.keys() & {"given", "refit", "patched", "floor", "plain"}
    assert all(isinstance(fit[k], float) for k in numbers)
    assert fit["floor"] <= fit["patched"]


def _check_finding(finding) -> None:
    assert {"effect", "target", "equivalent", "separate_by", "parameters", "where",
            "evidence"} <= set(finding)  # fmt: skip
    assert finding["effect"] in load_catalogue() and ":" in finding["target"]
    assert len(finding["equivalent"]) <= 3
    assert finding["effect"] not in finding["equivalent"]
    assert set(finding["equivalent"]) <= set(load_catalogue())
    for p in finding["parameters"]:
        assert set(p) - {"given"} == {"name", "value", "low", "high", "unit"}
        assert p["low"] <= p["value"] <= p["high"]
    where, evidence = finding["where"], finding["evidence"]
    assert where["regime"] in (*REGIMES, "always")
    for signal in where["signals"]:
        assert set(signal) == {"name", "share_of_error", "p_value"}
        assert 0 <= signal["share_of_error"] <= 1 and 0 <= signal["p_value"] <= 1
    for window in where["windows"]:
        assert set(window) == {"episode", "start", "end"}
        assert window["start"] < window["end"]
    assert set(evidence) == {
        "heldout_nll_gain", "p_value", "stability", "heldout_error_growth"
    }  # fmt: skip
    growth = evidence["heldout_error_growth"]
    assert growth is None or growth > 0
    assert 0 <= evidence["p_value"] <= 0.05 and 0 <= evidence["stability"] <= 1


@pytest.mark.parametrize("name", ["dry", pytest.param("null", marks=pytest.mark.slow)])
def test_refitted_values_stay_in_the_contracts_bounds(name, request):
    reach = {"mass": 0.15, "inertia": 0.15, "length": 0.03}
    for entry in request.getfixturevalue(name).document["refit"]:
        most = reach.get(entry["parameter"].partition("/")[2], 0.3) + 1e-9
        assert abs(entry["value"] / entry["given"] - 1) <= most


def test_beside_the_document_there_is_what_a_page_draws(dry):
    assert [s.name for s in dry.signals] == ["angle"]
    (signal,) = dry.signals
    for value, low, high in (signal.given, signal.refit, signal.patched):
        assert low <= value <= high
    assert dry.traces and dry.simulations > 100 and dry.seconds > 0
    for trace in dry.traces:
        sizes = {trace.time.size, trace.read.size, trace.patched.size}
        assert len(sizes) == 1 and (np.diff(trace.time) > 0).all()


# with a small catalogue, fast


@pytest.fixture
def few(monkeypatch):
    """A catalogue of three."""
    names = ("coulomb_friction", "command_delay", "sensor_bias")
    small = {name: load_catalogue()[name] for name in names}
    monkeypatch.setattr(module, "load_catalogue", lambda: small)


short = partial(record, PENDULUM, episodes=4, seconds=1.5, noise=4e-3, seed=3)


@pytest.mark.slow
def test_a_search_that_is_stopped_on_its_way_claims_what_it_has_found(few, model):
    """No simulation had been fitted yet."""
    said: list[str] = []
    found = diagnose(
        model,
        [short(change=_dry)],
        progress=lambda what, share: said.append(what),
        is_over=lambda share: sum(s.startswith("trying") for s in said) > 1,
    )
    assert _claimed(found) == [("coulomb_friction", "joint:hinge")]
    assert found.document["stopped"]["not_tried"]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_diagnosis(few, model):
    messages: list[str] = []
    recording = short(change=_dry, finer=1)
    first, second = (
        diagnose(
            model,
            [recording],
            seed=5,
            progress=lambda what, share: messages.append(what),
        )
        for _ in range(2)
    )
    assert first.document == second.document and first.patched == second.patched
    assert any("coulomb_friction" in what for what in messages)
    assert _claimed(first) == [("coulomb_friction", "joint:hinge")]


@pytest.mark.slow
def test_a_slide_joint_is_reported_in_newtons_and_meters(few, tmp_path):
    robot = ROBOTS["cart_pole"]
    (tmp_path / "model.xml").write_text(robot.xml)

    def rubbing(model):
        model.dof_frictionloss[0] = 0.5

    recording = record(
        robot, episodes=4, seconds=1.5, noise=1e-3, change=rubbing, finer=1
    )
    found = diagnose(tmp_path / "model.xml", [recording])
    assert _claimed(found) == [("coulomb_friction", "joint:rail")]
    (parameter,) = found.document["findings"][0]["parameters"]
    assert parameter["unit"] == "N"
    assert parameter["value"] == pytest.approx(0.5, rel=0.1)
    units = {e["parameter"]: e["unit"] for e in found.document["refit"]}
    for name, unit in {"joint:rail/damping": "N s/m",
                       "joint:pivot/damping": "N m s/rad"}.items():  # fmt: skip
        assert units.get(name, unit) == unit


def test_what_is_held_out_is_what_was_asked_for(few, model):
    found = diagnose(model, [short(finer=1)], held_out=["000", "toy.h5:002[0.2,1.0]"])
    held = found.document["fit"]["held_out"]
    assert held[0] == "toy.h5:000" and len(held) == 2
    assert held[1].startswith("toy.h5:002[")

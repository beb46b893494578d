"""Every effect: absent it is not there, present it shows, and a patch says the same."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import GROUPS, find_effect, load_catalogue
from selfheal.diagnosis.effects.base import is_distinct
from selfheal.diagnosis.effects.inertia import (
    add_mass,
    set_spatial_inertia,
    spatial_inertia,
)
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.estimation.least_squares import Fit
from selfheal.diagnosis.output.build_result import build_patch, patch_or_nominal
from selfheal.diagnosis.output.document import list_parameters
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.simulation import score
from selfheal.errors import UnknownNameError
from tests.support.recorded_robots import ROBOTS, bench, places

NAMES = tuple(load_catalogue())
ALWAYS_THERE = {"limb_loss", "joint_jam"}  # no value undoes them
# a gap stands behind a rotor of some inertia, and MuJoCo's stops are soft
NEARLY_ABSENT = {"backlash": 0.02}  # of the signal's spread
NEVER_ABSENT = {*ALWAYS_THERE, "compliance"}  # so stiff a spring does not compute


@pytest.fixture(scope="module")
def benches(tmp_path_factory):
    """Robots of different shape, their recordings, and what they predict as given."""
    return {n: _bench(ROBOTS[n], tmp_path_factory.mktemp(n)) for n in places()}


def _bench(robot, folder):
    b = bench(robot, folder, episodes=2, seconds=0.8, seed=4)
    pieces = score.cut_replay_segments(b.simulator)
    plain = b.simulator.simulate((), np.zeros((1, 0)), pieces)[0]
    return SimpleNamespace(**vars(b), segments=pieces, plain=plain)


def _terms(benches, name, most=2):
    """Some places of an effect on each robot: the first, and the last."""
    for b in benches.values():
        found = find_effect(name).propose_terms(b.robot)
        chosen = {0, len(found) - 1} if len(found) >= most else set(range(len(found)))
        yield from ((b, found[i]) for i in sorted(chosen))


def _absent(term) -> np.ndarray:
    return np.array([p.nominal for p in term.parameters], float)


def _present(term) -> np.ndarray:
    """A start of the search; a step from it where that is no change."""
    start = np.array(term.initial_values[0], float)
    return start + term.scale * (start.size and np.allclose(start, _absent(term)))


def _moved(b, terms, values) -> float:
    """Largest change of any prediction, of the signals' own spread."""
    told = b.simulator.simulate(terms, np.asarray(values, float)[None], b.segments)[0]
    apart = np.abs(told - b.plain)
    return max(
        apart[:, c.columns].max() / c.spread
        for c in b.simulator.channels
        if c.is_scored
    )


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_explains_itself(name):
    e = find_effect(name)
    assert e.group in GROUPS
    assert e.description.endswith(".") and e.equation and e.source and e.separate_by


def test_a_friction_that_grows_with_speed_is_no_stribeck_friction(benches):
    for term in find_effect("stribeck_friction").propose_terms(benches["arm"].robot):
        assert not term.is_negligible(np.array([0.1, 0.3, 0.1]))
        assert term.is_negligible(np.array([0.3, 0.1, 0.1]))


def test_an_unknown_effect_is_refused_with_those_there_are():
    with pytest.raises(UnknownNameError, match="coulomb_friction"):
        find_effect("friction")


@pytest.mark.parametrize("name", NAMES)
def test_terms_are_as_their_effect_declares(name, benches):
    effect = find_effect(name)
    units = {p.name: p.unit for p in effect.parameters}
    fields = {f.name: f for f in effect.finding_fields}
    seen, sets = 0, set()
    for b in benches.values():
        for term in effect.propose_terms(b.robot):
            seen += 1
            stated = list_parameters(term, _present(term), 0 * _present(term))
            sets.add(tuple(p["name"] for p in stated))
            for target in term.targets:
                assert target.partition(":")[0] == effect.target_kinds[0]
                _there(b, target)
            for p in stated:
                valid = _units(units[p["name"]], b, term.targets[0])
                if p["name"] == "kp":  # a motor's, in its own units
                    valid |= {unit.partition("/")[0] + "/ctrl" for unit in valid}
                assert p["unit"] in ({"rad"} if p["name"] == "phase" else valid)
            for key, value in term.finding_fields.items():
                if kind := fields[key].target_kind:
                    assert value.startswith(f"{kind}:")
                else:
                    assert value in fields[key].values
            required = {f.name for f in fields.values() if f.is_required}
            assert required <= set(term.finding_fields)
    assert seen, "no robot has a place for it"
    assert sets <= set(effect.list_parameter_sets())
    assert {name for names in sets for name in names} == set(units)


def _there(b, target) -> None:
    sort, _, name = target.partition(":")
    if sort == "sensor":
        assert name in {c.name for c in b.simulator.channels}
    elif sort != "world":
        getattr(b.robot.model, sort)(name)


def _units(unit, b, target) -> set[str]:
    """The declared unit, or for a slide the same with N and m."""
    if unit is None:
        return {c.unit for c in b.simulator.channels if f"sensor:{c.name}" == target}
    name = target.partition(":")[2]
    if name not in ("rail", "push"):
        return {unit}
    slide = unit.replace("N m", "N").replace("rad", "m")
    return {"kg" if unit == "kg m^2" else slide}


@pytest.mark.parametrize("name", NAMES)
def test_a_place_is_found_again_by_its_finding(name, benches):
    """In any model; a replay knows no more of a place than this."""
    selection_only = {"still", "parts", "kind"}
    for b in benches.values():
        for term in find_effect(name).propose_terms(b.robot):
            for target, place in zip(term.targets, term.places, strict=True):
                parameters = list_parameters(term, _present(term), 0 * _present(term))
                finding = {"target": target, "parameters": parameters}
                again = term.effect.find_place(
                    b.robot.model, finding | dict(term.finding_fields)
                )
                assert set(place) - selection_only <= set(again)
                assert all(again[key] == place[key] for key in set(place) & set(again))


@pytest.mark.parametrize("name", NAMES)
def test_starts_and_absent_values_are_within_bounds(name, benches):
    for _, term in _terms(benches, name):
        assert len(term.places) == len(term.targets) and term.initial_values
        for start in term.initial_values:
            assert (term.low <= start).all() and (start <= term.high).all()
        assert (term.scale > 0).all() and (term.low < term.high).all()


CAN_BE_ABSENT = [n for n in NAMES if n not in NEVER_ABSENT]


@pytest.mark.parametrize("name", CAN_BE_ABSENT)
def test_at_its_absent_values_an_effect_is_not_there(name, benches):
    for b, term in _terms(benches, name):
        moved = _moved(b, (term,), _absent(term))
        assert moved <= NEARLY_ABSENT.get(name, 1e-7), (term.label, moved)


# a model that states much of what an effect could be
STATING = {
    "arm": {
        'damping="0.03"': 'damping="0.03 0.002"',
        'armature="0.005"': 'armature="0.005" frictionloss="0.05" stiffness="0.5" '
        'springref="0.2" limited="true" range="-0.6 0.5"',
        'kp="10" kv="0.4"': 'kp="10" kv="0.4" forcerange="-1 1.2" delay="0.01" '
        'nsample="8"',
    },
    "box": {
        'friction="0.6 0.005 0.0001"/>\n    <body': 'friction="0.6 0.005 0.0001" '
        'solref="0.01 0.7"/>\n    <body',
        'friction="0.6 0.005 0.0001"/>\n    </body': 'friction="0.9 0.005 0.0001"/>\n'
        "    </body",
    },
}


@pytest.fixture(scope="module")
def stating(tmp_path_factory):
    """Robots whose models state springs, stops, limits, dry friction, a soft floor."""
    found = {}
    for name, changes in STATING.items():
        xml = ROBOTS[name].xml
        for old, new in changes.items():
            assert old in xml
            xml = xml.replace(old, new)
        robot = replace(ROBOTS[name], xml=xml)
        found[name] = _bench(robot, tmp_path_factory.mktemp(name))
    return found


@pytest.mark.parametrize("name", CAN_BE_ABSENT)
def test_an_absent_effect_leaves_what_the_model_states(name, stating):
    most = NEARLY_ABSENT.get(name, 1e-7)
    for b in stating.values():
        for term in find_effect(name).propose_terms(b.robot):
            assert _moved(b, (term,), _absent(term)) <= most, term.label


def _told(b, *pairs):
    """What terms of these values predict."""
    values = np.concatenate([np.atleast_1d(v) for _, v in pairs])
    return b.simulator.simulate([t for t, _ in pairs], values[None], b.segments)[0]


def _of_elbow(b, name, **note):
    """An effect's term at the arm's second joint, or its actuator."""
    wanted = ("joint:elbow",), ("actuator:elbow_servo",)
    return next(
        t for t in find_effect(name).propose_terms(b.robot)
        if t.targets in wanted and note.items() <= t.finding_fields.items()
    )  # fmt: skip


def test_a_stop_or_a_limit_beyond_the_stated_one_changes_nothing(stating):
    b = stating["arm"]
    wider = [
        ("hard_stop", {"side": 1}, (0.55, 0.1)),
        ("hard_stop", {"side": -1}, (-0.65, 0.1)), ("torque_saturation", {}, (1.25,)),
    ]  # fmt: skip
    for name, note, values in wider:
        assert _moved(b, (_of_elbow(b, name, **note),), values) < 1e-7, name


def test_dry_friction_without_its_peculiarity_is_coulomb_friction(stating):
    b = stating["arm"]
    plain = _told(b, (_of_elbow(b, "coulomb_friction"), 0.12))
    stribeck = _told(b, (_of_elbow(b, "stribeck_friction"), (0.12, 0.12, 0.1)))
    asymmetric = _told(b, (_of_elbow(b, "asymmetric_friction"), (0.12, 0.12)))
    np.testing.assert_allclose(stribeck, plain, atol=1e-9)
    np.testing.assert_allclose(asymmetric, plain, atol=1e-9)


@pytest.mark.parametrize("name", ["stribeck_friction", "asymmetric_friction"])
def test_dry_friction_adds_to_that_of_the_load_in_any_order(name, stating):
    b = stating["arm"]
    load = _of_elbow(b, "load_dependent_friction"), 0.2
    own = _of_elbow(b, name), (0.1, 0.2, 0.1)[: len(_of_elbow(b, name).parameters)]
    both = _told(b, load, own)
    np.testing.assert_allclose(both, _told(b, own, load), atol=1e-9)
    assert np.abs(both - _told(b, own)).max() > 1e-4


def test_a_load_rubs_in_a_gear_whose_motor_gives_nothing(benches):
    """Where the mean of both sides is meant, and not what the motor gives."""
    b = benches["arm"]
    motor = _of_elbow(b, "load_dependent_friction")
    both = _of_elbow(b, "load_dependent_friction", side="both")
    assert motor.key != both.key and not is_distinct(both, [motor])
    still = SimpleNamespace(
        actuator_torque=np.array([[0.0, 0.0], [0.3, 0.4], [0.0, -0.4]]),
        bias_torque=np.array([[0.5, -0.6], [0.3, 0.4], [0.0, 0.4]]),
    )
    for term, torque in (motor, [0.0, 0.4, 0.4]), (both, [0.3, 0.4, 0.0]):
        still.frictionloss = np.full((3, 2), 0.1)
        term.effect.apply_forces(still, term.places[0], np.full((3, 1), 0.2))
        rubs = np.stack([np.full(3, 0.1), 0.1 + 0.2 * np.array(torque)], axis=1)
        np.testing.assert_allclose(still.frictionloss, rubs)
    assert _moved(b, (both,), (0.2,)) > 1e-3


def test_what_the_ground_is_like_is_what_its_contact_is_like(stating):
    b = stating["box"]
    for name, field, values in (
        ("ground_friction", "friction", (0.25,)),
        ("ground_compliance", "solref", (0.03, 0.4)),
    ):
        (term,) = find_effect(name).propose_terms(b.robot)
        plant = b.simulator.compiler.compile_variant([term])
        contact = _resting(plant.build_model([term], np.array(values)))
        told = np.atleast_1d(getattr(contact, field))[: len(values)]
        np.testing.assert_allclose(told, values)


@pytest.mark.parametrize("geom", ["floor", "box"])
def test_of_two_geoms_that_with_priority_says_what_the_contact_is_like(tmp_path, geom):
    marked = re.sub(f'name="{geom}" type', 'priority="1" \\g<0>', ROBOTS["box"].xml)
    b = _bench(replace(ROBOTS["box"], xml=marked), tmp_path)
    for name, field, values in (
        ("ground_friction", "friction", (0.25,)),
        ("ground_compliance", "solref", (0.03, 0.4)),
    ):
        (term,) = find_effect(name).propose_terms(b.robot)
        model = b.simulator.compiler.compile_variant([term]).build_model(
            [term], np.array(values)
        )
        told = np.atleast_1d(getattr(_resting(model), field))[: len(values)]
        np.testing.assert_allclose(told, values)
        changed = getattr(model, f"geom_{field}") != getattr(
            b.simulator.compiler.nominal, f"geom_{field}"
        )
        assert model.geom(int(np.flatnonzero(changed.any(axis=1))[0])).name == geom
        assert changed.any(axis=1).sum() == 1


def _resting(model):
    """A contact of the box that lies on the floor."""
    data = mujoco.MjData(model)
    data.qpos[:3] = 0, 0, 0.039
    mujoco.mj_forward(model, data)
    return data.contact[0]


def test_the_stiffer_a_compliant_drive_the_less_it_shows(benches):
    b = benches["arm"]
    for term in find_effect("compliance").propose_terms(b.robot):
        k, d = term.scale
        moved = [_moved(b, (term,), (s * k, s**0.5 * d)) for s in (0.3, 1, 3, 10)]
        assert np.all(np.diff(moved) < 0)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_light_rotor_does_not_diverge(integrator, tmp_path):
    xml = re.sub(' armature="[^"]*"', "", ROBOTS["arm"].xml)
    b = _bench(
        replace(ROBOTS["arm"], xml=xml.replace("implicitfast", integrator)), tmp_path
    )
    for name in ("backlash", "compliance", "limb_loss"):
        for term in find_effect(name).propose_terms(b.robot):
            for values in (*term.initial_values, term.low, term.high):
                assert np.isfinite(_moved(b, (term,), values)), (term.label, values)


def test_so_stiff_a_drive_as_a_search_may_try_hardly_shows(benches):
    b = benches["arm"]
    for term in find_effect("compliance").propose_terms(b.robot):
        assert _moved(b, (term,), (term.high[0], term.scale[1])) < 0.01


@pytest.mark.parametrize("name", NAMES)
def test_present_an_effect_changes_what_is_predicted(name, benches):
    moved = [_moved(b, (t,), _present(t)) for b, t in _terms(benches, name)]
    assert np.isfinite(moved).all() and max(moved) > 1e-4


@pytest.mark.parametrize("name", NAMES)
def test_the_patch_and_its_replay_predict_what_the_diagnosis_did(
    name, benches, tmp_path
):
    """With every stated value changed too; on the patched and on the given model."""
    for n, (b, term) in enumerate(_terms(benches, name)):
        # a contact makes much of a text's last digit
        limit = 0.03 if b.robot.has_contact else 3e-6
        _check_replay(b, [term], tmp_path / str(n), limit)


@pytest.mark.parametrize("name", ["backlash", "compliance"])
def test_a_second_joint_inherits_nothing_and_counts_in_the_models_unit(name, tmp_path):
    b = _pendulum(tmp_path, **HEIRS)
    for n, term in enumerate(find_effect(name).propose_terms(b.robot)):
        _check_replay(b, [term], tmp_path / str(n), 3e-6)


# a joint in degrees, in a frame, with defaults that a second one must not take over
HEIRS = {
    "<worldbody>": '<default><joint damping="0.02 0.01" armature="0.002" margin="0.1" '
    'stiffness="0.3 0.1" springref="20" frictionloss="0.01" range="-200 200" '
    'solimplimit="0.5 0.6 0.01"/></default>\n  <worldbody>',
    '<joint name="hinge" type="hinge" axis="0 1 0"': '<frame euler="0 0 90">'
    '<joint name="hinge" axis="1 0 0" stiffness="0"',
    'armature="0.002"/>\n': 'armature="0.002"/></frame>\n',
}


def test_a_second_joint_stands_behind_the_last_of_a_body(tmp_path):
    xml = ROBOTS["arm"].xml
    shoulder, elbow = re.findall("<joint name=.*?/>", xml)
    xml = xml.replace(elbow, "").replace(shoulder, shoulder + elbow)
    b = _bench(replace(ROBOTS["arm"], xml=xml), tmp_path)
    for name in ("backlash", "compliance"):
        found = {t.targets for t in find_effect(name).propose_terms(b.robot)}
        assert found == {("joint:elbow",)}


def test_two_joints_with_play_are_one_each(benches, tmp_path):
    b = benches["arm"]
    found = find_effect("backlash").propose_terms(b.robot)
    terms = [t for t in found if t.finding_fields["measured"] == "motor"]
    assert len(terms) == 2
    _check_replay(b, terms, tmp_path / "both", 3e-6)


def test_a_joint_with_play_may_bend_too(benches, tmp_path):
    """What lies between has some inertia: MuJoCo warns where it has none."""
    b = benches["arm"]
    own = [_of_elbow(b, n, measured="motor") for n in ("compliance", "backlash")]
    plant = b.simulator.compiler.compile_variant(own)
    assert (plant.model.dof_armature > 0).sum() == plant.model.nv - 1
    _check_replay(b, own, tmp_path / "both", 3e-5)


def test_a_joints_own_name_may_end_as_an_added_ones(tmp_path):
    """As a robot's elbow_flex; what a patch adds to it is known all the same."""
    text, robot = ROBOTS["arm"].xml, ROBOTS["arm"]
    for old, name in (("shoulder", "shoulder_play"), ("elbow", "elbow_flex")):
        text = text.replace(f'name="{old}" type', f'name="{name}" type')
        text = text.replace(f'joint="{old}"', f'joint="{name}"')
    signals = {"elbow": ("joint_position", "elbow_flex", "rad")}
    b = _bench(replace(robot, xml=text, signals=signals), tmp_path)
    terms = [
        find_effect(name).propose_terms(b.robot) for name in ("backlash", "compliance")
    ]
    assert len(terms[0]) == len(terms[1]) == 3
    for n, own in enumerate(terms):
        _check_replay(b, [own[0], own[1]], tmp_path / str(n), 3e-6)


def test_a_second_joint_takes_no_name_that_the_model_has(tmp_path):
    text = ROBOTS["arm"].xml.replace('"shoulder"', '"elbow_flex"')
    signals = {"elbow": ("joint_position", "elbow", "rad")}
    b = _bench(replace(ROBOTS["arm"], xml=text, signals=signals), tmp_path)
    found = {t.targets for t in find_effect("compliance").propose_terms(b.robot)}
    assert found == {("joint:elbow_flex",)}


def test_a_replay_applies_what_the_text_could_not_say(tmp_path):
    """Balls that are made have no text of their own; a longer link moves them."""
    ball = '<geom size="0.01" pos="0.1 0 0" mass="0.01"/>'
    made = f'<replicate count="2" offset="0 0 0.01">{ball}</replicate>'
    text = ROBOTS["arm"].xml.replace("<site", f"{made}<site")
    b = _bench(replace(ROBOTS["arm"], xml=text), tmp_path)
    own = [_of_elbow(b, "compliance", measured="motor")]
    stated = tuple(build_nominal_terms(b.robot))
    factors, present = _factors(stated), [_present(t) for t in own]
    terms, values = (*stated, *own), np.concatenate([factors, *present])
    case = SimpleNamespace(
        compiler=b.simulator.compiler, training=b.simulator, robot=b.robot
    )
    found = Fit(terms, values, np.zeros(0), np.zeros((0, 0)))
    same, diff, edits, unpatched = patch_or_nominal(case, found)
    assert (same, diff, edits) == (text, "", []) and "<replicate>" in unpatched
    document = _document(stated, factors, own, present) | {"unpatched": unpatched}
    _write(tmp_path / "out", same, document)
    told = b.simulator.simulate(terms, values[None], b.segments)[0]
    assert _apart(b, replay_recording(tmp_path / "out", b.recording), told) < 3e-6


def _check_replay(b, own, folder, limit) -> None:
    """That a patch with these effects says what simulating them did, and a replay."""
    stated = tuple(build_nominal_terms(b.robot))
    factors, present = _factors(stated), [_present(t) for t in own]
    terms, values = (*stated, *own), np.concatenate([factors, *present])
    told = b.simulator.simulate(terms, values[None], b.segments)[0]
    assert np.isfinite(told).all()
    text = _patch(b, terms, values)
    _write(folder, text, _document(stated, factors, own, present))
    for model in (None, b.path):
        apart = _apart(b, replay_recording(folder, b.recording, model=model), told)
        assert apart < limit, (own[0].label, own[0].note, model, apart)


def _patch(b, terms, values) -> str:
    """The text of a patch that says so much."""
    case = SimpleNamespace(
        compiler=b.simulator.compiler, training=b.simulator, robot=b.robot
    )
    return build_patch(case, Fit(terms, values, np.zeros(0), np.zeros((0, 0))))[0]


def _factors(stated) -> np.ndarray:
    rng = np.random.default_rng(2)
    reach = np.array([t.parameters[0].high - 1 for t in stated])
    return 1 + 0.6 * reach * rng.uniform(-1, 1, len(stated))


def _document(stated, factors, own, present) -> dict:
    findings = [
        {"effect": term.effect.name, "target": target, **term.finding_fields,
         "native": term.effect.is_native,
         "parameters": list_parameters(term, values, 0 * values)}
        for term, values in zip(own, present, strict=True)
        for target in term.targets
    ]  # fmt: skip
    refit = [
        {"parameter": t.targets[0], "given": t.finding_fields["value"],
         "value": t.finding_fields["value"] * float(f)}
        for t, f in zip(stated, factors, strict=True)
    ]  # fmt: skip
    return {"format": "selfheal-diagnosis", "version": 1, "findings": findings,
            "refit": refit}  # fmt: skip


def _write(folder, text, document) -> None:
    folder.mkdir()
    (folder / "patched.xml").write_text(text)
    (folder / "diagnosis.json").write_text(json.dumps(document))


def _apart(b, played, told) -> float:
    """Largest difference of a replay to a prediction, of the effect's own size."""
    worst = 0.0
    for c in b.simulator.channels:
        read = np.concatenate([
            e.signals[c.name].values.reshape(-1, c.width)
            for e in played.episodes.values()
        ])  # fmt: skip
        size = np.abs(told - b.plain)[:, c.columns].max()
        apart = np.abs(read - told[:, c.columns]).max()
        worst = max(worst, apart / max(size, 1e-3 * c.spread))
    return worst


@pytest.mark.parametrize("share", [0.3, 1.0, 1.7])
@pytest.mark.parametrize("stated", ["", 'delay="0.004" nsample="4" interp="linear"'])
def test_a_delay_is_replayed_as_it_was_found(share, stated, tmp_path):
    """Though MuJoCo makes a whole step of a part of one; beside a stated delay too."""
    servo = '<position name="servo" '
    b = _pendulum(tmp_path, **{servo: f"{servo}{stated} "})
    (term,) = find_effect("command_delay").propose_terms(b.robot)
    values = np.array([share * b.simulator.timestep])
    told = b.simulator.simulate((term,), values[None], b.segments)[0]
    document = _document((), (), [term], [values])
    _write(tmp_path / "out", _patch(b, (term,), values), document)
    assert _apart(b, replay_recording(tmp_path / "out", b.recording), told) < 3e-6


# bounds and places


def _pendulum(folder, **changes):
    """A pendulum whose model has some words changed."""
    xml = ROBOTS["pendulum"].xml
    for old, new in changes.items():
        assert old in xml
        xml = xml.replace(old, new)
    return _bench(replace(ROBOTS["pendulum"], xml=xml), folder)


def test_friction_may_be_as_large_as_what_motors_were_asked_for(benches):
    b = benches["cart_pole"]  # without gravity on its rail, and a motor
    (push,) = b.robot.actuators
    for name in ("coulomb_friction", "stribeck_friction", "asymmetric_friction"):
        rail, _ = find_effect(name).propose_terms(b.robot)
        assert (rail.high[:2] >= 0.99 * push.max_force).all()


def test_a_hand_may_bear_as_much_as_all_that_moves(benches):
    b = benches["arm"]
    for term in find_effect("payload").propose_terms(b.robot):
        assert term.high[0] >= sum(body.mass for body in b.robot.bodies)


def test_a_hand_carries_what_the_arm_that_it_is_fixed_to_does_not(tmp_path):
    hand = """<body name="hand" pos="0 0 -0.2"><geom size="0.03" mass="0.1"/>
      <body name="tip" pos="0 0 -0.05"/></body></body></worldbody>"""
    b = _pendulum(tmp_path, **{"</body>\n  </worldbody>": hand})
    targets = {
        name: [t.targets for t in find_effect(name).propose_terms(b.robot)]
        for name in ("payload", "com_shift", "mount_shift")
    }
    assert targets == {
        "payload": [("body:hand",)],
        "com_shift": [("body:rod",), ("body:hand",)],
        "mount_shift": [("body:hand",), ("body:tip",)],
    }


def test_a_robot_that_touches_itself_needs_no_ground(tmp_path):
    signals = {"pole": ("joint_position", "pivot", "rad")}
    robot = replace(ROBOTS["cart_pole"], xml=CLAPPER, signals=signals)
    b = _bench(robot, tmp_path)
    assert b.robot.has_contact
    for name in ("ground_friction", "ground_compliance"):
        assert find_effect(name).propose_terms(b.robot) == []


CLAPPER = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="left" pos="-0.02 0 1"><joint name="pivot" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/></body>
  <body name="right" pos="0.02 0 1"><joint name="other" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/></body>
  </worldbody><actuator><motor name="push" joint="pivot"/></actuator></mujoco>"""


def test_wind_needs_something_that_blows(tmp_path):
    still = _pendulum(tmp_path)
    assert not find_effect("wind").propose_terms(still.robot)
    thick = _pendulum(tmp_path, **{"<option": '<option viscosity="0.1"'})
    assert find_effect("wind").propose_terms(thick.robot)


@pytest.mark.parametrize(
    ("axis", "azimuths"),
    [("0 1 0", (0, 180)), ("1 1 0", (-45, 135)), ("1 0 0.5", (0, 90, 180, -90))],
)
def test_a_flat_robot_stands_on_no_slope_across_its_plane(axis, azimuths, tmp_path):
    b = _pendulum(tmp_path, **{'axis="0 1 0"': f'axis="{axis}"'})
    starts = [
        s for t in find_effect("slope").propose_terms(b.robot) for s in t.initial_values
    ]
    told = np.rad2deg([azimuth for _, azimuth in starts])
    assert np.allclose(told, azimuths)


def test_what_moves_upright_alone_knows_no_slope(tmp_path):
    upright = {'type="hinge" axis="0 1 0"': 'type="slide" axis="0 0 1"'}
    b = _pendulum(tmp_path, **upright)
    assert not find_effect("slope").propose_terms(b.robot)


def test_a_servo_with_a_gear_sums_up_in_another_unit(tmp_path):
    assert find_effect("integral_action").propose_terms(_pendulum(tmp_path).robot)
    geared = _pendulum(tmp_path, **{'kv="0.1"': 'kv="0.1" gear="2"'})
    assert not find_effect("integral_action").propose_terms(geared.robot)


def test_a_servo_that_had_settled_goes_on_holding_its_load(tmp_path):
    pose = 0.8
    robot = replace(
        ROBOTS["pendulum"],
        command=lambda t, rng: np.full((len(t), 1), pose),
        begin=lambda rng: (np.array([pose]), np.zeros(1)),
    )
    b = _bench(robot, tmp_path)
    fresh, settled = find_effect("integral_action").propose_terms(b.robot)
    assert settled.is_negligible(0.1 * settled.scale)  # no more than a torque
    kp = b.robot.model.actuator_gainprm[0, 0]

    def sag(term, most):
        told = b.simulator.simulate((term,), np.array([[kp, most]]), b.segments)[0]
        return np.abs(told - pose).max()

    assert sag(settled, 10.0) < 1e-3 < 20e-3 < sag(fresh, 10.0)
    assert sag(settled, 1e-3) == pytest.approx(sag(fresh, 1e-3), rel=0.1)


def test_a_servo_lets_go_as_soon_as_its_error_turns():
    """As MuJoCo's pid does: what its sum cannot hold is forgotten."""
    ki, imax, step = 2.0, 0.5, 0.01
    place, values = {"actuator": 0, "qpos": 0, "dof": 0}, np.array([[ki, imax]])
    sums = {0: np.zeros(1)}

    def torque(error, steps):
        for _ in range(steps):
            now = SimpleNamespace(
                ctrl=np.array([[error]]),
                qpos=np.zeros((1, 1)),
                applied_force=np.zeros((1, 1)),
                integral_errors=sums,
                timestep=step,
            )
            find_effect("integral_action").apply_forces(now, place, values)
        return now.applied_force[0, 0]  # fmt: skip

    assert torque(1.0, 1000) == pytest.approx(imax)
    turned = round(2 * imax / ki / step)
    assert torque(-1.0, turned // 2 + 1) == pytest.approx(0.0, abs=1e-9)
    assert torque(-1.0, 1000) == pytest.approx(-imax)


def test_a_lag_keeps_the_range_that_a_servo_inherited(tmp_path):
    b = _pendulum(
        tmp_path,
        **{'armature="0.002"': 'armature="0.002" range="-40 40"',
           'kv="0.1"': 'kv="0.1" inheritrange="1"'},
    )  # fmt: skip
    terms = tuple(find_effect("actuator_lag").propose_terms(b.robot))
    text = _patch(b, terms, np.array([0.05]))
    model = mujoco.MjModel.from_xml_string(text)
    assert model.actuator_ctrllimited.all()
    np.testing.assert_allclose(model.actuator_ctrlrange, np.deg2rad([[-40, 40]]))


# bodies


@pytest.mark.parametrize("seed", range(6))
def test_a_body_given_an_inertia_has_it(seed):
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    root = rng.normal(size=(3, 3)) * 0.05
    inertia = root @ root.T + 0.1 * np.eye(3)
    set_spatial_inertia(model, 1, 1.0, np.zeros(3), inertia)
    np.testing.assert_allclose(spatial_inertia(model, 1), inertia, atol=1e-12)


def test_a_rod_that_bears_more_keeps_its_axes():
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    axes = model.body_iquat[1].copy()
    for mass in (0.0, 1e-9, 0.5):
        add_mass(model, 1, mass, np.array([0.2, 0.0, 0.0]))  # on its axis
        np.testing.assert_allclose(model.body_iquat[1], axes, atol=1e-12)
    assert model.body_mass[1] > 0.8


@pytest.mark.parametrize(
    ("name", "faint", "told"),
    [
        ("slope", (1.0, 0.3), (0.2, 0.3)),  # as steep as may be
        ("asymmetric_friction", (0.1, 0.101), (0.1, 0.2)),  # alike both ways
        ("backlash", (0.0,), (0.01,)),  # absent
    ],
)
def test_what_stands_for_another_thing_or_for_nothing_is_faint(
    name, faint, told, benches
):
    for term in find_effect(name).propose_terms(benches["arm"].robot):
        assert term.is_negligible(np.array(faint))
        assert not term.is_negligible(np.array(told))


def test_a_motor_is_weak_more_seldom_than_its_load_is_heavy(benches):
    (weak, *_) = find_effect("servo_gain").propose_terms(benches["cart_pole"].robot)
    (heavy, *_) = find_effect("payload").propose_terms(benches["cart_pole"].robot)
    assert [p.name for p in weak.parameters] == ["kp"]
    own, other = (t.effect.rate_rarity(t, np.zeros(9)) for t in (weak, heavy))
    assert own > other

"""Every effect: absent it is not there, present it shows, as it declares itself."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import GROUPS, check_declaration, find_effect
from selfheal.diagnosis.effects.by_target import WorldEffect
from selfheal.diagnosis.effects.places import SignalPlace
from selfheal.diagnosis.output.document import list_parameters
from selfheal.errors import InputError, UnknownNameError
from tests.support.effect_robots import (
    NAMES,
    absent_values,
    largest_change,
    make_pendulum,
    pick_terms,
    present_values,
)

ALWAYS_THERE = {"limb_loss", "joint_jam"}  # no value undoes them
# a gap stands behind a rotor of some inertia, and MuJoCo's stops are soft
NEARLY_ABSENT = {"backlash": 0.02}  # of the signal's spread
NEVER_ABSENT = {
    *ALWAYS_THERE,
    "compliance",
    "base_compliance",
}  # so stiff a spring does not compute


def test_an_unknown_effect_is_refused_with_those_there_are():
    with pytest.raises(UnknownNameError, match="coulomb_friction"):
        find_effect("friction")


def test_an_effect_that_acts_in_no_way_is_refused():
    class Idle(WorldEffect):
        name = group = description = equation = source = "idle"

        def propose_terms(self, robot):
            return []

    class Acting(Idle):
        def apply_forces(self, state, place, values): ...

    check_declaration(Acting())
    with pytest.raises(InputError, match="acts in no way; would fit: a method"):
        check_declaration(Idle())


@pytest.mark.parametrize("name", NAMES)
def test_terms_are_as_their_effect_declares(name, benches):
    effect = find_effect(name)
    assert effect.group in GROUPS
    assert effect.description.endswith(".") and effect.separate_by
    units = {p.name: p.unit for p in effect.parameters}
    fields = {f.name: f for f in effect.finding_fields}
    seen, sets = 0, set()
    for b in benches.values():
        for term in effect.propose_terms(b.robot):
            seen += 1
            stated = list_parameters(
                term, present_values(term), 0 * present_values(term)
            )
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
    for b in benches.values():
        for term in find_effect(name).propose_terms(b.robot):
            for target, known in zip(term.targets, term.places, strict=True):
                parameters = list_parameters(
                    term, present_values(term), 0 * present_values(term)
                )
                finding = {"target": target, "parameters": parameters}
                again = term.effect.find_place(
                    b.robot.model, finding | term.finding_fields
                )
                if isinstance(known, SignalPlace) and known.signal:
                    again = replace(again, kind=known.kind)
                assert again == known


@pytest.mark.parametrize("name", NAMES)
def test_initial_and_absent_values_are_within_bounds(name, benches):
    for _, term in pick_terms(benches, name):
        assert len(term.places) == len(term.targets) and term.initial_values
        for start in term.initial_values:
            assert (term.low <= start).all() and (start <= term.high).all()
        assert (term.scale > 0).all() and (term.low < term.high).all()


CAN_BE_ABSENT = [n for n in NAMES if n not in NEVER_ABSENT]


@pytest.mark.parametrize("name", CAN_BE_ABSENT)
def test_at_its_absent_values_an_effect_is_not_there(name, benches):
    for b, term in pick_terms(benches, name):
        moved = largest_change(b, (term,), absent_values(term))
        assert moved <= NEARLY_ABSENT.get(name, 1e-7), (term.label, moved)


@pytest.mark.parametrize("name", CAN_BE_ABSENT)
def test_an_absent_effect_leaves_what_the_model_states(name, stating):
    most = NEARLY_ABSENT.get(name, 1e-7)
    for b in stating.values():
        for term in find_effect(name).propose_terms(b.robot):
            assert largest_change(b, (term,), absent_values(term)) <= most, term.label


@pytest.mark.parametrize("name", NAMES)
def test_present_an_effect_changes_what_is_predicted(name, benches):
    moved = [
        largest_change(b, (t,), present_values(t)) for b, t in pick_terms(benches, name)
    ]
    assert np.isfinite(moved).all() and max(moved) > 1e-4


@pytest.mark.parametrize(
    ("name", "negligible", "large"),
    [
        ("slope", (1.0, 0.3), (0.2, 0.3)),  # as steep as may be
        ("asymmetric_friction", (0.1, 0.101), (0.1, 0.2)),  # alike both ways
        ("stribeck_friction", (0.3, 0.1, 0.1), (0.1, 0.3, 0.1)),  # grows with speed
        ("backlash", (0.0,), (0.01,)),  # absent
    ],
)
def test_values_that_are_another_effect_or_none_are_negligible(
    name, negligible, large, benches
):
    for term in find_effect(name).propose_terms(benches["arm"].robot):
        assert term.is_negligible(np.array(negligible))
        assert not term.is_negligible(np.array(large))


@pytest.mark.parametrize("name", ["arm", "box"])
def test_delays_of_a_step_are_negligible_only_in_contact(name, benches):
    b = benches[name]
    step, touches = b.simulator.timestep, name == "box"
    (term, *_) = find_effect("sensor_delay").propose_terms(b.robot)
    assert b.robot.has_contact == touches
    assert term.is_negligible(np.array([step])) == touches
    assert not term.is_negligible(np.array([3 * step]))


def test_a_torque_of_less_than_a_period_is_negligible_cogging(benches):
    term = find_effect("cogging").propose_terms(benches["arm"].robot)[1]
    amplitude, least = term.scale[0], term.low[1]
    assert term.is_negligible(np.array([amplitude, least, 0.3]))
    assert not term.is_negligible(np.array([amplitude, 1.5 * least, 0.3]))


UPRIGHT = {'type="hinge" axis="0 1 0"': 'type="slide" axis="0 0 1"'}


@pytest.mark.parametrize(
    ("name", "robot", "found"),
    [
        # no body at the base, whose mount could give
        ("base_compliance", "arm", 0),
        ("base_compliance", "cart_pole", 0),
        ("base_compliance", "box", 0),
        # of one actuator it is a late command
        ("clock_shift", "cart_pole", 0),
        # of one motor it is that motor's gain
        ("torque_constant", "arm", 1),
        ("torque_constant", "cart_pole", 0),
        # no motor drives it, or it has no weight in its plane
        ("gravity_compensation", "cart_pole", 0),
        ("gravity_compensation", "box", 0),
        ("gravity_compensation", {'axis="0 1 0"': 'axis="0 0 1"'}, 0),
        # behind a gear the error is in another unit
        ("integral_action", {}, 2),
        ("integral_action", {'kv="0.1"': 'kv="0.1" gear="2"'}, 0),
        # nothing blows
        ("wind", {}, 0),
        ("wind", {"<option": '<option viscosity="0.1"'}, 1),
        ("slope", UPRIGHT, 0),
    ],
)
def test_an_effect_is_proposed_only_where_it_could_be(
    name, robot, found, benches, tmp_path
):
    """On one of the robots, or on a pendulum with changes."""
    is_named = isinstance(robot, str)
    b = benches[robot] if is_named else make_pendulum(tmp_path, **robot)
    assert len(find_effect(name).propose_terms(b.robot)) == found

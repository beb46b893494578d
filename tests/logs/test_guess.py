"""A proposed map finds columns by name, unit, limits and motion, and tells doubts."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.logs.guessing.column_names import read_name, score_kinds
from selfheal.logs.guessing.guess import guess_map
from selfheal.logs.guessing.map_text import format_map
from selfheal.logs.log_map import COMMAND
from selfheal.logs.model_facts import format_servo
from selfheal.logs.motion import compare_command
from selfheal.preparation.drives import EVERY, Gains
from selfheal.preparation.prepare import prepare_model
from tests.support.logs.newcomer_robots import make_chain
from tests.support.logs.table_log import TableLog, import_guess, list_guessed

JOINTS = {"pan": (-2.5, 2.5), "lift": (-0.2, 2.0), "elbow": (-2.6, -0.3)}
ARM = make_chain(JOINTS, '<position name="{}_servo" joint="{}" kp="60" kv="2"/>')


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(ARM)


@pytest.fixture(scope="module")
def motion(model):
    """Times (T), and commands, positions and speeds (T, 3) of a motion of the arm."""
    data = mujoco.MjData(model)
    middle = np.array([(a + b) / 2 for a, b in JOINTS.values()])
    data.qpos[:] = middle
    found = []
    for step in range(6000):
        phase = data.time * np.array([1.1, 1.7, 2.3]) + np.array([0.3, 1.2, 2.0])
        data.ctrl[:] = middle + 0.5 * np.sin(phase) * np.array([2.0, 1.2, 1.4])
        if step % 5 == 0:
            found.append(
                (data.time, data.ctrl.copy(), data.qpos.copy(), data.qvel.copy())
            )
        mujoco.mj_step(model, data)
    return tuple(map(np.array, zip(*found, strict=True)))


def _make_table(
    motion, command="cmd_{}", position="{}_pos", speed="{}_vel", names=JOINTS
):
    time, ctrl, q, v = motion
    table = {"time": time}
    for form, values in ((command, ctrl), (position, q), (speed, v)):
        if form:
            table |= {form.format(n): values[:, k] for k, n in enumerate(names)}
    return table


def _list_found(guess):
    """Column, unit and sign by kind and target."""
    found = list_guessed(guess).items()
    return {key: (column, unit.unit, unit.sign) for key, (column, unit, _) in found}


def _expect(command, position, speed, units=("rad", "rad", "rad/s"), names=JOINTS):
    return {
        (kind, joint + end): (form.format(name), unit, 1)
        for kind, form, unit, end in (
            (COMMAND, command, units[0], "_servo"),
            ("joint_position", position, units[1], ""),
            ("joint_velocity", speed, units[2], ""),
        )
        for joint, name in zip(JOINTS, names, strict=True)
    }


@pytest.mark.parametrize(
    ("forms", "names"),
    [
        (("cmd_{}", "{}_pos", "{}_vel"), JOINTS),
        (
            ("action[{}.pos]", "observation.state[{}.pos]", "observation.velocity[{}]"),
            JOINTS,
        ),
        (("{}/target", "{}/actual", "{}/speed"), JOINTS),
        (
            ("desired.positions[{}]", "actual.positions[{}]", "actual.velocities[{}]"),
            JOINTS,
        ),
        # numbers are those of the model's order
        (("des_pos[{}]", "dof_pos[{}]", "dof_vel[{}]"), "012"),
    ],
)
def test_names_as_tools_write_them_are_understood(forms, names, model, motion):
    table = _make_table(motion, *forms, names=names)
    guess = guess_map(TableLog({"": table}), model)
    assert _list_found(guess) == _expect(*forms, names=names)
    assert min(target.sure for line in guess.lines for target in line.targets) > 0.6
    assert not guess.unused and not guess.missing


def test_columns_without_a_telling_order_are_found_by_limits_and_motion(model, motion):
    time, ctrl, q, v = motion
    order = (2, 0, 1)  # the elbow's column is the first one
    table = {"time": time}
    for letter, values, turn in (("q", q, 0), ("dq", v, 1), ("u", ctrl, 2)):
        for k in range(3):
            name = f"{letter}_{'abc'[(k + turn) % 3]}"
            table[name] = values[:, order[(k + turn) % 3]]
    guess = guess_map(TableLog({"": table}), model)
    found = {key: column for key, (column, *_) in _list_found(guess).items()}
    for joint, letter in zip(("elbow", "pan", "lift"), "abc", strict=True):
        assert found["joint_position", joint] == f"q_{letter}"
        assert found["joint_velocity", joint] == f"dq_{letter}"
        assert found[COMMAND, f"{joint}_servo"] == f"u_{letter}"


def test_units_are_found_by_limits_and_by_motion(model, motion):
    time, ctrl, q, v = motion
    table = _make_table((time, np.rad2deg(ctrl), np.rad2deg(q), v * 60 / (2 * np.pi)))
    guess = guess_map(TableLog({"": table}), model)
    forms = "cmd_{}", "{}_pos", "{}_vel"
    assert _list_found(guess) == _expect(*forms, units=("deg", "deg", "rpm"))


def test_a_speed_that_counts_backwards_gets_a_sign(model, motion):
    time, ctrl, q, v = motion
    table = _make_table((time, ctrl, q, v * np.array([1, -1, 1])))
    found = _list_found(guess_map(TableLog({"": table}), model))
    assert [found["joint_velocity", n][2] for n in JOINTS] == [1, -1, 1]


def test_limits_tell_which_of_position_and_command_counts_backwards(model, motion):
    time, ctrl, q, v = motion
    turned = np.array([1, 1, -1])
    table = _make_table((time, ctrl, q * turned, v * turned))
    found = _list_found(guess_map(TableLog({"": table}), model))
    assert found["joint_position", "elbow"][2] == -1
    assert found["joint_velocity", "elbow"][2] == -1
    assert found[COMMAND, "elbow_servo"][2] == 1
    # the limits of the pan are symmetric: nothing is turned, and it is said
    turned = np.array([-1, 1, 1])
    guess = guess_map(
        TableLog({"": _make_table((time, ctrl, q * turned, v * turned))}), model
    )
    found = _list_found(guess)
    assert {found[key][2] for key in found} == {1}
    (line,) = (line for line in guess.lines if line.kind == COMMAND)
    first = line.targets[0]
    assert first.sure <= 0.5 and "against each other" in first.why


def test_a_column_in_percent_is_mapped_to_its_range(model, motion):
    time, ctrl, q, v = motion
    low, high = JOINTS["elbow"]
    table = _make_table((time, np.rad2deg(ctrl), np.rad2deg(q), v))
    table["elbow_pos"] = 100 * (q[:, 2] - low) / (high - low)
    guess = guess_map(TableLog({"": table}), model)
    _, unit, _ = list_guessed(guess)["joint_position", "elbow"]
    assert unit.ranges == ((0.0, 100.0), (low, high))


def test_what_is_asked_to_be_looked_at_is_said_to_be_less_than_sure(model, motion):
    guess = guess_map(TableLog({"": _make_table(motion)}), model)
    doubts = [(0.6999, "a"), (0.7, "b"), (0.9999, "c")]
    (line, *_) = guess.lines
    pairs = zip(line.targets, doubts, strict=True)
    targets = [replace(target, sure=sure, why=why) for target, (sure, why) in pairs]
    lines = [replace(line, targets=targets)]
    text = format_map(replace(guess, lines=lines), "log.csv", "arm.xml")
    assert "69% sure: LOOK: pan" in text and "100% sure" not in text
    assert "70% sure: lift: b" in text and "99% sure: elbow: c" in text


def test_what_is_not_there_is_said(model, motion):
    table = _make_table(motion, command="", speed="") | {
        "camera": np.arange(1200.0) % 7
    }
    guess = guess_map(TableLog({"": table}), model)
    assert guess.missing == [f"{n}_servo" for n in JOINTS]
    assert guess.unused == ["camera"]
    assert any("no command was found" in remark for remark in guess.remarks)


def test_a_goal_for_a_torque_motor_is_remarked(motion, tmp_path):
    text = ARM.replace("<position", "<motor").replace('kp="60" kv="2"', "")
    motors = mujoco.MjModel.from_xml_string(text)
    table = _make_table(motion)
    remarks = guess_map(TableLog({"": table}), motors).remarks
    (remark,) = (r for r in remarks if "no position servos" in r)
    # what it says makes a model that fits the log
    assert "selfheal model prepare MODEL.xml --kp KP --kv KV" in remark
    path = tmp_path / "motors.xml"
    path.write_text(text)
    plain = {"weld_base": False, "without_contacts": False}
    gains = Gains({EVERY: 60}, {EVERY: 2})
    made = prepare_model(path, tmp_path, gains, **plain).text
    servos = mujoco.MjModel.from_xml_string(made)
    assert (servos.actuator_biasprm[:, 1] == -60).all()
    guess = guess_map(TableLog({"": table}), servos)
    assert not any("no position servos" in r for r in guess.remarks)


@pytest.mark.parametrize(
    ("actuator", "range_"),
    [
        ('motor joint="knee" ctrlrange="-1 2" gear="6"', (-6, 12)),
        ('motor joint="knee" ctrlrange="-1 2" gear="-6"', (-12, 6)),
        ('motor joint="knee" forcerange="-3 4" ctrlrange="-9 9" gear="2"', (-6, 8)),
        ('general joint="knee" ctrlrange="-1 1" gainprm="5"', (-5, 5)),
        ('motor joint="knee"', None),
        ('velocity joint="knee" kv="3" ctrlrange="-1 1"', None),
    ],
)
def test_a_servo_is_as_strong_as_the_motor_in_its_place(actuator, range_):
    xml = """<mujoco><worldbody><body><joint name="knee"/><geom size="0.1"/></body>
    </worldbody><actuator>{}</actuator></mujoco>"""
    motor = mujoco.MjModel.from_xml_string(xml.format(f'<{actuator} name="m"/>'))
    line = format_servo(motor, "m").replace("KP", "8").replace("KV", "1")
    servo = mujoco.MjModel.from_xml_string(xml.format(line))
    assert (servo.actuator("m").gear[0], servo.actuator("m").trnid[0]) == (1, 0)
    assert servo.actuator_forcelimited[0] == (range_ is not None)
    if range_:
        assert tuple(servo.actuator_forcerange[0]) == range_


@pytest.mark.parametrize("lag", [0.0, 0.01, 0.05, 0.14, 0.43])
def test_the_lag_of_a_position_is_found(lag):
    time = np.arange(0, 20, 0.005)
    rng = np.random.default_rng(1)
    shape = np.convolve(rng.normal(size=time.size + 200), np.hanning(60), "valid")
    command = shape[: time.size]
    late = np.interp(time - lag, time, command) + 0.01 * rng.normal(size=time.size)
    found = compare_command((time, command), (time, late))
    assert found.lag == pytest.approx(lag, abs=0.011) and found.correlation > 0.95


@pytest.mark.parametrize("value", [1e300, -np.inf, 1e200])
def test_a_reading_that_is_damaged_changes_no_guess(value, model, motion):
    table = {name: np.array(c, dtype=float) for name, c in _make_table(motion).items()}
    whole = guess_map(TableLog({"": table}), model)
    for column in table.values():
        column[7] = value
    guess = guess_map(TableLog({"": table}), model)
    places = [
        [
            (target.target, target.columns)
            for line in found.lines
            for target in line.targets
        ]
        for found in (guess, whole)
    ]
    assert places[0] == places[1]


def test_two_streams_of_a_robot_are_named_and_their_clocks_kept(model, motion):
    time, ctrl, q, _ = motion
    commands = {f"data[{k}]": ctrl[::2, k] for k in range(3)}
    states = {f"position[{n}]": q[:, k] for k, n in enumerate(JOINTS)}
    streams = {
        "/commands": {"stamp": time[::2], **commands},
        "/joint_states": {"t": time * 1000, **states},
    }
    guess = guess_map(TableLog(streams), model)
    assert guess.time.clocks["/joint_states"].unit == "ms"
    found = _list_found(guess)
    assert found[COMMAND, "pan_servo"][0] == "/commands:data[0]"
    assert found["joint_position", "lift"][0] == "/joint_states:position[lift]"


def test_the_text_of_a_guess_imports_what_the_robot_did(model, motion, tmp_path):
    time, ctrl, q, v = motion
    table = _make_table((time * 1e3, np.rad2deg(ctrl), np.rad2deg(q), v))
    log = TableLog({"": table})
    text = format_map(guess_map(log, model), "log\n.csv", "arm\x1b.xml")
    assert "\x1b" not in text
    episode = import_guess(log, text, model, tmp_path / "rec.h5")
    assert episode.ctrl == pytest.approx(ctrl)
    for k, name in enumerate(JOINTS):
        assert episode.signals[f"{name}_position"].values == pytest.approx(q[:, k])
        assert episode.signals[f"{name}_velocity"].values == pytest.approx(v[:, k])


@pytest.mark.parametrize(
    "stream, column, kind, unit",
    [
        ("", "q1 [deg]", "joint_position", "deg"),
        ("", "joint_3_velocity_deg/s", "joint_velocity", ""),
        ("", "tau_est_2", "joint_torque", ""),
        ("/joint_states", "effort[a]", "joint_torque", ""),
        ("/cmd", "data[0]", "command", ""),
        ("", "motor_temp (°C)", "temperature", "°C"),
        ("", "goal_position", "command", ""),
        ("", "present_position", "joint_position", ""),
        ("", "input_volts", "supply_voltage", "volts"),
        ("", "action[gripper.pos]", "command", ""),
    ],
)
def test_kinds_are_read_from_words(stream, column, kind, unit):
    facts = read_name(stream, column)
    scores = score_kinds(facts)
    assert max(scores, key=scores.get) == kind
    assert facts.unit == unit

"""What names leave open is guessed by content, or stated by a preset."""

import mujoco
import numpy as np
import pytest

from selfheal.errors import InputError, UnknownNameError
from selfheal.logs.guessing.guess import guess_map
from selfheal.logs.guessing.map_text import format_map
from selfheal.logs.guessing.presets import list_presets, read_preset
from selfheal.logs.log_map import COMMAND
from tests.support.logs.newcomer_robots import make_chain
from tests.support.logs.table_log import TableLog, import_guess, list_guessed

JOINTS = {"pan": (-2.5, 2.5), "lift": (-1.6, 1.7), "gripper": (-0.17, 1.75)}
RANGES = np.array(list(JOINTS.values()))
SERVO = '<position name="{}" joint="{}" kp="9"/>'
ARM = make_chain(JOINTS, SERVO)
TICK = 2 * np.pi / 4096


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(ARM)


@pytest.fixture(scope="module")
def motion():
    """Times (T), and commands, positions 60 ms later and speeds (T, 3)."""
    rng, time = np.random.default_rng(3), np.arange(0, 20, 1 / 50)
    middle, half = RANGES.mean(axis=1), 0.4 * np.ptp(RANGES, axis=1)
    rates, phases = rng.uniform(0.5, 2.5, (2, 3)), rng.uniform(0, 6, (2, 3))

    def move(t, order):
        angle = t[:, None, None] * rates + phases
        wave = rates * np.cos(angle) if order else np.sin(angle)
        return half * wave.sum(axis=1) / 2 + (0 if order else middle)

    q = move(time - 0.06, 0) + rng.normal(0, 2e-4, (len(time), 3))
    return time, move(time, 0), q, move(time - 0.06, 1)


def _write_lerobot(motion, unit, is_quantized):
    """A table as LeRobot names and converts its columns."""
    time, ctrl, q, _ = motion
    if is_quantized:
        q = np.round(q / TICK) * TICK
    table = {"timestamp": time}
    for form, values in (("action[{}.pos]", ctrl), ("observation.state[{}.pos]", q)):
        for k, (name, (low, high)) in enumerate(JOINTS.items()):
            share = np.clip((values[:, k] - low) / (high - low), 0, 1)
            column = np.rad2deg(values[:, k])
            if name == "gripper":
                column = 100 * share
            elif unit == "share":
                column = 200 * share - 100
            table[form.format(name)] = column
    return TableLog({"": table})


def _list_units(guess):
    found = list_guessed(guess).items()
    return {key: (unit.unit or unit.ranges[0], sure) for key, (_, unit, sure) in found}


def _name_targets(motion):
    """A table whose names tell what commands and positions are of."""
    _, ctrl, q, _ = motion
    table = {f"cmd_{n}": ctrl[:, k] for k, n in enumerate(JOINTS)}
    return table | {f"{n}_pos": q[:, k] for k, n in enumerate(JOINTS)}


def _number(motion, blocks):
    """A table (T, 1 + 3 B) of the time and what each letter stands for."""
    time, *arrays = motion
    values = dict(zip("uqv", arrays, strict=True))
    return np.column_stack([time, *(values[b] for b in blocks)])


def _guess_numbered(table, model):
    log = TableLog({"": {f"col{k}": column for k, column in enumerate(table.T)}})
    return guess_map(log, model)


KINDS = {"u": COMMAND, "q": "joint_position", "v": "joint_velocity"}


@pytest.mark.parametrize("unit", ["deg", "share"])
def test_encoders_steps_tell_degrees_from_shares(unit, model, motion):
    found = _list_units(guess_map(_write_lerobot(motion, unit, True), model))
    arm = "deg" if unit == "deg" else (-100, 100)
    for kind in ("joint_position", COMMAND):
        assert found[kind, "gripper"][0] == (0, 100)
        for name in ("pan", "lift"):
            assert found[kind, name][0] == arm and found[kind, name][1] > 0.85


def test_what_values_do_not_tell_is_said_and_a_preset_settles_it(
    model, motion, tmp_path
):
    log = _write_lerobot(motion, "share", False)
    guess = guess_map(log, model)
    found = _list_units(guess).items()
    doubtful = [sure for (_, name), (_, sure) in found if name != "gripper"]
    assert max(doubtful) <= 0.5
    assert "--preset lerobot-so101" in guess.lines[0].targets[0].why
    preset = read_preset("lerobot-so101")
    text = format_map(guess_map(log, model, preset), "log", "model")
    episode = import_guess(log, text, model, tmp_path / "rec.h5")
    _, ctrl, q, _ = motion
    assert episode.ctrl == pytest.approx(ctrl, abs=1e-9)
    assert episode.signals["lift_position"].values == pytest.approx(q[:, 1])


@pytest.mark.parametrize("name", ["lerobot-so101", "legged_gym", "ros2_control"])
def test_presets_are_maps_without_a_model(name):
    preset = read_preset(name)
    assert {"command", "joint_position"} <= {rule.kind for rule in preset.signals}
    assert not any(rule.targets or rule.to_range for rule in preset.signals)
    assert name in list_presets()


def test_a_preset_that_is_not_known_is_said():
    with pytest.raises(UnknownNameError, match="lerobot-so101"):
        read_preset("lerobot")


@pytest.mark.parametrize("blocks", ["uqv", "vqu", "uq", "qu"])
def test_columns_without_names_are_told_by_their_motion(blocks, model, motion):
    guess = _guess_numbered(_number(motion, blocks), model)
    assert guess.time.clocks[""].column == "col0"
    want = {
        (KINDS[b], name): f"col{1 + 3 * i + k}"
        for i, b in enumerate(blocks)
        for k, name in enumerate(JOINTS)
    }
    found = list_guessed(guess)
    assert {key: column for key, (column, *_) in found.items()} == want
    assert max(sure for *_, sure in found.values()) < 0.7


def test_a_map_has_lines_to_fill_in_for_what_was_not_found(model):
    rng = np.random.default_rng(0)
    table = {f"col{k}": rng.normal(size=100) for k in range(8)}
    text = format_map(guess_map(TableLog({"": table}), model), "log", "model")
    assert "# columns = []" in text and '# targets = ["pan", "lift", "gripper"]' in text
    assert all(name in text for name in table)
    assert max(map(len, text.splitlines())) < 80


def test_rows_of_zeros_are_left_out_by_a_guess(model, motion, tmp_path):
    time, ctrl, q, v = motion
    rows = np.arange(len(time)) % 6 == 3
    zeroed = time, ctrl, np.where(rows[:, None], 0, q), v
    log = TableLog({"": {"time": time} | _name_targets(zeroed)})
    text = format_map(guess_map(log, model), "log", "model")
    assert text.count("missing = 0") == 1
    episode = import_guess(log, text, model, tmp_path / "rec.h5")
    assert (np.isnan(episode.signals["lift_position"].values) == rows).all()


@pytest.mark.parametrize("blocks", ["uqv", "quv"])
def test_runs_whose_time_begins_again_are_compared_run_by_run(blocks, model, motion):
    rows = np.concatenate([np.arange(450, 900), np.arange(450), np.arange(600, 1000)])
    table = _number(motion, blocks)[rows]
    for start in (0, 450, 900):
        table[start : start + 450, 0] -= table[start, 0]
    guess = _guess_numbered(table, model)
    assert {line.kind: line.columns[0] for line in guess.lines} == {
        KINDS[b]: f"col{1 + 3 * i}" for i, b in enumerate(blocks)
    }
    assert guess.time.episodes.gap is None


def test_a_rate_that_nothing_states_is_left_to_the_user(model, motion, tmp_path):
    log = TableLog({"": _name_targets(motion)})
    text = format_map(guess_map(log, model), "log", "model")
    assert "# rate = " in text and "LOOK: the log has no time" in text
    with pytest.raises(InputError, match=r"rate = \.\.\. in Hz"):
        import_guess(log, text, model, tmp_path / "rec.h5")


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
@pytest.mark.parametrize("preset", ["", "legged_gym"])
def test_arrays_of_a_base_are_its_pose(order, preset, motion):
    text = make_chain(JOINTS, SERVO, "<freejoint/><geom size='0.1'/>")
    time, ctrl, q, _ = motion
    half = 0.3 * np.sin(time)
    quaternion = {"w": np.cos(half), "x": np.sin(half), "y": 0 * half, "z": 0 * half}
    table = {"time": time}
    table |= {f"base_pos[{k}]": np.sin(time + k) for k in range(3)}
    table |= {f"base_quat[{k}]": quaternion[axis] for k, axis in enumerate(order)}
    table |= {f"base_lin_vel[{k}]": np.cos(time + k) for k in range(3)}
    table |= {f"dof_pos[{k}]": q[:, k] for k in range(3)}
    table |= {f"dof_pos_target[{k}]": ctrl[:, k] for k in range(3)}
    model = mujoco.MjModel.from_xml_string(text)
    known = read_preset(preset) if preset else None
    guess = guess_map(TableLog({"": table}), model, known)
    lines = {line.kind: line for line in guess.lines}
    poses = {"body_position", "body_orientation"}
    assert lines.keys() == {"joint_position", COMMAND, *poses}
    assert all(lines[kind].targets[0].target == "base" for kind in poses)
    found = lines["body_orientation"].order
    assert found == ("xyzw" if preset else order)  # Isaac Gym's
    assert any("base_lin_vel" in remark for remark in guess.remarks)

"""Raw logs of public projects are imported by what a guess makes of them."""

import json
import re
from functools import partial

import numpy as np
import pytest

from selfheal.recording import read
from tests.support.commands.run import run_well
from tests.support.logs.newcomer_robots import make_chain
from tests.support.paths import RECORDINGS

FIELD = RECORDINGS / "field"
pytestmark = pytest.mark.skipif(not FIELD.is_dir(), reason="no logs of real robots")
UR10 = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def _make_arm(joints, actuator="motor"):
    unlimited = dict.fromkeys(joints, (0, 0))
    return make_chain(unlimited, f'<{actuator} name="{{}}" joint="{{}}"/>')


def _make_servo():
    return _make_arm(["servo"], "position")


def _read_go2():
    """The project's model without its meshes, which are not here."""
    text = (FIELD / "go2_air" / "go2_upstream.xml").read_text()
    return re.sub(r'<geom[^>]*mesh="[^"]*"[^>]*/>|<mesh [^>]*/>', "", text)


def _make_ur10():
    return _make_arm([f"{name}_joint" for name in UR10])


def _make_panda():
    return _make_arm([f"fer_joint{k}" for k in range(1, 8)])


LOGS = {  # model, episodes, signals, rows, the longest episode [s]
    "go2_air/traj_0.pt": (_read_go2, 1, 12, 4698, 23.5),
    "servo_50hz/dataset.json": (_make_servo, 100, 1, 8756, 3.0),
    "servo_50hz/drop-response-1.json": (_make_servo, 1, 1, 353, 7.0),
    "ros2_bags/ur10_exciting_trajectory.db3": (_make_ur10, 1, 12, 3441, 27.5),
    "ros2_bags/panda_exciting_trajectory.db3": (_make_panda, 1, 14, 727, 24.2),
}


_run = partial(run_well, "recording", "import")


@pytest.mark.parametrize("name", LOGS)
def test_a_guess_imports_it(name, tmp_path):
    make, episodes, signals, rows, seconds = LOGS[name]
    model, map_file = tmp_path / "model.xml", tmp_path / "map.toml"
    model.write_text(make())
    words = (FIELD / name, "--model", model)
    told = json.loads(_run(*words, "--guess", "--out", map_file, "--json"))
    lines = map_file.read_text().splitlines()
    assert sum(line[:1] not in ("", "#", " ", '"') for line in lines) <= 25
    assert not told["missing"]
    _run(*words, "--map", map_file, "--out", tmp_path / "rec.h5")
    found = read(tmp_path / "rec.h5").episodes
    assert len(found) == episodes
    assert sum(episode.time.size for episode in found.values()) == rows
    for episode in found.values():
        assert len(episode.signals) == signals
        assert all(np.isfinite(s.values).all() for s in episode.signals.values())
    longest = max(episode.time[-1] for episode in found.values())
    assert longest == pytest.approx(seconds, abs=0.1)


def test_what_a_guess_cannot_know_is_said(tmp_path):
    model = tmp_path / "model.xml"
    words = ("--model", model, "--guess", "--json", "--out")
    model.write_text(_read_go2())
    log = FIELD / "go2_air" / "traj_0.pt"
    told = json.loads(_run(log, *words, tmp_path / "go2.toml"))
    assert any("no position servos" in remark for remark in told["remarks"])
    positions = [c for c in told["columns"] if c["kind"] == "joint_position"]
    assert {c["why"].split(";")[0] for c in positions} == {"its number"}
    assert all(c["sure"] < 0.9 for c in positions)  # the order is not in the log
    model.write_text(LOGS["ros2_bags/ur10_exciting_trajectory.db3"][0]())
    log = FIELD / "ros2_bags" / "ur10_exciting_trajectory.db3"
    told = json.loads(_run(log, *words, tmp_path / "ur10.toml"))
    assert any("currents" in remark for remark in told["remarks"])

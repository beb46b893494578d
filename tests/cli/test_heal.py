"""`heal`, `gait` and `watch`: JSON and files; refusals before any work."""

import json

import numpy as np
import pytest

from selfheal.body.mjcf import format_mjcf
from selfheal.recording import write
from tests.support.commands.run import refuse, run, run_well
from tests.support.short_heal import BODY, identified

pytestmark = pytest.mark.usefixtures("short_heal", "undrawn")


@pytest.mark.slow
def test_on_the_command_line_a_dead_sensor_is_named_and_costs_no_way(tmp_path):
    path, _ = identified(tmp_path)
    dead, out = "left_hip_position", tmp_path / "h"
    made = run_well("heal", path, "--damage", f"dead:{dead}", "--out", out, "--json")
    result = json.loads(made)
    assert result["run"] == str(path)
    assert result["hypotheses"][0]["target"] == f"sensor:{dead}"
    assert result["distance"]["healed"] > 0.9 * result["distance"]["damaged"] > 0
    assert (out / "report.html").is_file()
    again = run("heal", "--resume", out / "heal.h5", "--json")
    assert json.loads(again.stdout) == result


@pytest.mark.slow
def test_hours_on_the_command_line(tmp_path):
    path, _ = identified(tmp_path)
    out = tmp_path / "h"
    words = "heal", path, "--hours", 0.04, "--out", out
    made = run(*words)
    assert made.exit_code == 0, made.output
    again = run("heal", "--resume", out / "heal.h5", "--json")
    result = json.loads(again.stdout)
    (event,) = (e for e in result["events"] if e["damage"])
    page = (out / "report.html").read_text()
    for alarm in filter(None, (e["alarm"] for e in result["events"])):
        said = f"{alarm['time']:.1f} s"
        assert f"alarm at {said}" in made.stderr
        assert f"alarm: {said}" in made.stdout.replace("\n  ", " ")
        assert f">{said}<" in page
    assert 70 <= event["time"] < 3600 * 0.04


def test_gait_on_the_command_line(tmp_path):
    path, _ = identified(tmp_path)
    made = run_well("gait", path, "--heading", 90, "--json")
    told = json.loads(made)
    assert told["heading"] == 90
    assert told["predicted"]["energy"] > 0
    assert np.hypot(told["walked"], told["across"]) > 0.5


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("heal",), "--resume HEAL.h5"),
        (("heal", "{run}"), "--damage"),
        (("heal", "{run}", "--damage", "loss:left_upper", "--hours", 1), "either"),
        (("heal", "{run}", "--hours", 0.01), "0.031"),
        (("heal", "{run}", "--damage", "loss:tail"), "left_upper"),
        (("heal", "{run}", "--damage", "loss:left_upper", "--gait", "trot"), "waves"),
        (("heal", "--resume", "{run}"), "not a heal's file"),
        (("heal", "--resume", "{run}", "--seed", "2"), "leave out --seed"),
        (("gait", "{run}", "--seed", "-1"), "negative"),
        (("gait", "{run}", "--heading", "nan"), "heading"),
        (("gait", "nothere.h5"), "no such run file"),
        (("watch", "nothere.xml", "{run}"), "no such file"),
    ],
)
def test_what_makes_no_sense_is_refused(words, said, tmp_path):
    path, _ = identified(tmp_path)
    assert said in refuse(*(str(word).format(run=path) for word in words))


def test_watch_on_the_command_line(walks, tmp_path):
    (tmp_path / "body.xml").write_text(format_mjcf(BODY))
    write(walks[1], tmp_path / "walk.h5")
    made = run_well("watch", tmp_path / "body.xml", tmp_path / "walk.h5", "--json")
    assert json.loads(made)["episodes"][0]["alarm"]["p_value"] < 0.01
    short = "watch", tmp_path / "body.xml", tmp_path / "walk.h5", "--learn", 3
    assert "to learn from" in refuse(*short)

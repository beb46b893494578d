"""What the pages on recordings and on maps show works as it is shown."""

import re
import tomllib

from selfheal.logs.log_map import parse_map
from selfheal.recording import read
from tests.support.paths import ROOT


def _list_blocks(page, language):
    text = (ROOT / "docs" / page).read_text()
    return re.findall(rf"```{language}\n(.*?)```", text, re.S)


def test_the_example_of_the_format_writes_a_recording(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = _list_blocks("recording-format.md", "python")
    exec(code, {})
    (episode,) = read("recording.h5").episodes.values()
    assert episode.signals["hinge_position"].unit == "rad"


def test_the_map_that_is_shown_is_one():
    (text,) = _list_blocks("import-a-log.md", "toml")
    shown = parse_map(tomllib.loads(text), "map.toml")
    assert len(shown.signals) == 3
    assert shown.time.streams["/imu"].offset == -0.012

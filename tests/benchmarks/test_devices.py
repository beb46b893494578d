"""Real devices: what is diagnosed is not what proves, and the model is as target."""

import json

import mujoco
import pytest

from benchmarks.devices import DEVICES, HIPS_UP, prepare_case, summarize_device
from selfheal.recording import check_against_model, read, read_names

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", DEVICES)
def test_a_device_is_prepared(name, shared_recordings, tmp_path):
    device = DEVICES[name]
    prepare_case(device, shared_recordings, tmp_path)
    recording = read(tmp_path / "recording.h5")
    check_against_model(recording, read_names(tmp_path / "model.xml"))
    whole = list(read(shared_recordings / device.train).episodes)
    assert list(recording.episodes) == (whole[::2] if device.split else whole)


def test_raised_hips_are_all_that_differs(shared_recordings, tmp_path):
    device = DEVICES["starfish_raised"]
    prepare_case(device, shared_recordings, tmp_path)
    models = [
        mujoco.MjModel.from_xml_path(str(path))
        for path in (shared_recordings / device.model, tmp_path / "model.xml")
    ]
    moved = models[1].body_pos - models[0].body_pos
    for k in range(models[0].nbody):
        up = HIPS_UP if models[0].body(k).name.endswith("_upper") else 0
        assert moved[k] == pytest.approx([0, 0, up], abs=1e-6)
    assert models[1].body_mass == pytest.approx(models[0].body_mass, rel=1e-4)


def test_a_row_says_what_was_found(tmp_path):
    values = {"mass": 0.3, "position": [0.0, 0.1, -0.25]}
    finding = {
        "effect": "payload",
        "target": "body:arm",
        "parameters": [{"name": k, "value": v} for k, v in values.items()],
    }
    document = {"verdict": "explained", "findings": [finding]}
    (tmp_path / "diagnosis").mkdir()
    (tmp_path / "diagnosis" / "diagnosis.json").write_text(json.dumps(document))
    (tmp_path / "run.json").write_text('{"seconds": 1.0, "megabytes": 2.0}')
    said = summarize_device("cube", tmp_path, 0.2)
    assert said["named"] == ["payload body:arm (mass 0.3, position (0, 0.1, -0.25))"]
    assert (said["target"], said["reached"]) == (DEVICES["cube"].target, 0.2)

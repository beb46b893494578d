"""Real devices: what is diagnosed is not what proves, and the model is as asked."""

import sys
from pathlib import Path

import mujoco
import pytest

from selfheal.recording import check_against_model, read, read_names

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from devices import DEVICES, HIPS_UP, prepare


@pytest.mark.parametrize("name", DEVICES)
def test_a_device_is_prepared(name, shared_recordings, tmp_path):
    device = DEVICES[name]
    prepare(device, shared_recordings, tmp_path)
    recording = read(tmp_path / "recording.h5")
    check_against_model(recording, read_names(tmp_path / "model.xml"))
    whole = list(read(shared_recordings / device.train).episodes)
    assert list(recording.episodes) == (whole[::2] if device.split else whole)


def test_raised_hips_are_all_that_differs(shared_recordings, tmp_path):
    device = DEVICES["starfish_raised"]
    prepare(device, shared_recordings, tmp_path)
    models = [
        mujoco.MjModel.from_xml_path(str(path))
        for path in (shared_recordings / device.model, tmp_path / "model.xml")
    ]
    moved = models[1].body_pos - models[0].body_pos
    for k in range(models[0].nbody):
        up = HIPS_UP if models[0].body(k).name.endswith("_upper") else 0
        assert moved[k] == pytest.approx([0, 0, up], abs=1e-6)
    assert models[1].body_mass == pytest.approx(models[0].body_mass, rel=1e-4)

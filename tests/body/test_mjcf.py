"""Bodies as MJCF: what is written is read back, and other models are refused."""

import re
from dataclasses import fields

import mujoco
import numpy as np
import pytest

from selfheal.body.body import Anatomy, Bodies
from selfheal.body.genome import build_bodies, draw_genomes, encode_tree
from selfheal.body.mjcf import Physics, format_mjcf, load
from selfheal.errors import ModelError
from selfheal.schema import is_tree
from tests.support.stick_robot import anatomy

PRINTED = 1e-6  # an MJCF has six digits
STAR = ([0, 0, 0, 0, 1, 2, 3, 4], [0.125, 0.375, 0.625, 0.875] + [0.375] * 4)


def _star() -> Bodies:
    return build_bodies(anatomy(8), encode_tree(anatomy(8), *map(np.array, STAR)))


@pytest.fixture
def text() -> str:
    """The MJCF of a toy."""
    return format_mjcf(_star())


def _loaded(folder, text: str) -> Bodies:
    path = folder / "robot.xml"
    path.write_text(text)
    return load(path)


def _close(one, other, names) -> None:
    for name in names:
        value, expected = getattr(one, name), getattr(other, name)
        if isinstance(expected, tuple | str):
            assert value == expected
        else:
            np.testing.assert_allclose(value, expected, atol=PRINTED, err_msg=name)


def test_random_trees_come_back_as_they_were(tmp_path):
    rng = np.random.default_rng(0)
    bodies = build_bodies(anatomy(8), draw_genomes(anatomy(8), 20, rng, False))
    for row in range(20):
        back = _loaded(tmp_path, format_mjcf(bodies, row))
        names = [f.name for f in fields(Bodies)[1:] if f.name != "heading"]
        _close(back, bodies[[row]], names)
        turned = back.heading - bodies.heading[[row]]
        np.testing.assert_allclose(np.cos(turned), 1, atol=PRINTED)
        # where parts may hang on the torso is read off where they do
        known = [f.name for f in fields(Anatomy) if f.name != "rim"]
        _close(back.anatomy, bodies.anatomy, known)


def test_the_rim_is_read_off_parts_on_every_side(text, tmp_path):
    _close(_loaded(tmp_path, text).anatomy, anatomy(8), ["rim"])


def test_the_model_moves_in_mujoco(text):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    assert (model.nu, model.nv) == (8, 14)
    assert np.isfinite(data.qpos).all()
    mass = anatomy(8).mass.sum() + anatomy(8).block_mass.sum() + 0.5
    assert model.body_mass.sum() == pytest.approx(mass)


def test_physics_reach_the_model():
    physics = Physics(timestep=0.001, friction=0.7, kp=90, kv=2, density=1.5)
    heavy = mujoco.MjModel.from_xml_string(format_mjcf(_star(), 0, physics))
    plain = mujoco.MjModel.from_xml_string(format_mjcf(_star()))
    assert heavy.opt.timestep == 0.001
    assert (heavy.geom_friction[:, 0] == 0.7).all()
    assert (heavy.actuator_gainprm[:, 0] == 90).all()
    np.testing.assert_allclose(heavy.body_mass, 1.5 * plain.body_mass, rtol=1e-5)


@pytest.mark.parametrize("text", ["no model", "<mujoco><worldbody>", "<urdf/>"])
def test_what_mujoco_cannot_read_is_refused(text, tmp_path):
    with pytest.raises(ModelError, match=r"nowhere\.xml"):
        load(tmp_path / "nowhere.xml")
    with pytest.raises(ModelError, match=r"robot\.xml: MuJoCo cannot") as refusal:
        _loaded(tmp_path, text)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("pattern", "by", "said"),
    [
        ("<actuator>.*</actuator>", "", "no actuators"),
        (r'(<geom name="part_0"[^>]*) mass="[^"]*"', r"\1", "needs a positive mass"),
        (r'(<geom name=")part_0("[^>]*/>)', r"\1part_0\2\1b\2", "2 capsule geoms"),
    ],
)
def test_a_model_of_no_such_body_is_refused(text, pattern, by, said, tmp_path):
    changed = re.sub(pattern, by, text, flags=re.DOTALL)
    assert changed != text
    with pytest.raises(ModelError, match=said):
        _loaded(tmp_path, changed)


def test_servos_in_any_order_make_parts_of_any_order(text, tmp_path):
    servos = re.findall(r"<general [^>]*/>|<position [^>]*/>", text)
    swapped = text.replace(servos[0], "FIRST").replace(servos[4], servos[0])
    body = _loaded(tmp_path, swapped.replace("FIRST", servos[4]))
    assert not body.anatomy.ordered and is_tree(body.parent).all()

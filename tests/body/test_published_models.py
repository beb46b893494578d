"""Each starfish is the body that its README says, and explains the real robot."""

from dataclasses import fields
from importlib.resources import files

import numpy as np
import pytest

from selfheal.body import genome
from selfheal.body.body import Anatomy, Bodies
from selfheal.body.mjcf import Physics, build_spec, load
from selfheal.recording import read

SIDES = ("left", "forward", "right", "back")
# what differs from published.xml, and tilt error [deg], as in models/starfish/README.md
LOWER97 = {"length": [0.095] * 4 + [0.097] * 4}
VARIANTS = {
    "published": ({}, 0.41),
    "lower97": (LOWER97, 0.65),
    "released": (
        {
            **LOWER97,
            "torso_half": [0.041, 0.041, 0.045],
            "rim": [0.07, 0.07, -0.005],  # 40 mm above the belly
        },
        0.91,
    ),
    "upper-mass-ee": ({"mass": [0.5, 1.143, 0.143, 0.143] + [0.118] * 4}, 16.2),
}
PUBLISHED = {
    "name": "starfish",
    "parts": tuple(f"{s}_{k}" for k in ("upper", "lower") for s in SIDES),
    "joints": tuple(f"{s}_{k}" for k in ("hip", "knee") for s in SIDES),
    "torso_half": [0.041, 0.041, 0.0425],
    "torso_mass": 0.5,
    "rim": [0.07, 0.07, 0],
    "length": [0.095] * 4 + [0.125] * 4,
    "radius": [0.007] * 8,
    "mass": [0.143] * 4 + [0.118] * 4,
    "block_half": [[0.0, 0, 0]] * 4 + [[0.0185, 0.015, 0.02]] * 4,
    "block_center": [0.0] * 4 + [0.0185] * 4,
    "block_mass": [0.0] * 4 + [0.023] * 4,
    "feet": (5, 6, 7, 8),
    "hinges": (),
    "bends": (),
    "fixed": False,
    "ordered": True,
    "sensors": ("tilt", "clearance"),
}


def _path(variant: str):
    return files("selfheal.models") / "starfish" / f"{variant}.xml"


def test_every_model_has_its_row_here_and_in_the_readme():
    folder = files("selfheal.models") / "starfish"
    found = {f.name.removesuffix(".xml") for f in folder.iterdir() if ".xml" in f.name}
    assert found == set(VARIANTS)
    readme = (folder / "README.md").read_text()
    for name, (_, error) in VARIANTS.items():
        row = next(r for r in readme.splitlines() if r.startswith(f"| `{name}.xml`"))
        assert float(row.split("|")[-2]) == error


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_model_has_the_sizes_of_its_readme(variant):
    anatomy = load(_path(variant)).anatomy
    for name, expected in {**PUBLISHED, **VARIANTS[variant][0]}.items():
        value = getattr(anatomy, name)
        if isinstance(expected, tuple | str | bool):
            assert value == expected
        else:
            np.testing.assert_allclose(value, expected, atol=1e-12, err_msg=name)
    assert {f.name for f in fields(Anatomy)} == set(PUBLISHED)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_model_is_the_body_of_its_genome(variant):
    body = load(_path(variant))
    placement = np.array([0.125, 0.375, 0.625, 0.875] + [0.375] * 4)
    tree = genome.encode_tree(
        body.anatomy, np.array([0, 0, 0, 0, 1, 2, 3, 4]), placement
    )
    expected = genome.build_bodies(body.anatomy, tree)
    for f in fields(Bodies)[1:]:
        np.testing.assert_allclose(
            getattr(body, f.name), getattr(expected, f.name), atol=1e-12, err_msg=f.name
        )


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_model_compiles_to_what_the_writer_writes(variant):
    import mujoco

    body = load(_path(variant))
    ours = mujoco.MjModel.from_xml_path(str(_path(variant)))
    written = build_spec(body, 0, Physics()).compile()
    names = "body_mass body_inertia body_ipos body_pos site_pos geom_friction jnt_axis"
    names += " dof_damping dof_armature actuator_gainprm actuator_biasprm"
    for name in names.split():
        np.testing.assert_allclose(
            getattr(ours, name), getattr(written, name), atol=1e-9, err_msg=name
        )
    assert ours.opt.timestep == written.opt.timestep
    degrees = np.degrees(ours.jnt_range[1:])
    knee = np.array(["knee" in ours.joint(i).name for i in range(1, ours.njnt)])
    np.testing.assert_allclose(degrees[knee], np.tile([-96, 94], (4, 1)))
    np.testing.assert_allclose(degrees[~knee], np.tile([-96, 74], (4, 1)))


@pytest.mark.parametrize("variant", VARIANTS)
def test_tilt_error_on_the_real_robot(variant, shared_recordings):
    from selfheal.engine.mujoco import MuJoCo

    recording = read(shared_recordings / "starfish_2006" / "intact.h5")
    episodes = list(recording.episodes.values())
    body = load(_path(variant))
    servos = tuple(f"{joint}_servo" for joint in body.anatomy.joints)
    assert all(e.ctrl_names == servos for e in episodes) and len(episodes) == 36
    commanded = np.array([e.ctrl[-1] for e in episodes])
    up = np.array([e.signals["vertical"].values[-1] for e in episodes])
    measured = np.arcsin(np.column_stack([-up[:, 1], up[:, 0]]))
    rest = MuJoCo().simulate(body[np.zeros(36, int)], commanded)
    error = np.degrees(np.abs(rest.tilt - measured)).sum(axis=1).mean()
    assert error == pytest.approx(VARIANTS[variant][1], rel=0.03)
    assert variant != "published" or error <= 0.45

"""The robot on the page: lit where findings are, and in motion as it was measured."""

import base64
import io
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.output.result import PoseTrace, SignalFit
from selfheal.engine.poses import pose_bodies
from selfheal.report import robot
from selfheal.report.marks import find_marks
from tests.support.browser import HOSTILE
from tests.support.made_up_diagnosis import FINDING, make_diagnosis, write_page_text

MODEL = """<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="thigh" pos="0 0 .6">
      <joint name="hip" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
      <body name="shank" pos="0 0 -.3">
        <joint name="knee" axis="0 1 0" pos="0 0 .01"/>
        <geom name="bone" type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/>
        <site name="ankle" pos="0 0 -.2"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="string"><joint joint="hip" coef="1"/></fixed>
  </tendon>
  <actuator>
    <motor name="hip_motor" joint="hip"/>
    <motor name="thruster" site="ankle"/>
    <motor name="winch" tendon="string"/>
  </actuator>
  <sensor>
    <accelerometer name="imu" site="ankle"/>
    <actuatorfrc name="force" actuator="hip_motor"/>
    <clock name="clock"/>
  </sensor>
</mujoco>"""
THIGH, SHANK, NOWHERE = 1, 2, 0
FRAMES = 5


def _blind(name, reads):
    nothing = (0.0, 0.0, 0.0)
    return SignalFit(name, True, nothing, nothing, nothing, 0.0, reads=reads)


@pytest.fixture
def leg(tmp_path):
    """A diagnosis of a leg that bends its knee, unlike the given model."""
    path = tmp_path / "leg.xml"
    path.write_text(MODEL)
    model = mujoco.MjModel.from_xml_path(str(path))
    knee = np.linspace(0, 1, FRAMES)
    measured, straight = (
        pose_bodies(model, np.stack([0 * knee, angle], axis=1))
        for angle in (knee, 0 * knee)
    )
    poses = PoseTrace(
        "004", np.linspace(2, 3, FRAMES), (), measured, straight, measured
    )
    return replace(make_diagnosis(), model=str(path), poses=poses)


@pytest.mark.parametrize(
    "target, body",
    [
        ("joint:knee", SHANK),
        ("actuator:hip_motor", THIGH),
        ("actuator:thruster", SHANK),
        ("actuator:winch", NOWHERE),
        ("body:shank", SHANK),
        ("geom:bone", SHANK),
        ("geom:floor", NOWHERE),
        ("world", NOWHERE),
        ("sensor:angle", SHANK),
        ("sensor:acceleration", SHANK),
        ("sensor:drive", THIGH),
        ("sensor:time", NOWHERE),
        ("sensor:voltage", NOWHERE),
    ],
)
def test_a_finding_is_on_the_body_that_its_target_is_on(leg, target, body):
    reads = {"angle": "joint:knee", "acceleration": "sensor:imu"}
    reads |= {"drive": "sensor:force", "time": "sensor:clock"}
    found = {**FINDING, "effect": "sensor_bias", "target": target}
    signals = tuple(_blind(*pair) for pair in reads.items())
    document = {**leg.document, "findings": [found]}
    made = replace(leg, document=document, signals=signals)
    marks, elsewhere = find_marks(mujoco.MjModel.from_xml_string(MODEL), made)
    name = target.partition(":")[2] or "world"
    if body == NOWHERE:
        assert marks == [] and elsewhere == [f"sensor bias ({name})"]
    else:
        assert [(m.body, m.name) for m in marks] == [(body, f"{name}: sensor bias")]
        assert elsewhere == []


def test_findings_at_one_place_share_its_name(leg):
    found = [{**FINDING, "effect": e} for e in ("armature", "backlash")]
    made = replace(leg, document={**leg.document, "findings": found})
    (mark,), _ = find_marks(mujoco.MjModel.from_xml_string(MODEL), made)
    assert mark.name == "knee: armature, backlash"
    assert mark.point == pytest.approx([0, 0, 0.01])


def test_where_nothing_renders_the_page_says_so_and_is_whole(leg):
    without = write_page_text(replace(leg, poses=None))
    made = write_page_text(leg)
    said = f"<p>{robot.NOTHING_RENDERS.replace(chr(39), '&#x27;')}</p>"
    section = f"<section><h2>{robot.TITLE}</h2>\n{said}</section>\n"
    assert made.replace(section, "") == without != made


def test_a_robot_without_shapes_is_said_to_have_none(leg, tmp_path):
    mass = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    bare = re.sub('<geom [^>]*type="capsule"[^>]*>', mass, MODEL)
    (tmp_path / "leg.xml").write_text(bare)
    assert robot.NO_SHAPE in write_page_text(leg)


@pytest.mark.parametrize("known", [0, 2, FRAMES])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_a_model_that_diverged_stands_still(leg, known, value):
    given = leg.poses.measured.copy()
    given[known:, SHANK - 1] = value
    held = robot._hold_where_diverged(replace(leg.poses, given=given)).given
    last = max(known - 1, 0)
    assert (held[:known] == leg.poses.measured[:known]).all()
    assert (held[known:] == leg.poses.measured[last]).all()


def _read_pictures(page):
    """The moving and the still picture on a page, as (frames, height, width, 3)."""
    from PIL import Image

    found = []
    for coded in re.findall(r'data:image/webp;base64,([^"]*)"', page):
        image, frames = Image.open(io.BytesIO(base64.b64decode(coded))), []
        for k in range(image.n_frames):
            image.seek(k)
            frames.append(np.asarray(image.convert("RGB"), float))
        found.append(np.array(frames))
    return found


def _tell_hues(picture):
    """How many pixels of a picture are blue, and how many green."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    is_blue = (blue > green + 25) & (blue > red + 60)
    is_green = (green > blue + 15) & (green > red + 60)
    return np.count_nonzero(is_blue), np.count_nonzero(is_green)


@pytest.mark.slow
def test_the_robot_is_rendered_lit_and_moving(leg, renderer):
    page = write_page_text(leg)
    if robot.NOTHING_RENDERS[:30] in page:
        pytest.skip("no EGL and no OSMesa here (libegl1 and libgl1-mesa-dri have one)")
    still, film = _read_pictures(page)
    assert len(page) < 3_000_000
    assert len(film) == FRAMES and len(still) == 1
    assert "1 s of episode 004 from 2 s, shown in 4 s (4 times slower)" in page
    assert ">knee: coulomb friction</text>" in page
    blue, _ = _tell_hues(still[0])
    assert 0.002 < blue / still[0, ..., 0].size < 0.2  # the shank alone is lit
    half = film.shape[2] // 2
    given, patched = film[:, :, :half], film[:, :, half:]
    # the ghost leaves the straight leg of the given model, not that of the patched one
    first, last = (_tell_hues(given[k])[1] for k in (0, -1))
    assert last > first + 300
    first, last = (sum(_tell_hues(patched[k])) for k in (0, -1))
    assert last == pytest.approx(first, rel=0.2)


@pytest.mark.slow
def test_names_in_the_picture_come_out_escaped(leg, renderer, tmp_path):
    name = HOSTILE[:20].replace("<", "&lt;").replace('"', "&quot;").replace(">", "&gt;")
    (tmp_path / "leg.xml").write_text(MODEL.replace('"knee"', f'"{name}"'))
    found = {**FINDING, "target": f"joint:{HOSTILE[:20]}"}
    page = write_page_text(replace(leg, document={**leg.document, "findings": [found]}))
    assert "<script" not in page


def test_the_camera_looks_across_the_motion():
    swing = np.linspace(-1, 1, 9)[None, :, None]
    for angle in (0.0, 0.7, -1.2):
        along = np.array([np.cos(angle), np.sin(angle)])
        assert robot._find_motion(swing * along) == pytest.approx(angle)
    assert robot._find_motion(0 * swing * along) == 0.0

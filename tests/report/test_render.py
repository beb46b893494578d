"""Moving pictures: rendered where there is OpenGL, drawn where there is none."""

import base64
import io
import re
import subprocess

import numpy as np
import pytest

from selfheal.report import render
from selfheal.report.motion import Lane
from selfheal.robot.actions import load_published_body

BODY = load_published_body()
ROWS = 13  # of 0.1 s: a picture of every other one


def _lanes(heading):
    """One that goes half a meter along a heading, one that stays."""
    way = np.linspace(0, 0.5, ROWS)[:, None] * [np.cos(heading), np.sin(heading), 0]
    level, still = np.tile([1.0, 0, 0, 0], (ROWS, 1)), np.zeros((ROWS, 8))
    goes, stays = (np.add(place, [0, 0, 0.1]) for place in (way, 0 * way))
    return [
        Lane("goes", "#0072b2", BODY, goes, level, still),
        Lane("stays", "#d55e00", BODY, stays, level, still),
    ]


def _frames(page):
    """The page's one picture as a browser sees it."""
    from PIL import Image

    (kind, coded), *others = re.findall(r"data:image/(\w+);base64,([^\"]+)", page)
    assert not others
    image = Image.open(io.BytesIO(base64.b64decode(coded)))
    frames = []
    for k in range(image.n_frames):
        image.seek(k)
        frames.append(np.asarray(image.convert("RGB"), float))
    return kind, np.array(frames)


def _moves(frames):
    """Each picture shows something, and the next one something else."""
    assert len(frames) == (ROWS + 1) // 2
    assert frames.std(axis=(1, 2, 3)).min() > 5
    return (np.abs(np.diff(frames, axis=0)).max(axis=(1, 2, 3)) > 50).all()


@pytest.mark.parametrize("program", [None, "/bin/false", "/not/there"])
def test_without_opengl_the_walk_is_drawn(monkeypatch, program):
    if program is not None:  # the driver ends the process, or none can be started
        monkeypatch.delenv("MUJOCO_GL")
        monkeypatch.setattr(render.sys, "executable", program)
    page = render.make_film(_lanes(0.0), 0.0, "c & d", sample=0.1)
    kind, frames = _frames(page)
    assert kind == "gif" and _moves(frames) and "c &amp; d" in page


def _wait(command, **more):
    raise subprocess.TimeoutExpired(command, more["timeout"])


def _render_blank(command, **more):
    for k in range(2):
        np.save(f"{command[-1]}/pictures_{k}.npy", np.zeros((1, 4, 4, 3), np.uint8))
    return subprocess.CompletedProcess(command, 0)


@pytest.mark.parametrize("driver", [_wait, _render_blank])
def test_a_driver_without_an_answer_or_of_one_color_is_given_up(
    driver, monkeypatch, renderer
):
    monkeypatch.setattr(render.subprocess, "run", driver)
    assert render.render_lanes(_lanes(0.0), 0.0, [0]) is None


@pytest.fixture(scope="module")
def opengl():
    """The picture that EGL or OSMesa renders here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MUJOCO_GL")
        shown = render.render_lanes(_lanes(0.0), 0.0, [0, ROWS - 1])
    if shown is None:
        pytest.skip("no EGL and no OSMesa here (libegl1 and libgl1-mesa-dri have one)")
    return shown


@pytest.mark.slow
def test_with_opengl_the_walk_is_rendered(opengl, renderer):
    page = render.make_film(_lanes(0.0), 0.0, "c & d", sample=0.1)
    kind, frames = _frames(page)
    assert kind == "webp" and _moves(frames)
    assert "c &amp; d" in page and len(page) < 3_000_000


def _column(picture, color):
    """Where in the picture, from left to right, the pixels of a color stand."""
    near = np.abs(picture.astype(float) - color).sum(axis=-1) < 150
    return near.any(axis=0).nonzero()[0].mean()


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_the_way_along_the_heading_goes_to_the_right(opengl, heading, renderer):
    shown = render.render_lanes(_lanes(heading), heading, [0, ROWS - 1])
    (start, end), stays = shown[0], shown[1]
    blue = np.array([0, 114, 178])
    assert _column(end, blue) - _column(start, blue) > 0.2 * start.shape[1]
    assert (stays[0] == stays[1]).all()

"""The page builder: all but markup is escaped, files are whole."""

import html
import re

import numpy as np
import pytest

from selfheal.report.identify import make_identify_page
from selfheal.report.page import (
    Html,
    Section,
    format_diff,
    make_page,
    make_table,
    write_page,
)
from selfheal.report.picture import embed_figure, make_canvas, use_page_style
from tests.support.browser import (
    HOSTILE,
    list_addresses,
    list_console_lines,
    measure_pictures,
)
from tests.support.hostile.names import HALVES, NAMES, find_raw
from tests.support.made_up_diagnosis import (
    make_diagnosis,
    make_hostile_diagnosis,
    write_page_text,
)
from tests.support.made_up_run import make_hostile_run, make_run


def test_everything_but_markup_is_escaped():
    body = make_table([HOSTILE], [[HOSTILE]], "l")
    made = make_page(HOSTILE, [Section(HOSTILE, (HOSTILE, body))], lead=HOSTILE)
    assert "<script" not in made
    assert made.count(html.escape(HOSTILE)) == 7  # the title stands twice
    assert "<b>x</b>" in make_page("", [Section("", (Html("<b>x</b>"),))], lead="")


def test_nothing_in_a_page_controls_what_shows_it():
    names = [*NAMES.values(), HALVES]
    diff = format_diff("\n".join(names))
    body = (make_table(names, [names], "l" * len(names)), diff, *names)
    made = make_page(names[0], [Section(names[1], body)], lead=names[2])
    assert not find_raw(made, keep="\n\t")
    assert r"\u202egnp.exe" in made and r"caf\udce9" in made


def test_text_in_a_figure_controls_nothing():
    with use_page_style():
        fig, ax = make_canvas(1, 1)
        ax.text(0, 0, "a\x85\u202eb\ue000")
        drawn = embed_figure(fig, NAMES["bidi"])
    assert not find_raw(drawn) and r"a\x85\u202eb\ue000" in drawn


def test_a_picture_that_is_large_as_svg_is_a_png():
    with use_page_style():
        fig, ax = make_canvas(1, 1)
        x, y = np.random.default_rng(0).random((2, 30_000))
        ax.scatter(x, -y)
        drawn = embed_figure(fig, "a & b")
    assert "<svg" not in drawn and drawn.count('src="data:image/png;base64,') == 1
    assert 'alt="a &amp; b"' in drawn


def test_a_page_is_written_whole(tmp_path):
    write_page("\u811a", tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "\u811a"
    assert len(list(tmp_path.iterdir())) == 1


PAGES = {  # what writes it, and its pictures
    "diagnosis": (lambda: write_page_text(make_diagnosis()), 2),
    "hostile diagnosis": (lambda: write_page_text(make_hostile_diagnosis()), 2),
    "run": (lambda: make_identify_page(make_run()), 5),
    "hostile run": (lambda: make_identify_page(make_hostile_run(truth=False)), 5),
}


@pytest.mark.parametrize("name", ["hostile diagnosis", "hostile run"])
def test_names_from_a_file_come_out_escaped(name):
    made = PAGES[name][0]()
    assert "<script" not in made and f"<td>{html.escape(HOSTILE)}" in made
    assert not find_raw(made) and r"\ud800" in made


@pytest.mark.parametrize("name", ["diagnosis", "run"])
def test_a_page_asks_for_nothing_from_anywhere(name):
    made = PAGES[name][0]()
    assert list_addresses(made) == []
    assert "@import" not in made and "<script" not in made
    names = re.sub(r'xmlns(:\w+)?="[^"]*"', "", made)
    assert not re.search("https?:", names)


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_a_browser_finds_no_error_and_every_picture_drawn(name, browse, tmp_path):
    from matplotlib.image import imread

    make, pictures = PAGES[name]
    made = make()
    path, shot = tmp_path / "report.html", tmp_path / "shot.png"
    write_page(made, path)
    _, log = browse(path, f"--screenshot={shot}")
    assert list_console_lines(log) == []
    boxes = measure_pictures(made, browse, tmp_path)
    assert len(boxes) == made.count("<svg") == pictures
    pixels = imread(shot)[..., :3]
    for x, y, wide, high in boxes:
        assert wide > 900 and high > 80
        seen = pixels[y : y + high, x : x + wide]
        assert seen.shape[:2] == (high, wide)
        drawn = (np.abs(seen - seen[0, 0]).max(axis=2) > 0.1).mean()
        assert 0.005 < drawn < 0.9


@pytest.mark.slow
def test_the_check_in_a_browser_sees_errors_and_requests(browse, tmp_path):
    path = tmp_path / "report.html"
    picture = Html('<img src="https://example.com/x.png">')
    write_page(make_page("", [Section("", (picture,))], lead=""), path)
    _, log = browse(path, f"--screenshot={tmp_path / 'shot.png'}")
    assert any("Content Security Policy" in line for line in list_console_lines(log))

"""Curves that zoom: all in the page, nothing else may run, the static ones in print."""

import base64
import hashlib
import html
import re
from dataclasses import replace

import pytest

from selfheal.report.page import write_page
from tests.support.browser import HOSTILE, list_console_lines, read_words
from tests.support.made_up_diagnosis import (
    make_diagnosis,
    make_hostile_diagnosis,
    write_page_text,
)

SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
# what a reader's screen shows of the curves, written into the page
LOOK = """<script>setTimeout(() => {
const shown = e => getComputedStyle(e).display != "none";
document.body.dataset.seen = JSON.stringify([
  [...document.querySelectorAll(".curves")].map(e => e.children.length > 0),
  [...document.querySelectorAll(".live")].map(shown),
  [...document.querySelectorAll(".live ~ svg")].map(shown)]);
}, 1000);</script>"""

pytest.importorskip("bokeh", reason="the extra 'interactive' is not installed")


@pytest.mark.parametrize("diagnosis", [make_diagnosis(), make_hostile_diagnosis()])
def test_the_policy_allows_the_pages_own_scripts_alone(diagnosis):
    made = write_page_text(diagnosis, live=True)
    policy = re.search(r'Policy" content="([^"]*)"', made).group(1)
    assert "default-src 'none'" in policy and "unsafe-eval" not in policy
    digests = [
        base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        for script in SCRIPT.findall(made)
    ]
    allowed = policy.partition("script-src ")[2]
    assert allowed.split() == [f"'sha256-{digest}'" for digest in digests]
    assert len(digests) == made.count("<script") == 2
    assert HOSTILE not in made


def test_the_plain_figure_stays_for_print_and_for_who_runs_no_scripts():
    live, static = (
        write_page_text(make_diagnosis(), live=live) for live in (True, False)
    )
    figures = [SCRIPT.sub("", page).count("<svg") for page in (live, static)]
    assert figures[0] == figures[1] == 2
    assert "@media print { .live { display: none; } }" in live
    assert "<script" not in static and 'class="live"' not in static
    assert "pip install 'bokeh" in html.unescape(static)
    assert "pip install" not in read_words(SCRIPT.sub("", live))


def test_a_page_without_curves_has_no_script():
    made = write_page_text(replace(make_diagnosis(), traces=()), live=True)
    assert "<script" not in made and "script-src" not in made


@pytest.mark.slow
@pytest.mark.parametrize("diagnosis", [make_diagnosis(), make_hostile_diagnosis()])
def test_a_browser_draws_the_curves_in_the_place_of_the_plain_ones(
    diagnosis, browse, tmp_path
):
    made = write_page_text(diagnosis, live=True)
    options = "--virtual-time-budget=5000", "--dump-dom"
    write_page(made, tmp_path / "report.html")
    _, log = browse(tmp_path / "report.html", *options)
    assert [line for line in list_console_lines(log) if "log level" not in line] == []
    free = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", made)
    (tmp_path / "free.html").write_text(free.replace("</body>", LOOK + "</body>"))
    dom, _ = browse(tmp_path / "free.html", *options)
    seen = html.unescape(re.search(r'data-seen="([^"]*)"', dom).group(1))
    assert seen == "[[true,true],[true],[false]]"

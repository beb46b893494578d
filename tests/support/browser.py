"""Pages of a report as a reader and a browser see them."""

import html
import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

HOSTILE = '<script>alert(1)</script>&"'  # a name that tries to break out of the page
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
# writes where the pictures are into the page
MEASURE = """<script>
document.body.dataset.pictures = JSON.stringify(
  [...document.querySelectorAll("figure > svg")].map(svg => {
    const box = svg.getBoundingClientRect();
    return [box.x, box.y, box.width, box.height].map(Math.round);
  }));
</script>"""


@contextmanager
def draw_nothing() -> Iterator[None]:
    """Figures of pages are empty, for those who read words alone."""
    from matplotlib.figure import Figure

    empty = "<svg />"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda fig, file, **how: file.write(empty))
        yield


def read_words(markup: str) -> str:
    """The words of a page."""
    bare = re.sub(r"<(style|svg).*?</\1>", " ", markup, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", bare)).split())


def list_addresses(markup: str) -> list[str]:
    """What a page would ask somebody for."""
    found = re.findall(r'\b(?:src|href|action|data|poster)="([^"]*)"', markup)
    found += re.findall(r"url\(([^)]*)\)", markup)
    return [a for a in found if not a.startswith(("#", "data:"))]


def list_console_lines(log: str) -> list[str]:
    """What the page wrote to the browser's console."""
    return [line for line in log.splitlines() if "CONSOLE" in line]


def measure_pictures(made: str, browse, folder) -> list[list[int]]:
    """Left, top, width and height [pixels] of a page's pictures, drawn without error.

    They are measured in a copy that may run a script.
    """
    free = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", made)
    (folder / "free.html").write_text(free.replace("</body>", MEASURE + "</body>"))
    dom, log = browse(folder / "free.html", "--dump-dom")
    assert list_console_lines(log) == []
    found = re.search(r'data-pictures="([^"]*)"', dom)
    assert found
    return json.loads(html.unescape(found.group(1)))

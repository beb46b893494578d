"""Pages of a report as a reader and a browser see them."""

import html
import re
import shutil

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


def read_words(markup: str) -> str:
    """What a reader reads."""
    bare = re.sub(r"<(style|svg).*?</\1>", " ", markup, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", bare)).split())


def list_console_lines(log: str) -> list[str]:
    """What the page wrote to the browser's console."""
    return [line for line in log.splitlines() if "CONSOLE" in line]

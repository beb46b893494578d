"""A browser without a screen."""

import subprocess
from pathlib import Path

import pytest

from tests.support.browser import CHROMIUM

OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--window-size=1200,6000",
    "--enable-logging=stderr",
    "--v=0",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)


@pytest.fixture
def browse(tmp_path):
    """Open a page in headless Chromium: path and options in, stdout and log out."""
    if CHROMIUM is None:
        pytest.skip("no chromium to open the page with (Debian: apt install chromium)")

    def run(path: Path, *options: str) -> tuple[str, str]:
        own = [f"--user-data-dir={tmp_path / 'profile'}", *options, path.as_uri()]
        done = subprocess.run(
            [CHROMIUM, *OPTIONS, *own],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        return done.stdout, done.stderr

    return run

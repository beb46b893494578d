"""The arm as a file."""

from pathlib import Path

import pytest

from tests.support.mjcf_models import ARM, write_file


@pytest.fixture
def arm(tmp_path) -> Path:
    return write_file(tmp_path / "arm.xml", ARM)

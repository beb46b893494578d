"""A recording on disk."""

import pytest

from selfheal.recording import write


@pytest.fixture
def file(recording, tmp_path):
    """The recording on disk."""
    path = tmp_path / "arm.h5"
    write(recording, path)
    return path

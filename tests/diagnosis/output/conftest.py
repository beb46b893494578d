"""A diagnosis on disk that found nothing."""

from pathlib import Path

import pytest

from selfheal.recording import Recording
from tests.support.diagnosis_folder import write_empty_diagnosis
from tests.support.recorded_robots import ROBOTS, record


@pytest.fixture
def empty_diagnosis(tmp_path) -> tuple[Path, Recording]:
    """The folder of a diagnosis that found nothing, and a recording."""
    path = tmp_path / "model.xml"
    path.write_text(ROBOTS["arm"].xml)
    folder = write_empty_diagnosis(tmp_path / "out", path)
    return folder, record(ROBOTS["arm"], seconds=0.3)

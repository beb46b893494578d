"""A body of the 2006 robot with other lengths than it was built with."""

import numpy as np
import pytest

from selfheal.body.body import Bodies
from selfheal.body.genome import decode_unit_genes
from selfheal.robot.actions import load_published_body

GENES = np.array([[0.125, 0.1875, 0.2083, 0.2188, 0.275, 0.3958, 0.4821, 0.5469]])


@pytest.fixture
def known() -> Bodies:
    """The body of these genes."""
    return decode_unit_genes(load_published_body().anatomy, GENES)

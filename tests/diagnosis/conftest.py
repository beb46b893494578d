"""Robots of the diagnosis, recorded once: their models say all that they do."""

import pytest

from tests.support.recorded_robots import Bench, bench


@pytest.fixture(scope="session")
def arm(tmp_path_factory) -> Bench:
    folder = tmp_path_factory.mktemp("arm")
    return bench("arm", folder, episodes=3, seconds=1.2, seed=2)


@pytest.fixture(scope="session")
def pendulum(tmp_path_factory) -> Bench:
    folder = tmp_path_factory.mktemp("pendulum")
    return bench("pendulum", folder, episodes=3, seconds=1.5, seed=2)


@pytest.fixture(scope="session")
def cart_pole(tmp_path_factory) -> Bench:
    folder = tmp_path_factory.mktemp("cart_pole")
    return bench("cart_pole", folder, episodes=4, seconds=2.0, seed=2)

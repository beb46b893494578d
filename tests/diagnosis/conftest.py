"""Robots of the diagnosis, recorded once: their models say all that they do."""

from dataclasses import replace

import pytest

from tests.support.effect_robots import make_effect_bench
from tests.support.recorded_robots import ROBOTS, Bench, bench, places


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


@pytest.fixture(scope="session")
def noiseless_arm(tmp_path_factory) -> Bench:
    """An arm with many exact readings."""
    folder = tmp_path_factory.mktemp("arm")
    return bench("arm", folder, episodes=30, seconds=2.0, rate=200, seed=3, noise=0.0)


@pytest.fixture(scope="session")
def benches(tmp_path_factory):
    """Robots of different shape, their recordings, and what they predict as given."""
    return {
        n: make_effect_bench(ROBOTS[n], tmp_path_factory.mktemp(n)) for n in places()
    }


# a model that states much of what an effect could be
STATING = {
    "arm": {
        'damping="0.03"': 'damping="0.03 0.002"',
        'armature="0.005"': 'armature="0.005" frictionloss="0.05" stiffness="0.5" '
        'springref="0.2" limited="true" range="-0.6 0.5"',
        'kp="10" kv="0.4"': 'kp="10" kv="0.4" forcerange="-1 1.2" delay="0.01" '
        'nsample="8"',
    },
    "box": {
        'friction="0.6 0.005 0.0001"/>\n    <body': 'friction="0.6 0.005 0.0001" '
        'solref="0.01 0.7"/>\n    <body',
        'friction="0.6 0.005 0.0001"/>\n    </body': 'friction="0.9 0.005 0.0001"/>\n'
        "    </body",
    },
}


@pytest.fixture(scope="session")
def stating(tmp_path_factory):
    """Robots whose models state springs, stops, limits, dry friction, a soft floor."""
    found = {}
    for name, changes in STATING.items():
        xml = ROBOTS[name].xml
        for old, new in changes.items():
            assert old in xml
            xml = xml.replace(old, new)
        robot = replace(ROBOTS[name], xml=xml)
        found[name] = make_effect_bench(robot, tmp_path_factory.mktemp(name))
    return found

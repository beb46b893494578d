"""Laws of the search in the linear model: what is missing, at once and no more."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.linear.fit import LinearFit, start_fit
from selfheal.diagnosis.linear.measurement import is_measured, measure_motion
from selfheal.diagnosis.linear.search import Search
from selfheal.diagnosis.linear.torque_balance import TorqueBalance, can_be_linear
from selfheal.diagnosis.simulation.cache import OutOfTime
from selfheal.recording import Recording
from tests.support.recorded_robots import (
    NO_COMMAND,
    ROBOTS,
    Bench,
    Robot,
    bench,
    make_bench,
)

ANGLES = ("shoulder", "elbow")
ARM = replace(ROBOTS["arm"], signals={n: ("joint_position", n, "rad") for n in ANGLES})
FREE = Robot(
    """<mujoco model="free"><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body name="rod"><joint name="hinge" axis="0 1 0"/>
<geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/>
</body></worldbody></mujoco>""",
    {
        "angle": ("joint_position", "hinge", "rad"),
        "rate": ("joint_velocity", "hinge", "rad/s"),
    },
    NO_COMMAND,
    lambda rng: (rng.uniform(1.5, 2.5, 1), np.zeros(1)),
)
DRY, ROTOR = (0.12, 0.05), (0.03, 0.008)


def lack_friction_and_rotors(model):
    model.dof_frictionloss[:] = DRY
    model.dof_armature[:] += ROTOR


def find_effects(robot: Robot, folder, **how) -> dict[tuple[str, str], np.ndarray]:
    """Values by effect and target that the search ends with."""
    return search(bench(robot, folder, **how))


def search(
    b: Bench, run=Search.run, progress=lambda what, named: None
) -> dict[tuple[str, str], np.ndarray]:
    """The same, of a robot's recording that is there; as `run` runs the search."""
    motion = measure_motion(b.simulator, np.random.default_rng(0))
    effects = [e for n, e in load_catalogue().items() if n != "quantization"]
    candidates = [
        t for e in effects for t in e.propose_terms(b.robot) if can_be_linear(t)
    ]
    start = start_fit(TorqueBalance(motion), build_nominal_terms(b.robot))
    return list_values(run(Search(start, candidates, progress)))


def list_values(fit: LinearFit) -> dict[tuple[str, str], np.ndarray]:
    """Values of the named effects by effect and target."""
    each = zip(fit.named, fit.named_values, strict=True)
    return {(t.effect.name, t.targets[0]): values for t, values in each}


def mirror(recording: Recording) -> Recording:
    """The recording of a robot whose joints all turn the other way."""
    episodes = {
        key: replace(
            e,
            ctrl=-e.ctrl,
            qpos0=-e.qpos0,
            qvel0=-e.qvel0,
            signals={n: replace(s, values=-s.values) for n, s in e.signals.items()},
        )
        for key, e in recording.episodes.items()
    }
    return replace(recording, episodes=episodes)


@pytest.mark.parametrize("robot", [ARM, ROBOTS["cart_pole"]], ids=["arm", "cart_pole"])
def test_a_robot_as_its_model_says_lacks_nothing(robot, tmp_path):
    assert not find_effects(robot, tmp_path, episodes=3, seconds=4.0, seed=5)


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """What an arm lacks, found: dry friction and a rotor at both joints."""
    folder = tmp_path_factory.mktemp("arm")
    return find_effects(
        ARM, folder, episodes=3, seconds=6.0, seed=4, change=lack_friction_and_rotors
    )


@pytest.mark.slow
def test_all_that_drives_lack_is_found_at_once(drives):
    wanted = {
        (e, f"joint:{j}") for e in ("coulomb_friction", "armature") for j in ANGLES
    }
    assert set(drives) == wanted
    for joint, friction in zip(ANGLES, DRY, strict=True):
        found = drives["coulomb_friction", f"joint:{joint}"]
        assert found == pytest.approx([friction], rel=0.2)


@pytest.mark.slow
def test_a_hand_that_pushes_once_makes_no_name(drives, tmp_path):
    def push(data):
        data.qfrc_applied[0] = 2.0 if 1.0 < data.time < 1.25 else 0.0

    found = find_effects(
        ARM, tmp_path, episodes=3, seconds=6.0, seed=4,
        change=lack_friction_and_rotors, torque=push,
    )  # fmt: skip
    assert set(found) == set(drives)


@pytest.mark.slow
def test_a_robot_seen_in_a_mirror_lacks_the_same(drives, tmp_path):
    how = {"episodes": 3, "seconds": 6.0, "seed": 4, "change": lack_friction_and_rotors}
    given = bench(ARM, tmp_path, **how).recording
    turned = replace(ARM, xml=ARM.xml.replace('axis="0 1 0"', 'axis="0 -1 0"'))
    found = search(make_bench(turned, tmp_path, mirror(given)))
    assert set(found) == set(drives)
    for key, values in drives.items():
        assert found[key] == pytest.approx(values, rel=0.02)


def test_three_laws_of_friction_of_one_pendulum_are_told_apart(tmp_path):
    def change(model):
        model.dof_frictionloss[:] = 6e-3
        model.dof_damping[:] = 3e-3
        model.dof_dampingpoly[0, 0] = 1e-3

    found = find_effects(
        FREE, tmp_path, episodes=4, seconds=20.0, seed=3, change=change, noise=2e-3
    )
    assert {effect for effect, _ in found} <= {
        "coulomb_friction", "viscous_friction", "quadratic_damping", "fluid_drag",
    }  # fmt: skip
    assert len(found) == 3


def test_joints_that_are_not_read_need_simulations(tmp_path):
    assert is_measured(bench(ARM, tmp_path, seconds=0.5).simulator)
    half = bench(ROBOTS["half_seen_arm"], tmp_path, seconds=0.5)
    assert not is_measured(half.simulator)


def test_a_search_whose_time_is_over_has_the_best_that_it_tried(tmp_path):
    """In the middle of a move, too."""

    def change(model):
        model.dof_frictionloss[1] = 0.2

    tried: list[str] = []

    def tell(what, named):
        if tried:
            raise OutOfTime
        tried.append(what)

    def run_until_over(search: Search) -> LinearFit:
        assert not search.reached.named
        with pytest.raises(OutOfTime):
            search.run()
        return search.reached

    found = search(bench(ARM, tmp_path, change=change), run_until_over, tell)
    assert len(tried) == 1 and set(found) == {("coulomb_friction", "joint:elbow")}

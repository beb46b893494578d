"""Recovering legged robots: the laws of both searches, the loop, and the command."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from typer.testing import CliRunner

from selfheal.body.damage import Damage
from selfheal.body.legged import LEGGED, load_legged_robot, reduce_damages
from selfheal.cli import app
from selfheal.engine import reflex
from selfheal.engine.reflex import (
    STEPS_PER_SAMPLE,
    build_damaged_plants,
    build_intact_plants,
    scale_physics,
    simulate_controllers,
)
from selfheal.errors import InputError, RunFileError, UnknownNameError
from selfheal.gait import genetic
from selfheal.gait.genetic import (
    KEPT,
    POPULATION,
    draw_values,
    evolve_population,
    start_population,
)
from selfheal.recovery import explain as ours
from selfheal.recovery import fit_physics as fitting
from selfheal.recovery.estimate import Trial, decode_hypotheses, make_damage_score
from selfheal.recovery.explain import HypothesisPosterior, estimate_damage
from selfheal.recovery.fit_physics import fit_physics
from selfheal.recovery.phased_run import load_phased_run, save_phased_run
from selfheal.recovery.recover import recover_robot
from selfheal.recovery.recover_run import (
    METHODS,
    RecoverRun,
    RecoverSettings,
    is_damage_named,
    serialize_hypotheses,
    summarize_beliefs,
)
from selfheal.report.recover import make_recover_page
from selfheal.robot.scenarios import SCENARIOS, draw_scenario
from selfheal.robot.simulated_legs import SimulatedLegs
from tests.support.short_recover import DEAF, JAM, LOST, LOWER, shorten

QUADRUPED = load_legged_robot("quadruped")
FLAT = np.full((200, 8), 0.05)
BUILT = np.ones((1, 10))  # the model is right


def _weights(count, robot=QUADRUPED, seed=0):
    return draw_values(count, robot.synapses, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def walker():
    """Weights with which the whole quadruped goes farthest of a few."""
    weights = _weights(60)
    return weights[
        np.argmax(
            simulate_controllers(
                build_intact_plants(QUADRUPED, 60), weights
            ).displacement
        )
    ]


@pytest.mark.parametrize(
    ("name", "synapses", "motors", "feet", "places"),
    [("quadruped", 68, 8, 4, 8), ("hexapod", 120, 18, 6, 12)],
)
def test_robots_have_the_counts_of_the_overview(name, synapses, motors, feet, places):
    robot = load_legged_robot(name)
    assert robot.synapses == synapses
    assert (len(robot.motors), robot.feet) == (motors, feet)
    assert len(robot.sensors) == 2 * feet
    assert len(robot.damage_sites) == places
    assert len(load_legged_robot(name, apart=True).damage_sites) == motors


def test_what_there_is_not_is_refused():
    with pytest.raises(UnknownNameError, match="hexapod, quadruped"):
        load_legged_robot("tripod")
    with pytest.raises(InputError, match="30 or 45"):
        load_legged_robot("quadruped", 60)
    with pytest.raises(InputError, match="1 to 15"):
        draw_scenario(16, QUADRUPED, 0)


def test_a_batch_does_what_plain_mujoco_and_a_plain_network_do(walker):
    """The reference that speed is measured against, once as a parity test."""
    from benchmarks.recover.reference import walk_plain

    steps = 200
    ours = simulate_controllers(
        build_intact_plants(QUADRUPED, 3), np.tile(walker, (3, 1)), steps
    )
    assert ours.displacement == pytest.approx(
        walk_plain(QUADRUPED, walker, steps), abs=1e-9
    )


@pytest.mark.parametrize("name", LEGGED)
def test_what_is_nothing_changes_nothing(name):
    robot = load_legged_robot(name)
    weights = _weights(2, robot)
    kinds = [
        Damage("weak_motor", f"actuator:{robot.motors[0]}", 1.0),
        Damage("weak_sensor", f"sensor:{robot.sensors[0]}", 1.0),
        Damage("slope", value=0.0),
        Damage("wind", value=0.0),
        Damage("ground_friction", value=1.0),
    ]
    before = simulate_controllers(build_intact_plants(robot, 2), weights, 100)
    after = simulate_controllers(build_damaged_plants(robot, [kinds] * 2), weights, 100)
    np.testing.assert_array_equal(before.path, after.path)
    assert not before.failed.any()


def test_damage_does_what_it_says(walker):
    said = [(), (LOST,), (JAM,), (DEAF,), (Damage("neuron_dead", "neuron:0"),),
            (Damage("wind", value=10.0),)]  # fmt: skip
    drives = simulate_controllers(
        build_damaged_plants(QUADRUPED, said), np.tile(walker, (len(said), 1))
    )
    touch, hip = (
        QUADRUPED.sensors.index(s)
        for s in ("left_front_lower_touch", "right_back_hip_position")
    )
    assert (drives.sensors[1, :, touch] == -1).all()  # nothing there to touch with
    assert np.abs(drives.sensors[2, :, hip]).max() < 0.02
    dead = QUADRUPED.sensors.index("left_back_lower_touch")
    assert (drives.sensors[3, :, dead] == 0).all()
    assert drives.displacement[5] > drives.displacement[0]
    assert len(np.unique(np.round(drives.displacement, 6))) == len(said)


def test_a_run_that_fails_never_wins(walker, monkeypatch):
    monkeypatch.setattr(reflex, "FASTEST", 1e-6)  # whatever moves has diverged
    drives = simulate_controllers(
        build_intact_plants(QUADRUPED, 2), np.tile(walker, (2, 1)), 50
    )
    assert drives.failed.all() and (drives.displacement == -np.inf).all()
    assert np.isnan(drives.sensors).all()
    monkeypatch.undo()
    pool = start_population(3, lambda g: np.where(g[:, 0] > 0, np.nan, g[:, 0]),
                 np.random.default_rng(0))  # fmt: skip
    assert pool.genomes[0, 0] <= 0 and np.isfinite(pool.scores[0])


def _square(genomes):
    return -(genomes**2).sum(axis=1)


def test_the_search_of_2004_is_as_described():
    rng, asked = np.random.default_rng(1), []

    def score(genomes):
        asked.append(len(genomes))
        return _square(genomes)

    pool = start_population(68, score, rng)
    assert len(pool.genomes) == POPULATION == asked[0]
    steps = evolve_population(pool, score, rng, 29)
    for pool in steps:
        assert (np.diff(pool.best) >= 0).all()
    assert pool.evaluations == 1550 and sum(asked) < 1550  # copies are not run again
    assert len(pool.best) == 30
    np.testing.assert_array_equal(pool.genomes, np.round(pool.genomes, 2))
    assert np.abs(pool.genomes).max() <= 1
    assert (np.diff(pool.scores) <= 0).all()


def test_earlier_results_seed_the_next_search():
    seeds = np.zeros((2, 5))
    pool = start_population(5, _square, np.random.default_rng(0), seeds)
    assert (pool.genomes[:2] == 0).all() and pool.scores[0] == 0


def test_children_are_copies_with_point_mutations_and_crossovers():
    rng = np.random.default_rng(0)
    kept = draw_values(KEPT, 200, rng)
    new = genetic.breed_children(kept, rng, 0.01)
    same = (new[:, None] == kept).mean(axis=2).max(axis=1)
    assert new.shape == (POPULATION - KEPT, 200)
    assert 0.97 < np.median(same) < 1
    assert (same < 0.97).sum() <= 24  # those that were crossed


def test_genomes_say_damage_as_the_overview_describes():
    off, on = -1.0, 1.0
    genome = np.array([[on, -1, -1, 0, on, 0, 1, 0, on, 1, -1, 0, off, 0, 0, 0]])
    (said,) = decode_hypotheses(genome, QUADRUPED)
    assert said == (
        Damage("joint_jam", "joint:right_back_knee"),
        Damage("limb_loss", "body:left_front_upper"),
        Damage("sensor_dead", "sensor:left_front_lower_touch"),
    )
    assert decode_hypotheses(np.full((1, 16), off), QUADRUPED) == [()]


def test_what_a_loss_says_is_not_said_twice():
    knee = Damage("joint_jam", "joint:left_front_knee")
    angle = Damage("sensor_dead", "sensor:left_front_hip_position")
    said = reduce_damages(QUADRUPED, [LOWER, knee, LOST, JAM, angle, JAM])
    assert said == (JAM, LOST)
    one, two = build_damaged_plants(QUADRUPED, [said, (LOST, JAM, angle)])[[0]], None
    two = build_damaged_plants(QUADRUPED, [(LOST, LOWER, JAM, angle)])
    for f in fields(one)[1:3]:
        np.testing.assert_array_equal(getattr(one, f.name), getattr(two, f.name))


def test_the_true_damage_explains_its_displacement(walker):
    robot = SimulatedLegs(QUADRUPED, 0).struck((LOST,))
    drives = robot.run_trials(walker[None])
    trial = Trial(walker, float(drives.displacement[0]), drives.sensors[0])
    genome = np.full((2, 16), -1.0)
    genome[0, :3] = [1, -1, -1]
    right, wrong = make_damage_score(QUADRUPED, [trial])(genome)
    assert right == pytest.approx(0) and wrong < -0.01


def _quiet(share):
    pass


def _before(weights):
    return SimulatedLegs(QUADRUPED, 0).run_trials(weights[None]).sensors[0]


def _trial(damage, weights, gap=0.0):
    drives = SimulatedLegs(QUADRUPED, 0, gap).struck(damage).run_trials(weights[None])
    return Trial(weights, float(drives.displacement[0]), drives.sensors[0])


MOTOR = Damage("weak_motor", "actuator:right_front_hip_servo", 0.4)
KNOWN = [LOST, LOWER, JAM, DEAF, replace(MOTOR, value=0.3), replace(MOTOR, value=0.6),
         Damage("slope", value=0.1), Damage("ground_friction", value=0.2)]  # fmt: skip


@pytest.mark.parametrize("damage", [(), (DEAF,), (MOTOR,), (LOST, JAM, DEAF)])
def test_sensor_series_tell_what_broke(damage, walker, monkeypatch):
    monkeypatch.setattr(ours, "list_single_damages", lambda robot: KNOWN)
    trial, before = _trial(damage, walker), _before(walker)
    belief = estimate_damage(QUADRUPED, BUILT, [trial], before, (), _quiet)
    best = {(d.kind, d.target) for d in belief.hypotheses[0]}
    assert best == {(d.kind, d.target) for d in damage}
    assert belief.probability[0] == belief.probability.max()
    assert belief.probability.sum() == pytest.approx(1)


def test_nothing_broke_where_robot_and_model_differ(walker):
    robot = SimulatedLegs(QUADRUPED, 3, gap=0.1)
    before = robot.run_trials(walker[None]).sensors[0]
    trial = Trial(walker, 0.0, before)
    belief = estimate_damage(QUADRUPED, BUILT, [trial], before, (), _quiet)
    assert belief.hypotheses[0] == ()
    assert (belief.scale[-1] > FLAT[-1]).all()


def test_a_model_that_is_right_stays_as_it_is(walker):
    rng = np.random.default_rng(0)
    found = fit_physics(QUADRUPED, walker, _before(walker), rng, _quiet)
    np.testing.assert_array_equal(found, BUILT)
    plants = build_damaged_plants(QUADRUPED, [(LOST,), (JAM,)])
    same = scale_physics(plants, found)
    for f in fields(plants)[1:]:
        np.testing.assert_array_equal(getattr(plants, f.name), getattr(same, f.name))


@pytest.fixture(scope="module")
def off(walker):
    """A robot that is off its model, how it walked whole, and how it may be off."""
    robot = SimulatedLegs(QUADRUPED, 0, gap=0.05)
    before = robot.run_trials(walker[None]).sensors[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "_FIRST_SEARCHES", 6)
        patch.setattr(fitting, "_HORIZONS", (20, 30, 40, 60))
        found = fit_physics(QUADRUPED, walker, before, np.random.default_rng(0), _quiet)
    return robot, before, found


def test_a_model_is_fitted_to_how_the_whole_robot_walked(walker, off):
    _, before, found = off
    assert len(found) > 1
    both = np.vstack([BUILT, found[:1]])
    plants = scale_physics(build_intact_plants(QUADRUPED, 2), both)
    sensed = simulate_controllers(plants, np.tile(walker, (2, 1)), 60).sensors
    built, fitted = ((sensed - before[: 60 // STEPS_PER_SAMPLE]) ** 2).mean(axis=(1, 2))
    assert fitted < built / 2


@pytest.mark.parametrize("damage", [(LOST,), (DEAF,)])
def test_a_robot_that_is_off_its_model_is_not_told_more_damage_than_it_has(
    damage, walker, off, monkeypatch
):
    world = [
        d for d in ours.list_single_damages(QUADRUPED) if d.kind in ("slope", "wind")
    ]
    monkeypatch.setattr(ours, "list_single_damages", lambda robot: [*KNOWN, *world])
    robot, before, found = off
    drives = robot.struck(damage).run_trials(walker[None])
    trial = Trial(walker, float(drives.displacement[0]), drives.sensors[0])
    belief = estimate_damage(QUADRUPED, found, [trial], before, (), _quiet)
    assert belief.hypotheses[0] == damage
    assert 1 <= len(belief.scale) < len(before)  # no longer than predictions hold


def test_what_reads_the_same_is_believed_once():
    weak = Damage("weak_sensor", DEAF.target, 0.02)
    several = [(weak,), (DEAF,), (replace(weak, value=0.0201),)]
    phase = {
        "believed": serialize_hypotheses(several),
        "probability": [0.4, 0.35, 0.25],
    }
    shares = summarize_beliefs(phase)
    assert list(shares.values()) == [pytest.approx(0.65), pytest.approx(0.35)]


@pytest.mark.parametrize("number", SCENARIOS)
@pytest.mark.parametrize("name", LEGGED)
def test_scenarios_strike_what_is_there(name, number):
    robot = load_legged_robot(name)
    for seed in range(4):
        damage = draw_scenario(number, robot, seed)
        assert damage == draw_scenario(number, robot, seed)
        assert reduce_damages(robot, damage) == tuple(
            sorted(damage, key=lambda d: (d.kind, d.target))
        )
        assert len(damage) == {4: 2, 7: 2, 8: 3, 9: 0}.get(number, 1)
        build_damaged_plants(robot, [damage])


@pytest.fixture
def short(monkeypatch):
    """Searches of a second."""
    shorten(monkeypatch.setattr)


def _settings(method="ours", number=1, **more):
    damage = (LOWER,) if number == 1 else draw_scenario(number, QUADRUPED, 0)
    return RecoverSettings("quadruped", number, damage, method, seed=2,
                           generations=2, **more)  # fmt: skip


def _steps(settings, run=None):
    robot = SimulatedLegs(settings.legged_robot, settings.seed, settings.gap)
    return list(recover_robot(robot, settings, run=run))


def _told(run):
    phases = {k: {**p, "seconds": 0} for k, p in run.phases.items()}
    told = [phases, {**run.result, "seconds": 0}]
    return json.dumps(told, default=np.ndarray.tolist, sort_keys=True)


@pytest.mark.parametrize("method", METHODS)
def test_a_recovery_that_was_killed_goes_on_to_the_same_end(method, short, tmp_path):
    settings = _settings(method, trials=2)
    steps = _steps(settings)
    save_phased_run(steps[1], tmp_path / "recover.h5")
    kept = load_phased_run(tmp_path / "recover.h5", RecoverRun)
    assert _told(_steps(settings, kept)[-1]) == _told(steps[-1])
    assert len(_steps(settings, steps[-1])) == 1
    page = make_recover_page(steps[-1])
    assert "Footfalls" in page and "left front lower lost" in page
    assert "<script" not in page


def test_the_result_has_what_scripts_need(short):
    run = _steps(_settings(trials=1))[-1]
    result = json.loads(json.dumps(run.result, allow_nan=False))
    assert list(result) == [
        *("format", "version", "robot", "seed", "scenario", "method", "damage"),
        *("alarm", "hypotheses", "actions", "trials", "distance", "predicted"),
        "seconds",
    ]
    assert is_damage_named(run) is True
    assert list(result["hypotheses"][0]) == ["kind", "target", "value", "probability"]
    assert len(result["trials"]) == result["actions"] == 1
    assert list(result["distance"]) == ["intact", "damaged", "healed", "best_known"]


def test_the_belief_never_depends_on_what_is_said_to_be_true(short):
    """The hidden truth stands in the settings, for the report; nobody decides by it."""
    settings = _settings(trials=1)
    robot = SimulatedLegs(settings.legged_robot, 2)
    lied = replace(settings, damage=(DEAF,))

    class Other:
        legged = robot.legged

        def run_trials(self, weights):
            return robot.run_trials(weights)

        def struck(self, damage):
            return robot.struck((LOWER,))

    *_, one = recover_robot(robot, settings)
    *_, two = recover_robot(Other(), lied)
    assert one.phases["estimate-1"]["believed"] == two.phases["estimate-1"]["believed"]
    np.testing.assert_array_equal(
        one.phases["explore-1"]["weights"], two.phases["explore-1"]["weights"]
    )


def _run(*words):
    return CliRunner().invoke(app, ["recover", *(str(word) for word in words)])


def test_on_the_command_line_a_batch_goes_on(short, tmp_path, monkeypatch):
    monkeypatch.setattr("selfheal.robot.scenarios.TABLE", (1, 9))
    monkeypatch.setattr(RecoverSettings, "__init__", _short_settings)
    made = _run("--robot", "quadruped", "--out", tmp_path, "--json",
                "--method", "as-described")  # fmt: skip
    assert made.exit_code == 0, made.output
    batch = json.loads(made.stdout)
    assert [r["scenario"] for r in batch["runs"]] == [1, 9]
    assert (tmp_path / "scenario-09" / "report.html").is_file()
    again = _run("--resume", tmp_path, "--json")
    assert json.loads(again.stdout) == batch
    taken = _run("--robot", "quadruped", "--out", tmp_path)
    assert taken.exit_code == 2 and "--force" in taken.stderr
    shown = _run("--resume", tmp_path)
    assert "quadruped, as-described" in shown.stdout
    assert "scenario 9" in shown.stdout


_INIT = RecoverSettings.__init__


def _short_settings(self, *args, **more):
    _INIT(self, *args, **{**more, "generations": 2, "trials": 1})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--resume RECOVER.h5"),
        (("--robot", "tripod"), "hexapod, quadruped"),
        (("--robot", "quadruped", "--scenario", "16"), "1 to 15"),
        (("--robot", "quadruped", "--scenario", "some"), "'all'"),
        (("--robot", "quadruped", "--method", "luck"), "as-described"),
        (("--robot", "quadruped", "--range", "60"), "30 or 45"),
        (("--robot", "quadruped", "--gap", "2"), "gap"),
        (("--robot", "quadruped", "--seed", "-1"), "negative"),
        (("--resume", "{tmp}/nothing.h5"), "no such run file"),
        (("--resume", "{tmp}"), "no recover.h5"),
        (("--resume", "{tmp}/nothing.h5", "--seed", "1"), "leave out --seed"),
    ],
)
def test_what_makes_no_sense_is_refused(words, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = _run(*(word.format(tmp=tmp_path) for word in words))
    assert made.exit_code == 2
    assert said in made.stderr and "Traceback" not in made.stderr


def test_a_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "x.h5").write_text("nothing")
    with pytest.raises(RunFileError, match=r"x\.h5"):
        load_phased_run(tmp_path / "x.h5", RecoverRun)


def test_samples_are_whole_steps_of_the_models():
    assert reflex.STEPS % STEPS_PER_SAMPLE == 0
    assert {load_legged_robot(name).model.opt.timestep for name in LEGGED} == {
        reflex.STEP
    }


def test_in_doubt_the_trial_is_one_that_separates(short, monkeypatch):
    doubt = [(DEAF,), (JAM,)]

    def torn(robot, trims, trials, before, known, progress):
        return HypothesisPosterior(tuple(doubt), np.array([0.5, 0.5]), FLAT)

    monkeypatch.setattr("selfheal.recovery.recover.estimate_damage", torn)
    run = _steps(_settings(trials=1))[-1]
    assert run.phases["explore-1"]["why"] == "separates 2 hypotheses"
    drives = simulate_controllers(build_damaged_plants(QUADRUPED, doubt),
                   np.tile(run.phases["explore-1"]["weights"], (2, 1)))  # fmt: skip
    assert np.abs(drives.sensors[0] - drives.sensors[1]).max() > 0.1

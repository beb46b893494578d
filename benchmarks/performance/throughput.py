"""Throughput of the engines against `mujoco.rollout` on the same candidates.

Takes random trees of the starfish's parts, gives its part of docs/results. Memory,
compile times and batch sizes of compiled engines are measured in fresh processes.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.suites import Record
from benchmarks.writer import ROOT, count_cores, make_parser, publish_page
from selfheal.body.body import Bodies
from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.robot.actions import list_actions_2006, load_published_body

STEPS, TIMESTEP = 100, 0.01  # of a reference simulation [1], [s]: the issue's
THREADS = 2  # of the reference: the issue's
REPEATS = 20  # of the candidates in a call of statics, which is done too soon; chosen
CPU_BATCHES, GPU_BATCHES = (64, 256, 1024), (1024, 4096, 16384, 65536)


def draw_candidates(count: int, seed: int) -> tuple[Bodies, np.ndarray]:
    """Random trees (count), and a random action of 2006 (count, P) [rad] for each."""
    anatomy, rng = load_published_body().anatomy, np.random.default_rng(seed)
    genomes = draw_genomes(anatomy, count, rng, sides=False)
    actions = list_actions_2006(anatomy.size)
    return build_bodies(anatomy, genomes), actions[
        rng.integers(len(actions), size=count)
    ]


def time_call(work: Callable[[], Any]) -> float:
    """Wall time [s] of a call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def compile_models(bodies: Bodies) -> list:
    """A compiled MuJoCo model of each body, for the reference."""
    from selfheal.body.mjcf import Physics, build_spec

    physics = Physics(timestep=TIMESTEP)
    with ThreadPoolExecutor(THREADS) as pool:
        rows = range(len(bodies))
        return list(pool.map(lambda k: build_spec(bodies, k, physics).compile(), rows))


def roll_out(compiled: list, targets: np.ndarray) -> None:
    """Simulate each model by `mujoco.rollout`; targets are (N, P) [rad]."""
    import mujoco
    from mujoco import rollout

    from selfheal.mujoco_files import silence_mujoco

    silence_mujoco()
    ramp = np.minimum(np.arange(1, STEPS + 1) / (STEPS / 2), 1)[:, None]
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS

    def one(job: tuple) -> None:
        model, target = job
        data = mujoco.MjData(model)
        start = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, start, kind)
        rollout.rollout(model, data, start, (target * ramp)[None])

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(one, zip(compiled, targets, strict=True)))


def compare_engines(count: int, rounds: int, seed: int) -> dict[str, float]:
    """Simulations a second of the reference and of statics, taking turns."""
    from selfheal.engine.statics import Statics

    bodies, targets = draw_candidates(count, seed)
    compiled, both, one = compile_models(bodies), Statics(), Statics(threads=1)
    often = bodies[np.tile(np.arange(count), REPEATS)], np.tile(targets, (REPEATS, 1))
    both.simulate(*often)  # compiles
    work: dict[str, Callable[[], Any]] = {
        "reference": lambda: roll_out(compiled, targets),
        "compile": lambda: compile_models(bodies),
        "statics, all cores": lambda: both.simulate(*often),
        "statics, one core": lambda: one.simulate(*often),
    }
    taken = [[time_call(w) for w in work.values()] for _ in range(rounds)]
    spent = dict(zip(work, np.median(taken, axis=0).tolist(), strict=True))
    return {
        "reference": count / spent["reference"],
        "reference with compile": count / (spent["reference"] + spent["compile"]),
        "statics, all cores": REPEATS * count / spent["statics, all cores"],
        "statics, one core": REPEATS * count / spent["statics, one core"],
    }


def measure_engine(engine: str, batch: int, count: int) -> Record:
    """Import and compile times, rate and memory of one engine in this process."""
    import resource

    from selfheal.engine import make_engine
    from selfheal.engine.mjx import Mjx

    start = time.perf_counter()
    if engine == "mjx":
        from selfheal.engine._mjx_step import import_mjx

        import_mjx()
    elif engine == "statics":
        import selfheal.engine._settle  # noqa: F401
    else:
        import mujoco  # noqa: F401
    imported = time.perf_counter() - start
    made = Mjx(batch=batch) if engine == "mjx" else make_engine(engine)
    bodies, targets = draw_candidates(count, 1)
    head = slice(0, batch)
    first = time_call(lambda: made.simulate(bodies[head], targets[head]))
    again = time_call(lambda: made.simulate(bodies[head], targets[head]))
    chunks = [slice(k, k + batch) for k in range(0, count, batch)]
    spent = time_call(lambda: [made.simulate(bodies[c], targets[c]) for c in chunks])
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "import": imported,
        "compile": first - again,
        "rate": count / spent,
        "memory": most,
        "steps": _count_steps(made),
        "device": _name_device(engine),
    }


def _count_steps(engine: Any) -> int:
    """Time steps in a simulation; 0 where there is no time."""
    if engine.name == "mjx":
        from selfheal.engine.mjx import TIMESTEP as step
    elif engine.name == "mujoco":
        from selfheal.body.mjcf import Physics

        step = Physics().timestep
    else:
        return 0
    return round((engine.ramp + engine.hold) / step)


def _name_device(engine: str) -> str:
    """What computes, as JAX calls it."""
    if engine != "mjx":
        return "cpu"
    import jax

    return str(jax.devices()[0].device_kind)


def run_in_fresh_process(engine: str, batch: int, count: int, cache: Path) -> dict:
    """`measure_engine` in a process of its own."""
    environment = {
        **os.environ,
        "JAX_COMPILATION_CACHE_DIR": str(cache / "jax"),
        "NUMBA_CACHE_DIR": str(cache / "numba"),
    }
    module = "benchmarks.performance.throughput"
    words = [sys.executable, "-m", module, "--child", engine, str(batch), str(count)]
    done = subprocess.run(
        words, env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def measure_engines(jobs: list[tuple[str, int, int]]) -> list[Record]:
    """Each engine at each batch size, with empty caches and with filled ones."""
    found = []
    for engine, batch, count in jobs:
        with tempfile.TemporaryDirectory() as folder:
            cold = run_in_fresh_process(engine, batch, count, Path(folder))
            warm = run_in_fresh_process(engine, batch, count, Path(folder))
        found.append({"engine": engine, "batch": batch, "cold": cold, "warm": warm})
        print(f"{engine}, batch {batch}: {warm['rate']:,.0f}/s", file=sys.stderr)
    return found


def time_help(times: int = 5) -> float:
    """Median time of `selfheal --help` [s]."""
    program = Path(sys.executable).with_name("selfheal")
    words = [str(program), "--help"]

    def run() -> None:
        subprocess.run(words, stdout=subprocess.DEVNULL, check=True)

    return float(np.median([time_call(run) for _ in range(times)]))


def _list_jobs(quick: bool) -> list[tuple[str, int, int]]:
    """(engine, batch size, simulations) to measure on this machine."""
    with tempfile.TemporaryDirectory() as folder:
        device = run_in_fresh_process("mjx", 64, 64, Path(folder))["device"]
    batches = CPU_BATCHES if device == "cpu" else GPU_BATCHES
    if quick:
        return [("statics", 256, 2048), ("mujoco", 64, 64), ("mjx", batches[0], 256)]
    jobs = [("statics", batch, 16384) for batch in (36, 256, 1024, 16384)]
    jobs += [("mujoco", batch, 1024) for batch in (64, 1024)]
    return jobs + [("mjx", batch, max(4096, 2 * batch)) for batch in batches]


def main() -> None:
    """Measure all engines and publish."""
    line = make_parser(__doc__ or "")
    line.add_argument("--quick", action="store_true", help="tiny sizes")
    line.add_argument("--seed", type=int, default=20261121, help="of the candidates")
    line.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    options = line.parse_args()
    if options.child:
        engine, batch, count = options.child
        print(json.dumps(measure_engine(engine, int(batch), int(count))))
        return
    count, rounds = (200, 1) if options.quick else (2000, 5)
    figures = {
        "count": count,
        "rounds": rounds,
        "targets": {"reference": "60", "reference with compile": "150"},
        "ratios": compare_engines(count, rounds, options.seed),
        "engines": measure_engines(_list_jobs(options.quick)),
        "help": time_help(),
        "cores": count_cores(),
    }
    page = Path(__file__).with_name("throughput.md")
    publish_page(options.root, "throughput", page, figures)


if __name__ == "__main__":
    main()

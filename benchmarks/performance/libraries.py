"""Own code beside the libraries that could take its place: time, digits, fitness.

Each row runs both on the same numbers, alternately, in one process. docs/design.md
draws the conclusions. Needs `pip install -e '.[benchmarks]'`.
"""

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.writer import Section, make_parser, publish_results
from selfheal.damage.apply import apply_damages
from selfheal.damage.words import parse_damages
from selfheal.diagnosis.estimation.covariance import _correlation_time
from selfheal.diagnosis.output.localization import _correct_holm
from selfheal.diagnosis.simulation.checkpoint import Checkpoint
from selfheal.engine.plant import build_rated_plant
from selfheal.engine.walk import rotate_into_frame
from selfheal.evolution.cma_es import ask, start_search, tell
from selfheal.gait import synthesis
from selfheal.gait.synthesis import GaitTask, LikelyPlants, synthesize_gaits
from selfheal.report.page import make_table
from selfheal.robot.actions import load_published_body

REPEATS = 7  # of each call, of which the median counts
DIMENSIONS, CHILDREN, SEEDS = 20, 14, 15  # of the searches; children as heal has them
TARGET, MOST = 1e-6, 60_000  # value at which a search ends; evaluations at most
Call = Callable[[], Any]


def time_alternately(own: Call, library: Call) -> tuple[float, float]:
    """Median times [s] of two calls, which take turns."""
    times = np.zeros((REPEATS, 2))
    for row in times:
        for side, call in enumerate((own, library)):
            start = time.perf_counter()
            call()
            row[side] = time.perf_counter() - start
    first, second = np.median(times, axis=0)
    return float(first), float(second)


def compare_bootstrap(rng: np.random.Generator) -> tuple[Call, Call, str]:
    """The interval of a mean over 12 episodes, of 300 draws."""
    from scipy.stats import bootstrap

    squares, draws = rng.gamma(2.0, size=12), 300

    def own() -> np.ndarray:
        rows = np.random.default_rng(0).integers(12, size=(draws, 12))
        return np.quantile(squares[rows].mean(axis=1), (0.05, 0.95))

    def library() -> np.ndarray:
        made = bootstrap(
            (squares,),
            np.mean,
            n_resamples=draws,
            method="percentile",
            confidence_level=0.9,
            rng=np.random.default_rng(0),
        )
        return np.array(made.confidence_interval)

    return own, library, _describe_difference(own(), library())


def compare_holm(rng: np.random.Generator) -> tuple[Call, Call, str]:
    """Holm's correction of 64 p-values."""
    from statsmodels.stats.multitest import multipletests

    p = rng.uniform(size=(8, 8)) ** 3

    def own() -> np.ndarray:
        return _correct_holm(p, np.ones_like(p, bool)).ravel()

    def library() -> np.ndarray:
        return multipletests(p.ravel(), method="holm")[1]

    return own, library, _describe_difference(own(), library())


def compare_correlation_time(rng: np.random.Generator) -> tuple[Call, Call, str]:
    """The integrated correlation time of AR(1) noise of 2,000 samples, 0.9 a sample."""
    from emcee.autocorr import integrated_time
    from scipy.signal import lfilter

    x = lfilter([1.0], [1.0, -0.9], rng.normal(size=2000))

    def own() -> float:
        return _correlation_time(x)

    def library() -> float:
        return float(integrated_time(x, quiet=True)[0])

    return own, library, f"{own():.1f} and {library():.1f} samples; exact: 19.0"


def compare_checkpoint(rng: np.random.Generator) -> tuple[Call, Call, str]:
    """Eight megabytes of arrays found again by what they were computed from."""
    from joblib import Memory

    inputs, result = rng.normal(size=10**6), (rng.normal(size=10**6),)
    folder = TemporaryDirectory()
    kept = Checkpoint(Path(folder.name) / "own", b"programs")
    memory = Memory(Path(folder.name) / "joblib", verbose=0)

    @memory.cache
    def compute(given: np.ndarray) -> tuple[np.ndarray, ...]:
        return result

    def own() -> object:
        assert folder  # lives as long as the call
        return kept.load_or_compute(inputs, lambda: result)

    own(), compute(inputs)
    return own, lambda: compute(inputs), "equal"


def compare_table(rng: np.random.Generator) -> tuple[Call, Call, str]:
    """A table of 500 rows and four columns as HTML."""
    from jinja2 import Environment

    rows = [[f"<{x:.3f}>" for x in line] for line in rng.normal(size=(500, 4))]
    head = ("a", "b", "c", "d")
    template = Environment(autoescape=True).from_string(
        "<table><thead><tr>{% for c in head %}<th>{{ c }}</th>{% endfor %}</tr></thead>"
        "<tbody>{% for row in rows %}<tr>{% for c in row %}<td>{{ c }}</td>"
        "{% endfor %}</tr>{% endfor %}</tbody></table>"
    )
    return (
        lambda: make_table(head, rows, "llll"),
        lambda: template.render(head=head, rows=rows),
        "equal cells",
    )


def compare_rotation(rng: np.random.Generator) -> tuple[Call, Call, str]:
    """10,000 vectors turned into the frames of as many quaternions."""
    from scipy.spatial.transform import Rotation

    quat, vector = rng.normal(size=(10_000, 4)), rng.normal(size=(10_000, 3))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)

    def own() -> np.ndarray:
        return rotate_into_frame(quat, vector)

    def library() -> np.ndarray:
        return Rotation.from_quat(quat, scalar_first=True).apply(vector, inverse=True)

    return own, library, _describe_difference(own(), library())


COMPARISONS = {
    "bootstrap: scipy.stats.bootstrap": compare_bootstrap,
    "Holm's correction: statsmodels": compare_holm,
    "correlation time: emcee.autocorr": compare_correlation_time,
    "checkpoint: joblib.Memory": compare_checkpoint,
    "table of a page: jinja2": compare_table,
    "rotation: scipy's Rotation": compare_rotation,
}


def _describe_difference(own: np.ndarray, library: np.ndarray) -> str:
    """Whether two results are the same bits, or how far apart."""
    if np.array_equal(own, library):
        return "the same bits"
    return f"at most {np.abs(own - library).max():.0e} apart"


FUNCTIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "sphere": lambda x: (x**2).sum(axis=1),
    "ellipsoid": lambda x: (10 ** np.linspace(0, 6, x.shape[1]) * x**2).sum(axis=1),
    "Rosenbrock": lambda x: (
        100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2
    ).sum(axis=1),
}


def search_with_own(function: Callable[[np.ndarray], np.ndarray], seed: int) -> int:
    """Evaluations until the own evolution strategy reaches `TARGET`, or `MOST`."""
    rng = np.random.default_rng(seed)
    state = start_search(rng.normal(size=DIMENSIONS), 0.4)
    for count in range(CHILDREN, MOST, CHILDREN):
        points = ask(state, CHILDREN, rng)
        values = function(points)
        if values.min() < TARGET:
            return count
        state = tell(state, points, -values)
    return MOST


def search_with_cmaes(function: Callable[[np.ndarray], np.ndarray], seed: int) -> int:
    """Evaluations until the package cmaes reaches `TARGET`, or `MOST`."""
    from cmaes import CMA

    mean = np.random.default_rng(seed).normal(size=DIMENSIONS)
    search = CMA(mean=mean, sigma=0.4, seed=seed, population_size=CHILDREN)
    for count in range(CHILDREN, MOST, CHILDREN):
        points = np.stack([search.ask() for _ in range(CHILDREN)])
        values = function(points)
        if values.min() < TARGET:
            return count
        search.tell(list(zip(points, values, strict=True)))
    return MOST


class _CmaesState:
    """The package cmaes behind the functions of `evolution.cma_es`."""

    def __init__(self, mean: np.ndarray, sigma: float) -> None:
        from cmaes import CMA

        self.search = CMA(mean=np.array(mean), sigma=sigma, population_size=CHILDREN)
        self.mean, self.generation = mean, 0

    def ask(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, D) points; `CMA.reseed_rng` takes no seed."""
        self.search._rng = np.random.RandomState(int(rng.integers(2**31)))
        return np.stack([self.search.ask() for _ in range(count)])

    def tell(self, points: np.ndarray, scores: np.ndarray) -> "_CmaesState":
        """The same search, a generation later; what is not finite is worst."""
        values = -np.where(np.isfinite(scores), scores, -1e9)
        self.search.tell(list(zip(points, values.tolist(), strict=True)))
        self.mean, self.generation = self.search.mean, self.search.generation
        return self


def compare_gaits(seeds: int) -> list[tuple[str, str, str]]:
    """Distances of gaits made with either search, for a whole and two broken robots."""
    body = load_published_body()
    rows = []
    for words in ("", "right_lower:0.3", "loss:left_lower"):
        damages = parse_damages(words, body.anatomy) if words else ()
        likely = LikelyPlants([apply_damages(build_rated_plant(body), *damages)])
        tasks = [GaitTask(seed=seed) for seed in range(seeds)]
        own = [synthesize_gaits(likely, task)[0].predicted for task in tasks]
        with patch.multiple(
            synthesis,
            start_search=_CmaesState,
            ask=lambda state, count, rng: state.ask(count, rng),
            tell=lambda state, points, scores: state.tell(points, scores),
        ):
            other = [synthesize_gaits(likely, task)[0].predicted for task in tasks]
        means = [f"{np.mean(x):.2f} +- {np.std(x):.2f}" for x in (own, other)]
        rows.append((words or "whole", means[0], means[1]))
    return rows


def main() -> None:
    """Compare, and publish the page."""
    line = make_parser(__doc__ or "")
    line.add_argument("--gaits", type=int, default=0, help="seeds of gaits, 5 min each")
    given = line.parse_args()
    root = given.root
    rows: list[tuple[str, ...]] = []
    data: dict[str, Any] = {}
    for name, compare in COMPARISONS.items():
        own, library, note = compare(np.random.default_rng(0))
        first, second = time_alternately(own, library)
        data[name] = {"own": first, "library": second, "note": note}
        rows.append((name, f"{1e3 * first:.2f}", f"{1e3 * second:.2f}",
                     f"{second / first:.1f}", note))  # fmt: skip
    searches = []
    for name, function in FUNCTIONS.items():
        counts = np.array([
            [search_with_own(function, seed), search_with_cmaes(function, seed)]
            for seed in range(SEEDS)
        ])  # fmt: skip
        data[name] = {"own": counts[:, 0].tolist(), "cmaes": counts[:, 1].tolist()}
        searches.append((name, *np.median(counts, axis=0).astype(int),
                         *(counts < MOST).sum(axis=0)))  # fmt: skip
    sections = [
        Section(
            "Time and digits",
            f"Medians of {REPEATS} calls that take turns.",
            ("what: library", "own [ms]", "library [ms]", "library / own", "results"),
            rows,
        ),
        Section(
            "CMA-ES: cmaes",
            f"Evaluations to {TARGET:g} in {DIMENSIONS} dimensions, {CHILDREN} "
            f"children, first step 0.4; medians of {SEEDS} seeds, and how many arrived "
            f"within {MOST:,}.",
            ("function", "own", "cmaes", "own arrived", "cmaes arrived"),
            searches,
        ),
    ]
    if given.gaits:
        gaits = compare_gaits(given.gaits)
        data["gaits"] = gaits
        sections.append(
            Section(
                "CMA-ES: cmaes, in the search for gaits",
                f"Distance in 10 s that the model predicts [m], {given.gaits} seeds.",
                ("robot", "own", "cmaes"),
                gaits,
            )
        )
    publish_results(root, "libraries", "Own code beside libraries", sections, data)


if __name__ == "__main__":
    main()

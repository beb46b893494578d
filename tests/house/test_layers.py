"""Data flow one way: a room imports only from rooms above it."""

import ast
from collections import Counter
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from tests.support.paths import ROOT

ROOMS = [
    *(
        "printable",
        "errors",
        "extras",
        "notebook",
        "machine",
        "limited_reading",
        "files",
        "mujoco_files",
    ),
    *("documents", "schema", "recording", "evolution", "logs", "export", "example"),
    *("telemetry", "mjcf", "preparation", "body", "engine", "damage"),
    *("robot", "selfmodel", "gait", "recovery"),
    *("diagnosis", "report", "api", "study", "cli"),
]
INNER = {  # rooms of rooms
    "diagnosis": [
        *("data", "effects", "simulation", "estimation", "linear", "selection"),
        "output",
        "diagnose",
    ],
}
HONEST = ("selfmodel", "gait", "recovery", "diagnosis")  # never see the truth
FILES = [path for top in ("selfheal", "cli") for path in (ROOT / top).rglob("*.py")]


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts if parts[0] == "selfheal" else ("selfheal", *parts))


@cache
def _imports(path: Path, prefix: str = "selfheal.") -> frozenset[str]:
    """Full names that a file imports, relative ones resolved, wherever they stand."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = _name(path).split(".")[: -node.level] if node.level else []
            start = ".".join([*base, *filter(None, [node.module])])
            found |= {f"{start}.{alias.name}" for alias in node.names}
    return frozenset(name for name in found if name.startswith(prefix))


def _id(path: Path) -> str:
    return str(path.relative_to(ROOT))


def _list_rooms_above(path: Path) -> list[str]:
    """Rooms that a module may import from."""
    room = _name(path).split(".")[1]
    if room == "__init__":
        return ["api"]
    assert room in ROOMS, f"put {room!r} in its place in ROOMS"
    return ROOMS[: ROOMS.index(room) + 1] + ["__version__"] * (room == "cli")


def test_a_module_imports_only_from_rooms_above_it():
    below = {
        _id(path): {n for n in _imports(path) if n.split(".")[1] not in allowed}
        for path in FILES
        for allowed in [_list_rooms_above(path)]
    }
    assert not {path: names for path, names in below.items() if names}


def _find_below_in_room(path: Path) -> set[str]:
    """What a module imports from inner rooms below its own."""
    _, room, *inner = _name(path).split(".")
    if room not in INNER or inner[0] == "__init__":
        return set()
    order = INNER[room]
    assert inner[0] in order, f"put {inner[0]!r} in its place in INNER[{room!r}]"
    allowed = order[: order.index(inner[0]) + 1]
    parts = [name.split(".") for name in _imports(path)]
    return {".".join(p) for p in parts if p[1] == room and p[2] not in allowed}


def test_a_module_imports_only_from_inner_rooms_above_it():
    below = {_id(path): _find_below_in_room(path) for path in FILES}
    assert not {path: names for path, names in below.items() if names}


def test_no_module_imports_itself_by_way_of_others():
    modules = {_name(path).removesuffix(".__init__"): path for path in FILES}
    imported = {
        module: {
            name if name in modules else name.rpartition(".")[0]
            for name in _imports(path)
        }
        for module, path in modules.items()
    }
    graph = TopologicalSorter(
        {m: {x for x in xs if x in modules and x != m} for m, xs in imported.items()}
    )
    graph.prepare()  # raises a CycleError that shows the circle


def test_the_self_model_never_sees_the_hidden_truth():
    rooms = [ROOT / "selfheal" / room for room in HONEST]
    files = [path for room in rooms for path in room.rglob("*.py")]
    leaks = [
        f"{_id(path)}: {name}"
        for path in files
        for name in _imports(path)
        if name.startswith("selfheal.robot.simulated")
    ]
    assert not leaks


def test_a_test_imports_of_other_tests_only_what_they_share():
    """What several tests need stands in tests/support."""
    files = sorted((ROOT / "tests").rglob("*.py"))
    found = {_id(path): _imports(path, "tests.") for path in files}
    others = {
        path: {name for name in names if not name.startswith("tests.support.")}
        for path, names in found.items()
    }
    assert not {path: names for path, names in others.items() if names}


def test_the_check_sees_relative_and_absolute_imports(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    path = tmp_path / "selfheal" / "selfmodel" / "loop.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        "from ..robot import simulated\ndef f():\n    import selfheal.cli\n"
    )
    assert _imports(path) == {"selfheal.robot.simulated", "selfheal.cli"}


def test_no_threshold_of_diagnose_has_the_name_of_another():
    names: Counter[str] = Counter()
    for path in (ROOT / "selfheal" / "diagnosis").rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.Assign) and _is_numeric(node.value):
                targets = [n for t in node.targets for n in ast.walk(t)]
                names.update(n.id for n in targets if isinstance(n, ast.Name))
    assert names
    assert [name for name, times in names.items() if times > 1] == []


def _is_numeric(node: ast.expr) -> bool:
    """Whether an expression is a number, or numbers in a tuple."""
    if isinstance(node, ast.Tuple):
        return all(map(_is_numeric, node.elts))
    if isinstance(node, ast.UnaryOp):
        return _is_numeric(node.operand)
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)

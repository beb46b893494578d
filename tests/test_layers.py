"""Data flow one way: a room imports only from rooms above it."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = [
    *("errors", "files", "recording", "body", "engine", "robot", "selfmodel"),
    *("gait", "recovery"),
    *("diagnosis", "report", "api", "study", "cli"),
]
HONEST = ("selfmodel", "gait", "recovery", "diagnosis")  # never see the truth
FILES = [path for top in ("selfheal", "cli") for path in (ROOT / top).rglob("*.py")]


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts if parts[0] == "selfheal" else ("selfheal", *parts))


def _imports(path: Path) -> set[str]:
    """Full names that a file imports, relative ones resolved, wherever they stand."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = _name(path).split(".")[: -node.level] if node.level else []
            start = ".".join([*base, *filter(None, [node.module])])
            found |= {f"{start}.{alias.name}" for alias in node.names}
    return {name for name in found if name.startswith("selfheal.")}


def _id(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", FILES, ids=_id)
def test_a_module_imports_only_from_rooms_above_it(path):
    room = _name(path).split(".")[1]
    if room == "__init__":
        allowed = ["api"]
    else:
        assert room in ROOMS, f"put {room!r} in its place in ROOMS"
        allowed = ROOMS[: ROOMS.index(room) + 1] + ["__version__"] * (room == "cli")
    below = {name for name in _imports(path) if name.split(".")[1] not in allowed}
    assert not below


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


def test_the_check_sees_relative_and_absolute_imports(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    path = tmp_path / "selfheal" / "selfmodel" / "loop.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        "from ..robot import simulated\ndef f():\n    import selfheal.cli\n"
    )
    assert _imports(path) == {"selfheal.robot.simulated", "selfheal.cli"}

"""Sizes: short files, short functions, folders in which one finds the way."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.support.paths import ROOT

FILE_LINES, FUNCTION_LINES, FOLDER_MODULES = 400, 60, 20
PRODUCT = ("selfheal", "cli", "benchmarks")


def _list_files(*tops: str) -> list[Path]:
    return sorted(path for top in tops for path in (ROOT / top).rglob("*.py"))


def _list_functions(path: Path) -> Iterator[tuple[str, int]]:
    """Name and number of lines of each function, decorators aside."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, node.end_lineno - node.lineno + 1


def test_no_file_is_long():
    sizes = {
        str(path.relative_to(ROOT)): len(path.read_text().splitlines())
        for path in _list_files(*PRODUCT, "tests")
    }
    assert not {path: size for path, size in sizes.items() if size > FILE_LINES}


def test_no_function_is_long():
    sizes = {
        f"{path.relative_to(ROOT)}: {name}": size
        for path in _list_files(*PRODUCT)
        for name, size in _list_functions(path)
    }
    assert not {name: size for name, size in sizes.items() if size > FUNCTION_LINES}


def test_no_folder_has_many_modules():
    files = _list_files(*PRODUCT, "tests")
    modules = [path for path in files if path.name != "__init__.py"]
    counts = Counter(str(path.parent.relative_to(ROOT)) for path in modules)
    assert not {name: n for name, n in counts.items() if n > FOLDER_MODULES}


def test_the_check_counts_the_lines_of_a_function_without_its_decorators(tmp_path):
    path = tmp_path / "module.py"
    path.write_text("@decorated\n@twice\ndef long(\n    x,\n):\n    return x\n")
    assert list(_list_functions(path)) == [("long", 4)]

"""Coverage of docstrings: source files in, shares and gaps out.

What is looked at are the public modules, classes, functions and methods of a room; what
begins with an underscore and functions within functions are not. Seven rules hold:

docstring: there is one. A method that overrides a documented one inherits that, as
    `inspect.getdoc` has it; an effect has the one that its declaration makes.
shapes: where an argument, a return or a field of a dataclass is annotated as an array,
    its description has a shape, such as `(W, C)`. Aliases of array types count as well.
units: where such a thing is a float or an array and its name is that of a physical
    quantity (`QUANTITIES`), its description has a unit, such as `[rad]`, or `[1]`.
names: what `Args:` or `Attributes:` describes is there, under that name; an entry of
    `Args:` has one name, as documentation sites read it.
opening: it begins with no word that hangs on another docstring (`OPENINGS`).
sentences: none has more than 30 words. What stands in backticks counts as one word.
references: what stands in backticks and looks like a name occurs in the code.

The description of an argument is its entry in `Args:`, or else the whole docstring: an
entry stands only where it says more than the name and the type do.
That of a return is `Returns:` or `Yields:`, and the text before the first section.
"""

import ast
import builtins
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path

from tests.support.docstrings.text import Docstring, count_words, split_sentences
from tests.support.paths import ROOT

RULES = (
    *("docstring", "shapes", "units", "names", "opening", "sentences", "references"),
)
NEEDED = {rule: 1.0 for rule in RULES} | {"shapes": 0.9, "units": 0.9}
OPENINGS = ("The same", "Of its", "Those")
MOST_WORDS = 30
# Words in the names of physical quantities. Those with a meaning in mathematics or
# statistics too (scale, gain, noise, value) are left out: their unit may vary.
QUANTITIES = {
    *("angle", "angles", "heading", "azimuth", "slope", "tilt", "swing", "reach"),
    *("time", "seconds", "duration", "period", "onset", "delay", "timestep", "lag"),
    *("length", "lengths", "distance", "height", "radius", "thickness", "clearance"),
    *("position", "positions", "speed", "speeds", "velocity", "acceleration", "wind"),
    *("mass", "masses", "inertia", "density", "gravity", "stiffness", "damping"),
    *("torque", "torques", "force", "forces", "energy", "frequency", "displacement"),
}
_UNIT = (
    r"(?:1|%|n?m|mm|cm|km|m?s|h|rad|deg|k?g|N|Nm|J|W|V|A|K|Hz|px|in|nats?|bits?|B|MB"
    r"|units?|steps?|scales?|samples?|standard deviations?)"
)
_POWER = _UNIT + r"(?:\^-?\d)?"
UNITS = re.compile(rf"\[{_POWER}(?:(?: or |, |[ */]){_POWER})*\]")
SHAPE = re.compile(
    r"\((?:\.\.\.|\*?[A-Zn0-9]|[cpvw]\b)[\w' +*/-]*(?:, ?(?:\.\.\.|[\w' +*/-]+))*,?\)"
)


@dataclass
class Coverage:
    """Of one room: rule -> what was looked at and what is missing."""

    seen: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    gaps: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    def note(self, rule: str, good: bool, where: str) -> None:
        """Count one thing that a rule asks something of."""
        self.seen[rule] += 1
        if not good:
            self.gaps[rule].append(where)

    def share(self, rule: str) -> float:
        """Share of what a rule asks that is there; 1 where it asks nothing [1]."""
        seen = self.seen[rule]
        return 1.0 - len(self.gaps[rule]) / seen if seen else 1.0


@cache
def _list_nodes(path: Path) -> list[ast.AST]:
    """The nodes of a file, the module first."""
    return list(ast.walk(ast.parse(path.read_text())))


def find_aliases(files: Sequence[Path]) -> set[str]:
    """Names of types that are arrays: NumPy's, JAX's and their aliases in the code."""
    known = {"ndarray", "NDArray", "ArrayLike", "Array"}
    for path in files:
        module, *_ = _list_nodes(path)
        for node in module.body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                value = ast.unparse(node.value)
                if re.match(r"(npt\.|np\.|jax\.)?(NDArray|ndarray|Array)\b", value):
                    known.add(node.targets[0].id)
    return known


def find_names(files: Sequence[Path]) -> set[str]:
    """Every name in the code, and every word of its texts, docstrings left out."""
    known: set[str] = set(dir(builtins))
    for path in files:
        known |= {path.stem, path.parent.name}
        nodes = _list_nodes(path)
        texts = {id(n.value) for n in nodes if isinstance(n, ast.Expr)}
        for node in nodes:
            for kind in ("id", "attr", "arg", "name"):
                if isinstance(name := getattr(node, kind, None), str):
                    known |= set(name.split("."))
            if isinstance(node, ast.Constant) and id(node) not in texts:
                known |= set(re.findall(r"\w+", str(node.value)))
    return known


def find_classes(files: Sequence[Path]) -> dict[str, ast.ClassDef]:
    """The classes of the code by their names."""
    nodes = [n for path in files for n in _list_nodes(path)]
    return {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}


def list_documented(node: ast.ClassDef) -> set[str]:
    """Names of a class's own methods that have a docstring."""
    methods = [n for n in node.body if isinstance(n, ast.FunctionDef)]
    return {n.name for n in methods if ast.get_docstring(n)}


def is_named(annotation: ast.expr | None, names: set[str]) -> bool:
    """Whether an annotation has one of these types, outside of any function type."""
    if annotation is None:
        return False
    text = ast.unparse(annotation).strip("'\"")
    text = re.sub(r"Callable\[.*\]", "", text)
    return bool(set(re.findall(r"[A-Za-z_]\w*", text)) & names)


def list_arguments(node: ast.FunctionDef, in_class: bool) -> list[ast.arg]:
    """The arguments that a docstring has to describe, `self` and commands' ones out."""
    a = node.args
    every = [*a.posonlyargs, *a.args, *filter(None, [a.vararg]), *a.kwonlyargs]
    every += filter(None, [a.kwarg])
    static = any("staticmethod" in ast.unparse(d) for d in node.decorator_list)
    if in_class and not static:
        every = every[1:]
    commands = ("Annotated[", "typer.Context")
    return [
        arg
        for arg in every
        if not (arg.annotation and ast.unparse(arg.annotation).startswith(commands))
    ]


class RoomReader:
    """Reads the files of a room into its coverage."""

    def __init__(
        self, arrays: set[str], known: set[str], classes: dict[str, ast.ClassDef]
    ) -> None:
        self.arrays, self.known, self.classes = arrays, known, classes
        self.coverage = Coverage()

    def read_file(self, path: Path) -> None:
        """Look at a module and at what is public in it."""
        tree, *_ = _list_nodes(path)
        name = str(path.relative_to(ROOT))
        self._check_text(ast.get_docstring(tree), name)
        self._read_body(tree, name)

    def _read_body(self, scope: ast.Module | ast.ClassDef, where: str) -> None:
        """Look at the public definitions of a module or class."""
        for node in scope.body:
            if not isinstance(node, ast.FunctionDef | ast.ClassDef):
                continue
            if node.name.startswith("_"):
                continue
            name = f"{where}:{node.lineno} {node.name}"
            if isinstance(node, ast.ClassDef):
                self._read_class(node, name)
                self._read_body(node, where)
            elif any(_is_secondary(d) for d in node.decorator_list):
                continue
            elif isinstance(scope, ast.Module):
                self._read_function(node, name, in_class=False)
            elif ast.get_docstring(node) or not self._is_inherited(node.name, scope):
                self._read_function(node, name, in_class=True)
            else:
                self.coverage.note("docstring", True, name)

    def _is_inherited(self, method: str, owner: ast.ClassDef) -> bool:
        """Whether a base of a class, or one of that, has a method, documented."""
        names = [ast.unparse(base).split("[")[0].split(".")[-1] for base in owner.bases]
        above = [self.classes[name] for name in names if name in self.classes]
        return any(
            method in list_documented(base) or self._is_inherited(method, base)
            for base in above
        )

    def _read_class(self, node: ast.ClassDef, name: str) -> None:
        """Look at a class and the fields of a dataclass."""
        docstring = ast.get_docstring(node) or _read_description(node)
        self._check_text(docstring, name)
        parsed = Docstring.parse(docstring or "")
        self._check_entries(node, parsed, name)
        if not any("dataclass" in ast.unparse(d) for d in node.decorator_list):
            return
        for item, after in pairwise([*node.body, ast.Pass()]):
            if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                if isinstance(after, ast.Expr):  # the field's own docstring
                    parsed.entries[item.target.id] = ast.literal_eval(after.value)
                if not item.target.id.startswith("_"):
                    self._check_value(item.target.id, item.annotation, parsed, name)

    def _read_function(self, node: ast.FunctionDef, name: str, in_class: bool) -> None:
        """Look at a function or method, its arguments and its return."""
        docstring = ast.get_docstring(node)
        self._check_text(docstring, name)
        parsed = Docstring.parse(docstring or "")
        self._check_entries(node, parsed, name)
        arguments = list_arguments(node, in_class)
        for arg in arguments:
            self._check_value(arg.arg, arg.annotation, parsed, name)
        self._check_value("return", node.returns, parsed, name, quantity=node.name)

    def _check_text(self, docstring: str | None, name: str) -> None:
        """Whether there is a docstring that can be read alone."""
        self.coverage.note("docstring", bool(docstring), name)
        if docstring:
            good = not docstring.startswith(OPENINGS)
            self.coverage.note("opening", good, name)
            for sentence in split_sentences(docstring):
                words = count_words(sentence)
                if words:
                    what = f"{name}: {words} words: {sentence[:60]}"
                    self.coverage.note("sentences", words <= MOST_WORDS, what)
            for reference in re.findall(r"`(?:\w+\.)*([A-Za-z_]\w+)`", docstring):
                good = reference in self.known
                self.coverage.note("references", good, f"{name}: {reference}")

    def _check_entries(
        self, node: ast.ClassDef | ast.FunctionDef, parsed: Docstring, where: str
    ) -> None:
        """Whether what the docstring describes is there."""
        there = {n.arg for n in ast.walk(node) if isinstance(n, ast.arg)}
        there |= {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
        there |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
        there |= {n.name for n in ast.walk(node) if isinstance(n, ast.FunctionDef)}
        for name in parsed.entries:
            self.coverage.note("names", name in there | {"..."}, f"{where}: {name}")

    def _check_value(
        self,
        name: str,
        annotation: ast.expr | None,
        parsed: Docstring,
        where: str,
        quantity: str = "",
    ) -> None:
        """Whether a value has its shape and its unit."""
        text, what = parsed.describe(name), f"{where}: {name}"
        is_array = is_named(annotation, self.arrays)
        if is_array:
            self.coverage.note("shapes", bool(SHAPE.search(text)), what)
        words = set((quantity or name).lower().split("_"))
        if words & QUANTITIES and (is_array or is_named(annotation, {"float"})):
            self.coverage.note("units", bool(UNITS.search(text)), what)


def _is_secondary(decorator: ast.expr) -> bool:
    """Whether a decorator marks an overload or a setter, documented elsewhere."""
    return ast.unparse(decorator).endswith(("overload", ".setter"))


def _read_description(node: ast.ClassDef) -> str:
    """What an effect declares as its description, which is its docstring's text."""
    assigned = [item for item in node.body if isinstance(item, ast.Assign)]
    values = [a.value for a in assigned if ast.unparse(a.targets[0]) == "description"]
    return ast.literal_eval(values[0]) if values else ""


def list_rooms() -> dict[str, list[Path]]:
    """Room -> its files: the packages and modules of `selfheal`, and `cli`."""
    rooms: dict[str, list[Path]] = {"cli": sorted((ROOT / "cli").rglob("*.py"))}
    for path in sorted((ROOT / "selfheal").iterdir()):
        if path.is_dir() and (path / "__init__.py").exists():
            rooms[path.name] = sorted(path.rglob("*.py"))
        elif path.suffix == ".py":
            rooms[path.stem] = [path]
    return rooms


@cache
def _read_house() -> tuple[set[str], set[str], dict[str, ast.ClassDef]]:
    """The array types, the names and the classes of the whole code."""
    files = [path for room in list_rooms().values() for path in room]
    return find_aliases(files), find_names(files), find_classes(files)


def measure_room(name: str) -> Coverage:
    """The coverage of a room."""
    reader = RoomReader(*_read_house())
    for path in list_rooms()[name]:
        reader.read_file(path)
    return reader.coverage

"""What an extra installs is named by its libraries, wherever selfheal came from."""

import re
import tomllib

import pytest

from selfheal.errors import InputError
from selfheal.extras import DISTRIBUTION, format_install, import_extra
from tests.support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]


@pytest.mark.parametrize("extra", ["cluster", "logs", "pandas", "rerun"])
def test_the_line_names_every_library_of_an_extra(extra):
    named = re.findall(r"'([\w-]+)", format_install(extra))
    assert named == [re.match(r"[\w-]+", line)[0] for line in EXTRAS[extra]]


def test_the_distribution_has_a_name_of_its_own():
    assert PROJECT["name"] == DISTRIBUTION


def test_what_is_missing_is_said_with_the_line():
    with pytest.raises(InputError, match=r"^this needs more libraries: pip install 'd"):
        import_extra("no_such_module", "cluster", "this")


@pytest.mark.parametrize("suffix", ["py", "md", "toml", "yml"])
def test_nothing_tells_to_install_a_stranger(suffix):
    """`selfheal` on the package index is somebody else's."""
    tops = ("selfheal", "cli", "docs", "benchmarks")
    files = [p for top in tops for p in (ROOT / top).rglob(f"*.{suffix}")]
    told = re.compile(r"pip3? install[^\n&]*[' ]selfheal\b(?!-)|\bselfheal\[")
    wrong = {
        str(path.relative_to(ROOT)): found[0]
        for path in (*files, *ROOT.glob(f"*.{suffix}"))
        if (found := told.search(path.read_text()))
    }
    assert not wrong

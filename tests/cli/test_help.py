"""Every command's help ends with a line to type and a page; a shell completes names."""

import re
import shlex

import pytest
import typer
from typer.testing import CliRunner

from selfheal.cli import app
from selfheal.example.make import EXAMPLES
from selfheal.export.export import FORMATS
from selfheal.robot.open_robot import list_robots
from selfheal.telemetry import KINDS
from tests.support.paths import DOCS


def _list_commands(command=None, name=()):
    command = command or typer.main.get_command(app)
    for word, inner in getattr(command, "commands", {}).items():
        yield from _list_commands(inner, (*name, word))
    if name and not hasattr(command, "commands"):
        yield " ".join(name), command


COMMANDS = dict(_list_commands())


@pytest.mark.parametrize("name", COMMANDS)
def test_a_help_ends_with_an_example_and_a_page(name):
    result = CliRunner().invoke(app, [*name.split(), "--help"])
    example, more = result.stdout.rstrip().splitlines()[-2:]
    assert example.startswith(f"  Example: selfheal {name}") and result.exit_code == 0
    page, _, place = re.fullmatch(r"  More: docs/(.*)", more)[1].partition("#")
    heads = re.findall(r"^#+ (.*)", (DOCS / page).read_text(), re.M)
    assert not place or place in [h.lower().replace(" ", "-") for h in heads]


@pytest.mark.parametrize("name", COMMANDS)
def test_an_example_is_understood(name):
    (line,) = re.findall("Example: selfheal (.*)", COMMANDS[name].epilog)
    words = shlex.split(line)[len(name.split()) :]
    COMMANDS[name].make_context(name, words)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_place_to_write_is_asked_for_alike(name):
    options = {p.opts[0]: p for p in COMMANDS[name].params}
    if out := options.get("--out"):
        assert not out.required and "Where" in out.help


def _complete(line):
    """What a shell would offer at the end of a line."""
    env = {"_SELFHEAL_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": line}
    result = CliRunner().invoke(app, [], env=env, prog_name="selfheal")
    return re.findall(r'"([^"]+)"', result.stdout)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("selfheal identify --robot ", sorted(list_robots())),
        ("selfheal identify --robot tr", ["tree"]),
        ("selfheal recover --robot ", ["hexapod", "quadruped"]),
        ("selfheal recover --scenario 1", ["1", "10", "11", "12", "13", "14", "15"]),
        ("selfheal example ", list(EXAMPLES)),
        ("selfheal heal run.h5 --damage ja", ["jam:"]),
        ("selfheal diagnose m.xml r.h5 --no-check ", list(KINDS)),
        ("selfheal recording export r.h5 --to ", list(FORMATS)),
    ],
)
def test_a_shell_completes_names(line, words):
    found = _complete(line)
    assert [word.replace("\\", "") for word in found] == words

"""Commands as a user types them: how they end, what they say, the line of a refusal."""

from click.testing import Result
from typer.testing import CliRunner

from selfheal.cli import app


def run(*words: object) -> Result:
    """How a command ends."""
    return CliRunner().invoke(app, [str(word) for word in words])


def run_well(*words: object) -> str:
    """What a command prints that does what it was asked for."""
    ended = run(*words)
    assert ended.exit_code == 0, ended.output
    return ended.stdout


def refuse(*words: object) -> str:
    """The one line that a refusal says."""
    ended = run(*words)
    assert ended.exit_code == 2, ended.output
    assert ended.stdout == ""
    assert ended.stderr.count("\n") == 1 and "Traceback" not in ended.stderr
    assert ended.stderr.startswith("selfheal: ")
    return ended.stderr

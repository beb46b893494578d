"""A log in memory, and a model that it may be of."""

import tomllib
from pathlib import Path

import mujoco
import numpy as np

from selfheal.logs.base import Log, Stream
from selfheal.logs.convert import import_logs
from selfheal.logs.guessing.guess import Guess
from selfheal.logs.log_map import parse_map
from selfheal.recording import Episode, read

LEG = """<mujoco><worldbody>
  <body name="base"><joint name="hip" axis="0 1 0"/><geom size=".1"/><site name="imu"/>
    <body pos="0 0 -.2"><joint name="knee" axis="0 1 0"/><geom size=".1"/></body></body>
</worldbody>
<actuator><motor name="hip" joint="hip"/><motor name="knee" joint="knee"/></actuator>
<sensor><gyro name="gyro" site="imu"/></sensor></mujoco>"""


class TableLog(Log):
    """Streams given as arrays; read a few rows at a time, streams in turns."""

    def __init__(self, streams, name="run.csv", piece=7):
        self.path = Path(name)
        self.tables = {
            key: {column: np.asarray(values) for column, values in table.items()}
            for key, table in streams.items()
        }
        self.piece = piece
        self.streams = [
            Stream(key, dict.fromkeys(table, "")) for key, table in self.tables.items()
        ]

    def read(self, wanted, report=None):
        most = max(len(next(iter(t.values()))) for t in self.tables.values())
        for start in range(0, most, self.piece):
            for name, columns in wanted.items():
                table = self.tables[name]
                rows = {c: table[c][start : start + self.piece] for c in columns}
                if rows and len(next(iter(rows.values()))):
                    yield name, rows
            if report:
                report(min(1.0, (start + self.piece) / most))


def make_map(text):
    """A map of TOML."""
    return parse_map(tomllib.loads(text), "map.toml")


def list_guessed(guess: Guess) -> dict[tuple[str, str], tuple]:
    """Column, conversion, and how sure it is, by kind and target."""
    return {
        (line.kind, target.target): (target.columns[0], target.unit, target.sure)
        for line in guess.lines
        for target in line.targets
    }


def import_guess(log: Log, text: str, model: mujoco.MjModel, path: Path) -> Episode:
    """The only episode of what a map makes of a log."""
    import_logs([log], make_map(text), model, path)
    (episode,) = read(path).episodes.values()
    return episode

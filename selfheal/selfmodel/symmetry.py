"""Symmetries: one simulated body under every action stands for thousands of bodies.

Parts that are alike can trade labels: the relabeled body under an action moves as the
first body under the action with its joints traded. A square torso can be turned by
quarters and mirrored, which turns and mirrors the tilts. So a table of one body's
channels under all actions holds those of all its relabeled, turned and mirrored
twins, without a simulation.
"""

from dataclasses import dataclass
from itertools import permutations, product
from math import factorial, prod

import numpy as np

from ..body.body import Anatomy, Floats, Ints
from ..body.genome import Genomes, relabel_parts
from ..engine.channels import SENSOR_KINDS, Channels, Loss, list_channels
from .evaluate import Evidence

_MOST_TRADES = 1000  # chosen: beyond it only pairs trade labels
# hinge kinds after a mirror: left and right, roll left and roll right change places
_MIRRORED_HINGE = np.array([1, 0, 2, 3, 5, 4])


@dataclass(frozen=True)
class SymmetryGroup:
    """The group of a robot's trades (T), turns and mirrors (G).

    Attributes:
        trade: (T, P) part i + 1 becomes part trade[t, i] + 1; the first is identity.
        action: (T, A) index of the action that the first body must do for its twin
            to have done action a; -1 if the robot does not offer it.
        turns: (G, 2) quarters turned to the left, then 1 if mirrored (left to right).
        channel: (G, C, C) what that does to the channels [1].
        column: (T, C) of the body, in which the twin of a trade has each channel.
    """

    trade: Ints
    action: Ints
    turns: Ints
    channel: Floats
    column: Ints
    ordered: bool = True

    @classmethod
    def from_actions(
        cls, anatomy: Anatomy, actions: Floats, *, hinges_known: bool
    ) -> "SymmetryGroup":
        """The group for an anatomy and its actions.

        Args:
            actions: (A, P) joint targets [rad].
            hinges_known: whether a mirror may not turn a part's hinge into another.
        """
        trade = _list_trades(anatomy)
        known = {a.tobytes(): k for k, a in enumerate(_round_actions(actions))}
        moved = _round_actions(actions)[:, trade]  # (A, T, P)
        found = [[known.get(row.tobytes(), -1) for row in rows] for rows in moved]
        square = np.isclose(anatomy.torso_half[0], anatomy.torso_half[1])
        square &= np.isclose(anatomy.rim[0], anatomy.rim[1])
        turns = np.array([(k, m) for m in (0, 1) for k in range(4)])
        turns = turns if square else turns[[0, 2, 4, 6]]
        kinds = np.array(anatomy.hinges, int)
        if hinges_known and (_MIRRORED_HINGE[kinds] != kinds).any():
            turns = turns[turns[:, 1] == 0]
        channels = list_channels(anatomy)
        maps = np.array([_build_channel_map(channels, k, m) for k, m in turns])
        column = _trade_columns(channels, trade)
        source = np.array(found).T.copy()
        return cls(trade, source, turns, maps, column, anatomy.ordered)

    def find_valid_trades(self, parent: Ints) -> np.ndarray:
        """(T) whether a body's parents (P) still come before children once traded."""
        if not self.ordered:
            return np.ones(len(self.trade), bool)
        label = np.hstack([np.zeros((len(self.trade), 1), np.int64), self.trade + 1])
        return np.all(label[:, parent] <= self.trade, axis=1)

    def compute_losses(
        self, parent: Ints, table: Floats, evidence: Evidence, loss: Loss
    ) -> Floats:
        """(G, T) loss of every twin of a body, infinite where impossible or unknown.

        Args:
            parent: (P) of the body.
            table: (A, C) the body's channels under every action.
        """
        from ..engine.losses import fill_twin_losses

        turned = np.ascontiguousarray(table @ self.channel.transpose(0, 2, 1))
        source = self.action[:, evidence.tried]  # (T, n)
        known = (source >= 0).all(axis=1) & self.find_valid_trades(parent)
        total = np.full((len(turned), len(known)), np.inf)
        each = np.empty((len(turned), int(known.sum())))
        some = source[known], self.column[known]
        fill_twin_losses(turned, *some, evidence.measured, loss, each)
        total[:, known] = each
        return total

    def map_tables(self, tables: Floats, turn: Ints, trade: Ints) -> Floats:
        """Channels of a twin of each body under every action.

        Args:
            tables: (N, A, C) the bodies' channels under every action.
            turn: (N) rows in `turns`.
            trade: (N) rows in `trade`.

        Returns:
            (N, A, C) channels; NaN where not known.
        """
        source = self.action[trade]  # (N, A)
        found = np.take_along_axis(tables, np.maximum(source, 0)[..., None], axis=1)
        twins = found @ self.channel[turn].transpose(0, 2, 1)
        twins = np.take_along_axis(twins, self.column[trade][:, None], axis=2)
        return np.where((source < 0)[..., None], np.nan, twins)

    def map_genomes(self, genomes: Genomes, turn: Ints, trade: Ints) -> Genomes:
        """The genomes of a twin of each body.

        Args:
            turn: (N) rows in `turns`.
            trade: (N) rows in `trade`.
        """
        return relabel_parts(self.turn_genomes(genomes, turn), self.trade[trade])

    def turn_genomes(self, genomes: Genomes, turn: Ints) -> Genomes:
        """The genomes of bodies (N) turned or mirrored, by rows (N) in `turns`."""
        quarters, mirrored = self.turns[turn].T[..., None]
        placement, hinge = genomes.placement, genomes.hinge
        placement = np.where(mirrored, 0.75 - placement, placement)
        hinge = np.where(mirrored, _MIRRORED_HINGE[hinge], hinge)
        placement = placement - 0.25 * quarters * (genomes.parent == 0)
        return Genomes(
            genomes.parent, _wrap_placement(placement), hinge, genomes.length
        )


def _wrap_placement(placement: Floats) -> Floats:
    """Placements in [0, 1), free of the rounding that would split equal bodies."""
    return np.round(placement - np.floor(placement), 12) % 1.0


def _round_actions(actions: Floats) -> Floats:
    """Actions rounded to microradians, so that equal ones compare equal."""
    return np.round(np.asarray(actions, float), 6) + 0.0


def classify_parts(anatomy: Anatomy) -> Ints:
    """(P) a number for each part, the same for parts that are alike."""
    a = anatomy
    sensors = [[f"{k}:{part}" in a.sensors for k in SENSOR_KINDS] for part in a.parts]
    sizes = a.length, a.radius, a.mass, a.block_half, a.block_mass
    turns = a.hinges or np.zeros(a.size), a.bends or np.zeros(a.size)
    kind = np.column_stack([*sizes, np.array(sensors), *turns])
    return np.unique(np.round(kind, 9), axis=0, return_inverse=True)[1].ravel()


def _list_trades(anatomy: Anatomy) -> Ints:
    """(T, P) relabelings among parts that are alike."""
    a, group = anatomy, classify_parts(anatomy)
    groups = [np.flatnonzero(group == g) for g in range(group.max() + 1)]
    base = np.arange(a.size)
    if prod(factorial(len(g)) for g in groups) > _MOST_TRADES:
        pairs = [(i, j) for g in groups for i in g for j in g if i < j]
        trades = np.tile(base, (1 + len(pairs), 1))
        for row, (i, j) in zip(trades[1:], pairs, strict=True):
            row[[i, j]] = row[[j, i]]
        return trades
    rows = []
    for orders in product(*(permutations(g) for g in groups)):
        row = base.copy()
        for g, order in zip(groups, orders, strict=True):
            row[g] = order
        rows.append(row)
    return np.array(rows)


def _build_channel_map(channels: Channels, quarters: int, mirrored: int) -> Floats:
    """(C, C) channels of a body whose torso's plan is mirrored, then turned left.

    Args:
        mirrored: 1 if left becomes right.
    """
    matrix = np.eye(len(channels))
    first = {kind.code: name for name, kind in SENSOR_KINDS.items()}
    # up = (sin fb, -sin lr) turns with the body: fb' = lr, lr' = -fb; so do x and y
    left = np.linalg.matrix_power(np.array([[0.0, -1], [1, 0]]), quarters)
    flipped = {"tilt": 0, "gravity": 1, "position": 1}  # axis that a mirror turns
    for c in np.flatnonzero(channels.axis == 0):
        name = first[int(channels.code[c])]
        if mirrored and name in flipped:
            matrix[c + flipped[name], c + flipped[name]] = -1.0
        if name in ("tilt", "position"):
            matrix[c : c + 2] = left @ matrix[c : c + 2]
    return matrix


def _trade_columns(channels: Channels, trade: Ints) -> Ints:
    """(T, C) where each channel of a twin stands among those of the body.

    Args:
        trade: (T, P) part i + 1 becomes part trade[t, i] + 1.
    """
    keys = zip(channels.code, channels.part, channels.axis, strict=True)
    place = {tuple(map(int, key)): c for c, key in enumerate(keys)}
    back = np.argsort(trade, axis=1)  # part i of the twin was part back[i]
    label = np.hstack([np.zeros((len(trade), 1), np.int64), back + 1]).tolist()
    return np.array(
        [[place[code, row[part], axis] for code, part, axis in place] for row in label]
    )

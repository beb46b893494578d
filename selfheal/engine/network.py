"""Neural controllers in batches: weights and sensor values in, joint targets out.

Sensors, a bias where the robot's network has one, four hidden neurons, a motor each
(overview.txt 4.2.2; 68 and 120 synapses, 4.3). Hidden neurons have a threshold: +1 or
-1. The values that arrive at the motors are scaled to angles: kept within [-1, 1], the
range of every neuron, times how far the joints reach.
"""

from dataclasses import dataclass

import numpy as np

from ..body.body import Floats
from ..body.legged import HIDDEN, LeggedRobot


@dataclass(frozen=True)
class Networks:
    """N controllers.

    Attributes:
        inner: (N, S + bias, HIDDEN) and
        outer: (N, HIDDEN, D) weights.
        reach: of the joints [rad].
        bias: whether the last input is always 1.
        alive: (N, HIDDEN) 0 where a hidden neuron is dead.
    """

    inner: Floats
    outer: Floats
    reach: float
    bias: bool
    alive: Floats

    def compute_targets(self, sensed: Floats) -> Floats:
        """(N, D) joint targets [rad] of sensor values (N, S) in [-1, 1]."""
        inputs = np.ones((len(sensed), sensed.shape[1] + self.bias))
        inputs[:, : sensed.shape[1]] = sensed
        arrived = np.matmul(inputs[:, None], self.inner)[:, 0]
        hidden = np.where(arrived > 0, self.alive, -self.alive)
        out = np.matmul(hidden[:, None], self.outer)[:, 0]
        return self.reach * np.clip(out, -1, 1)


def build_networks(robot: LeggedRobot, weights: Floats, alive: Floats) -> Networks:
    """Controllers of given weights.

    Args:
        weights: (N, synapses), those of the inputs first [1].
        alive: (N, HIDDEN) factor on each hidden neuron, 0 where it is dead [1].
    """
    inputs = len(robot.sensors) + robot.has_bias
    split = inputs * HIDDEN
    inner = weights[:, :split].reshape(-1, inputs, HIDDEN)
    outer = weights[:, split:].reshape(-1, HIDDEN, len(robot.motors))
    return Networks(inner, outer, robot.reach, robot.has_bias, alive)

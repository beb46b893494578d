"""The bounded fit of a torque's terms is the best one, whatever its bounds leave."""

import numpy as np

from selfheal.telemetry.balance import solve_bounded


def test_a_column_without_room_does_not_end_the_fit_early():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(400, 6))
    x[:, 1] += x[:, 0]
    y = x @ [-0.48, 1.3, 0, 0.46, -0.5, 0] + rng.normal(0, 0.01, 400)
    bounds = np.array([[-0.7, -0.02, -1e-17, -0.5, -0.5, 0], [1.5, 5, 1e-17, 1, 4, 9]])
    found = solve_bounded(x, y, bounds)
    whole = solve_bounded(np.delete(x, 2, 1), y, np.delete(bounds, 2, 1))
    np.testing.assert_allclose(np.delete(found, 2), whole, atol=1e-12)
    assert np.mean((y - x @ found) ** 2) < 2e-4

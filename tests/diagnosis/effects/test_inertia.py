"""Spatial inertias of bodies, read and written."""

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects.inertia import (
    add_mass,
    set_spatial_inertia,
    spatial_inertia,
)
from tests.support.recorded_robots import ROBOTS


@pytest.mark.parametrize("seed", range(6))
def test_a_body_given_an_inertia_has_it(seed):
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    root = rng.normal(size=(3, 3)) * 0.05
    inertia = root @ root.T + 0.1 * np.eye(3)
    set_spatial_inertia(model, 1, 1.0, np.zeros(3), inertia)
    np.testing.assert_allclose(spatial_inertia(model, 1), inertia, atol=1e-12)


def test_a_rod_that_bears_more_keeps_its_axes():
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    axes = model.body_iquat[1].copy()
    for mass in (0.0, 1e-9, 0.5):
        add_mass(model, 1, mass, np.array([0.2, 0.0, 0.0]))  # on its axis
        np.testing.assert_allclose(model.body_iquat[1], axes, atol=1e-12)
    assert model.body_mass[1] > 0.8

"""Drawings of bodies: solids, cameras, windows, cycles."""

import numpy as np
import pytest

from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.report.draw import (
    Camera,
    _build_cube,
    _build_prism,
    _compute_normals,
    look_from_behind,
    measure_window,
)
from tests.support.made_up_run import change_last_cycle, make_anatomy, make_run


@pytest.mark.parametrize(
    "solid, volume", [(_build_cube(), 8), (_build_prism(), 3 * 3**0.5 / 2)]
)
def test_a_solid_is_closed_and_faces_outward(solid, volume):
    normals = _compute_normals(solid)
    np.testing.assert_allclose(normals.sum(axis=0), 0, atol=1e-12)
    # divergence theorem: the normals are twice the faces' areas
    assert (solid[:, 0] * normals).sum() / 6 == pytest.approx(volume)


def test_a_camera_from_behind_and_above_sees_forward_as_up_and_left_as_left():
    camera = Camera(np.pi, 1.0, 2.0)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    right, up, _ = camera.project(np.eye(3)).T
    assert up[0] > 0 and abs(right[0]) < 1e-12  # forward
    assert right[1] < 0 and up[2] > 0  # left, up


def test_a_window_grows_with_the_bodies():
    anatomy = make_anatomy(5)
    genomes = draw_genomes(anatomy, 9, np.random.default_rng(3), False)
    bodies = build_bodies(anatomy, genomes)
    camera = look_from_behind(bodies)
    whole = measure_window(bodies, camera)
    single = [measure_window(bodies[k : k + 1], camera) for k in range(9)]
    np.testing.assert_allclose(np.max(single, axis=0), whole)
    assert look_from_behind(bodies).distance > 2 * whole.max()


def test_up_to_eight_cycles_are_drawn_with_the_first_and_the_last():
    from selfheal.report.figures import choose_cycles

    assert choose_cycles(1) == [0] and choose_cycles(3) == [0, 1, 2]
    for count in (8, 9, 16, 36, 500):
        shown = choose_cycles(count)
        assert len(shown) == 8 and shown[0] == 0 and shown[-1] == count - 1


def test_what_is_nearly_as_likely_as_the_best_body_is_drawn_too():
    from selfheal.report.figures import draw_best_body

    run = make_run(rivals=5)
    drawn = []
    for losses in ([0.0, 0, 0, 0, 0], [0.0, 0, 0, 99, 99], [0.0, 99, 99, 99, 99]):
        some = change_last_cycle(run, losses=np.array(losses))
        same = run.cycles[-1].genomes[np.zeros(5, int)]  # equal but for their losses
        (ax,) = draw_best_body(change_last_cycle(some, genomes=same)).axes
        drawn.append(len(ax.collections))
    # two views of the best, of the truth and of each rival
    assert drawn == [4 + 2 * 4, 4 + 2 * 2, 4]

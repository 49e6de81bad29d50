"""Distances and their gradients, the centre included."""

import numpy as np
from problems import differences

from cmpsp_ros.robot.distance import distances


def test_distances_and_gradients():
    rng = np.random.default_rng(0)
    points, centers = rng.normal(size=(7, 2)), rng.normal(size=(3, 2))
    distance, gradient = distances(points, centers)
    assert distance.shape == (7, 3)
    expected = np.linalg.norm(points[:, None] - centers, axis=2)
    np.testing.assert_allclose(distance, expected, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=2), 1.0, atol=1e-15)
    for k, point in enumerate(points):
        by_differences = differences(lambda at: distances(at[None], centers)[0][0], point)
        np.testing.assert_allclose(gradient[k], by_differences, atol=1e-8)


def test_at_the_centre_itself_there_is_a_way_out():
    distance, gradient = distances(np.array([[3.0, 4.0]]), np.array([[3.0, 4.0]]))
    assert distance[0, 0] == 0.0
    np.testing.assert_array_equal(gradient[0, 0], [1.0, 0.0])


def test_gradient_is_a_unit_vector_however_near():
    for size in (1e-12, 1e-150, 1e-300, 5e-324, 1e150):
        distance, gradient = distances(np.array([[3.0 * size, -4.0 * size]]), np.zeros((1, 2)))
        assert distance[0, 0] > 0.0
        assert np.isfinite(gradient).all()
        np.testing.assert_allclose(np.linalg.norm(gradient), 1.0, rtol=0.3)


def test_no_centres_at_all():
    distance, gradient = distances(np.zeros((4, 2)), np.empty((0, 2)))
    assert distance.shape == (4, 0)
    assert gradient.shape == (4, 0, 2)

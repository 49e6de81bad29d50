"""What the robot's centre keeps to."""

from dataclasses import replace

import numpy as np
from scenarios import CASES, FIRST, SECOND, settings

from cmpsp_ros.guidance.keep_clear import along_path, at_samples
from cmpsp_ros.guidance.settings import Safety
from cmpsp_ros.robot.between_samples import inside, outside


def test_path_keeps_radius_and_margin():
    given = settings((FIRST, SECOND), robot_radius=0.1, safety=Safety(margin=0.05))
    space = along_path(given)
    np.testing.assert_allclose(space.radii, [0.85, 0.65])
    np.testing.assert_allclose(np.ravel([space.annulus.inner, space.annulus.outer]), [9.15, 10.85])


def test_samples_keep_what_the_fastest_arcs_need():
    given = CASES['case 3']
    limits, space = given.robot.twist_limits(), at_samples(given)
    # At least: the steps beside a late odometry are longer than a period.
    assert (space.radii >= [outside(r, limits, 0.2) for r in (0.7, 0.5)]).all()
    assert space.annulus.inner >= outside(9.0, limits, 0.2)
    assert space.annulus.outer <= inside(11.0, limits, 0.2)


def test_samples_are_the_path_without_a_limit_or_by_choice():
    by_choice = replace(CASES['case 3'], safety=Safety(between_samples=False))
    for given in (CASES['case 2'], by_choice):
        path, samples = along_path(given), at_samples(given)
        np.testing.assert_array_equal(samples.radii, path.radii)
        np.testing.assert_array_equal(samples.centers, path.centers)
        for mine, its in zip(samples.annulus, path.annulus, strict=True):
            np.testing.assert_array_equal(mine, its)

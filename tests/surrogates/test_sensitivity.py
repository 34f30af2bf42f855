import numpy as np
import pytest

from drake_gait.surrogates.sensitivity import sensitivity


def test_of_a_plane_each_variable_has_the_share_of_its_squared_slope(space):
    weights = np.zeros(space.dimension)
    weights[2], weights[5] = 3.0, -4.0
    found = sensitivity(lambda x: x @ weights + 7.0, space)
    expected = np.zeros(space.dimension)
    expected[2], expected[5] = 9.0 / 25.0, 16.0 / 25.0
    np.testing.assert_allclose(found.total, expected, atol=0.03)
    np.testing.assert_allclose(found.alone, expected, atol=0.06)
    np.testing.assert_allclose(found.slope, weights, atol=1e-9)
    assert found.names == space.names


def test_a_pure_interaction_has_a_total_index_and_nothing_alone(space):
    found = sensitivity(lambda x: x[:, 0] * x[:, 1], space)
    assert found.total[:2] == pytest.approx([1.0, 1.0], abs=0.1)
    np.testing.assert_allclose(found.alone[:2], 0.0, atol=0.1)


def test_the_same_seed_gives_the_same_sensitivity(space):
    first, second = (sensitivity(lambda x: np.sin(x).sum(axis=1), space, seed=3) for _ in "ab")
    np.testing.assert_array_equal(first.total, second.total)

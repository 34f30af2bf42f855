"""The box: random points, whole numbers among real ones, and the way back inside."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_gait.optimizers._box import Box


def test_random_points_are_those_of_the_generator():
    box = Box([(-5.3, 5.0), (1e-3, 1e3)])
    expected = np.random.default_rng(3).uniform(box.lower, box.upper, (50, 2))
    # Processors that add a product without rounding it differ in the last bit.
    np.testing.assert_allclose(box.random(50, np.random.default_rng(3)), expected, rtol=1e-12)


def test_every_whole_number_of_the_bounds_is_drawn_equally_often():
    box = Box([(0.5, 4.2)], [True])  # 1, 2, 3, 4
    points = box.decode(box.random(8_000, np.random.default_rng(0)))
    values, counts = np.unique(points, return_counts=True)
    assert values.tolist() == [1.0, 2.0, 3.0, 4.0]
    np.testing.assert_allclose(counts, 2_000, rtol=0.1)


@settings(max_examples=25, deadline=None)
@given(low=st.floats(-1e3, 1e3), part=st.floats(0.0, 1.0))
def test_a_decoded_point_stays_inside_and_decodes_to_itself(low, part):
    box = Box([(low, low + 1.5), (low, low + 1.5)], [True, False])
    point = box.decode(box.lower + part * (box.upper - box.lower))
    assert point[0] == np.rint(point[0])
    assert low <= point[0] <= low + 1.5
    np.testing.assert_array_equal(box.decode(point), point)


def test_a_trial_outside_the_box_comes_half_way_from_its_parent_to_the_bound():
    box = Box([(0.0, 1.0), (-2.0, 2.0)])
    trials = np.array([[1.5, 1.0], [-9.0, 7.0], [0.25, -2.0]])
    parents = np.array([[0.5, 0.0], [0.5, 1.0], [0.5, 0.0]])
    back = box.half_way_back(trials, parents)
    assert back.tolist() == [[0.75, 1.0], [0.25, 1.5], [0.25, -2.0]]

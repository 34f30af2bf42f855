import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.visualization.rasterizer import FROM_AHEAD, FROM_THE_RIGHT, render

RED, BLUE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def box(lower, upper):
    """Twelve triangles of an upright box [m], shape (12, 3, 3), counter-clockwise from outside."""
    corner = np.array([lower, upper], dtype=float)
    x, y, z = np.eye(3, dtype=int)
    found = []
    for axis, u, v in ((x, y, z), (y, z, x), (z, x, y)):
        for side in (0, 1):
            square = [axis * side, axis * side + u, axis * side + u + v, axis * side + v]
            points = [corner[place, range(3)] for place in square]
            ring = points if side else points[::-1]
            found += [[ring[0], ring[1], ring[2]], [ring[0], ring[2], ring[3]]]
    return np.array(found)


def dominant(picture):
    """Red and blue pixels, each (rows, columns)."""
    red, _, blue, opacity = np.moveaxis(picture.pixels, 2, 0)
    return (red > 2.0 * blue) & (opacity > 0.9), (blue > 2.0 * red) & (opacity > 0.9)


def test_a_box_is_as_large_in_its_picture_as_in_the_world():
    picture = render([box((0.1, 0.0, 0.2), (0.15, 1.0, 0.22))], [RED], FROM_THE_RIGHT)
    left, right, lower, upper = picture.extent
    rows, columns, _ = picture.pixels.shape
    covered = np.argwhere(picture.pixels[..., 3] > 0.5)
    (top, first), (bottom, last) = covered.min(axis=0), covered.max(axis=0) + 1
    width, height = (right - left) / columns, (upper - lower) / rows
    np.testing.assert_allclose([left + first * width, left + last * width], [0.1, 0.15], atol=1e-3)
    np.testing.assert_allclose(
        [upper - bottom * height, upper - top * height], [0.2, 0.22], atol=1e-3
    )


@pytest.mark.parametrize("order", [1, -1], ids=["near last", "near first"])
def test_a_nearer_solid_hides_the_one_behind_it(order):
    near, far = box((0.0, -0.02, 0.0), (0.05, -0.01, 0.05)), box((0, 0, 0), (0.1, 0.01, 0.05))
    drawn = [(far, BLUE), (near, RED)][::order]
    red, blue = dominant(
        render([solid for solid, _ in drawn], [hue for _, hue in drawn], FROM_THE_RIGHT)
    )
    # Half of the blue box is seen, right of the red one.
    assert red.sum() == pytest.approx(blue.sum(), rel=0.05)
    assert np.argwhere(blue)[:, 1].min() > np.argwhere(red)[:, 1].mean()


def test_solids_that_pierce_each_other_are_cut_where_they_meet():
    # Each box is the nearer one over half of the width: sorting whole boxes could not draw it.
    angle = np.radians(30.0)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    plate = box((-0.05, -0.001, 0.0), (0.05, 0.001, 0.05))
    red, blue = dominant(render([plate @ turn.T, plate @ turn], [RED, BLUE], FROM_THE_RIGHT))
    assert red.sum() == pytest.approx(blue.sum(), rel=0.05)
    assert red.sum() > 2000


def test_empty_space_is_transparent():
    picture = render([box((0, 0, 0), (0.01, 0.01, 0.01))], [RED], FROM_AHEAD)
    assert picture.pixels[0, 0, 3] == 0.0
    assert picture.pixels[..., 3].max() == 1.0


def test_nothing_can_be_looked_at_from_straight_above():
    with pytest.raises(SettingsError, match="not vertical"):
        render([box((0, 0, 0), (1, 1, 1))], [RED], (0.0, 0.0, 1.0))

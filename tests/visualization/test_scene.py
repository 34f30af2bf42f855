import numpy as np
import pytest

from drake_gait.errors import GaitError
from drake_gait.visualization import meshcat as scene


def test_no_free_port_is_one_clear_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_port(_: object) -> None:
        raise RuntimeError("Meshcat failed to open a websocket port.\nand more")

    monkeypatch.setattr(scene, "Meshcat", no_port)
    with pytest.raises(GaitError, match=r"no free port from 7000 to 7999.*websocket port\.$"):
        scene.start_meshcat()


def test_a_port_that_is_taken_is_named_with_the_cure() -> None:
    first = scene.start_meshcat()
    with pytest.raises(GaitError, match=rf"port {first.port()} is taken; .* --port"):
        scene.start_meshcat(first.port())


def test_without_a_port_the_next_free_one_is_taken() -> None:
    first, second = scene.start_meshcat(), scene.start_meshcat()
    assert first.port() != second.port()


def test_a_path_is_drawn_as_a_tube_of_one_radius_around_its_points() -> None:
    angle = np.linspace(0.0, 6.0, 50)
    points = np.stack([np.cos(angle), np.sin(angle), 0.1 * angle], axis=1)
    vertices, faces = scene._tube(points, 0.01)
    distance = np.linalg.norm(vertices.T.reshape(50, 4, 3) - points[:, None], axis=2)
    np.testing.assert_allclose(distance, 0.01)
    assert faces.shape == (3, 8 * 49)
    assert sorted(set(faces.ravel())) == list(range(200))


def test_grid_lines_are_one_spacing_apart_and_fill_the_rectangle() -> None:
    begin, end = scene._grid(np.array([0.0, -0.2]), np.array([0.1, 0.3]), 0.1, 0.0)
    across_x, across_y = (end - begin)[:2] != 0.0
    np.testing.assert_allclose(begin[0, across_y], [0.0, 0.1])
    np.testing.assert_allclose(begin[1, across_x], [-0.2, -0.1, 0.0, 0.1, 0.2, 0.3], atol=1e-12)

import itertools
from pathlib import Path

import pytest
from matplotlib import rc_context

from drake_gait.errors import GaitError, SettingsError
from drake_gait.visualization import style as figures


def draw(path: Path) -> None:
    """A figure with a line and a text."""
    with rc_context(figures.STYLE):
        figure = figures.new_figure(2.0, 1.0)
        figure.subplots().plot([0.0, 1.0], label="line")
        figure.legend()
        figures.save_figure(figure, path)


def test_a_path_without_a_format_gives_a_picture_for_screens_and_one_for_print(
    tmp_path: Path,
) -> None:
    draw(tmp_path / "walk")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.png", "walk.svg"]


def test_the_same_data_give_the_same_file(tmp_path: Path) -> None:
    for name in ("a", "b"):
        draw(tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_a_figure_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    drawn = figures.new_figure(1.0, 1.0)
    with pytest.raises(GaitError, match=r"cannot write the figure .*nowhere"):
        figures.save_figure(drawn, tmp_path / "nowhere" / "paths.png")
    with pytest.raises(SettingsError, match="docx"):
        figures.save_figure(drawn, tmp_path / "paths.docx")


def test_right_left_and_centre_of_mass_differ_in_lightness_or_hue_for_everyone() -> None:
    # Okabe and Ito (2008) chose their colours to remain apart for all common kinds of colour
    # blindness; any other colour would have to be shown to.
    okabe_ito = {"#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7"}
    used = [figures.RIGHT, figures.LEFT, figures.COM]
    assert set(used) <= okabe_ito
    assert all(a != b for a, b in itertools.combinations(used, 2))

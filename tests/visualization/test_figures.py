import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import texts
from matplotlib import rc_context, rcParams

from drake_gait.errors import GaitError, SettingsError
from drake_gait.visualization import palette
from drake_gait.visualization import style as figures
from drake_gait.visualization import sweep as sweep_figures


def draw(path: Path) -> None:
    """A figure with a line and a text."""
    with figures.style():
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


HOME = Path(figures.__file__).parents[1]
VISIBLE = [
    path
    for folder in ("visualization", "report")
    for path in sorted((HOME / folder).rglob("*"))
    if path.suffix in (".py", ".html", ".css", ".toml") and path.name != "palette.py"
]
"""Sources of figures, recordings and pages."""


def test_a_figure_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    drawn = figures.new_figure(1.0, 1.0)
    with pytest.raises(GaitError, match=r"figure .*nowhere"):
        figures.save_figure(drawn, tmp_path / "nowhere" / "paths.png")
    with pytest.raises(SettingsError, match="docx"):
        figures.save_figure(drawn, tmp_path / "paths.docx")


def test_right_left_and_centre_of_mass_differ_in_lightness_or_hue_for_everyone() -> None:
    # Okabe and Ito (2008) chose their colours to remain apart for all common kinds of colour
    # blindness; any other colour would have to be shown to.
    okabe_ito = {"#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7"}
    used = [palette.RIGHT, palette.LEFT, palette.COM]
    assert set(used) <= okabe_ito
    assert all(a != b for a, b in itertools.combinations(used, 2))


@pytest.mark.parametrize("path", VISIBLE, ids=lambda path: path.name)
def test_every_colour_stands_in_the_palette_alone(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert re.findall(r"#[0-9a-fA-F]{3}(?:[0-9a-fA-F]{3})?\b|\brgba?\(\s*\d", text) == []


def test_a_colour_has_the_parts_that_its_digits_name() -> None:
    assert palette.rgb("#0072b2") == (0.0, 0x72 / 255.0, 0xB2 / 255.0)


ODD = """
text.usetex: True
text.latex.preamble: \\\\nonsense
font.family: serif
font.serif: No Such Font
font.size: 40
backend: pdf
figure.constrained_layout.use: True
figure.autolayout: True
image.origin: lower
savefig.bbox: tight
savefig.format: pdf
savefig.transparent: True
axes.formatter.use_locale: True
svg.fonttype: path
lines.linewidth: 9
"""

DRAWING = """
import sys, warnings
from pathlib import Path
warnings.simplefilter("error")
from drake_gait.cli._signals import begin
begin()
from drake_gait.visualization import sweep as sweep_figures
from drake_gait.visualization.style import save_picture
from drake_gait.visualization.rasterizer import Picture
import inspect, numpy
folder = Path(sys.argv[1])
sweep_figures.variants({"toes": [1.0, 2.0], "rigid": [3.0]}, folder / "variants")
sweep_figures.grid([[1.0, 2.0], [3.0, 4.0]], [["a", "b"], ["c", "d"]], ["x", "y"], folder / "grid")
pixels = numpy.linspace(0.0, 1.0, 48).reshape(4, 4, 3)
fields = {name: None for name in inspect.signature(Picture).parameters}
save_picture(Picture(**{**fields, "pixels": pixels}), folder / "picture.png")
"""


def drawn(folder: Path, **environment: str) -> dict[str, bytes]:
    """Figures that a fresh Python draws with these settings of matplotlib: names and contents."""
    folder.mkdir()
    plain = {name: text for name, text in os.environ.items() if not name.startswith("MPL")}
    command = [sys.executable, "-c", DRAWING, str(folder)]
    subprocess.run(command, check=True, env=plain | environment)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Figures that are drawn without settings of a user."""
    return drawn(tmp_path_factory.mktemp("drawn") / "plain")


@pytest.mark.parametrize(
    "backend",
    [
        "nonsense",
        *(pytest.param(one, marks=pytest.mark.slow) for one in ("module://none", "qtagg", "")),
    ],
)
def test_a_user_s_matplotlibrc_and_backend_change_no_figure(
    tmp_path: Path, plain: dict[str, bytes], backend: str
) -> None:
    (tmp_path / "matplotlibrc").write_text(ODD)
    names = ["grid.png", "grid.svg", "picture.png", "variants.png", "variants.svg"]
    assert sorted(plain) == names
    rc = str(tmp_path / "matplotlibrc")
    assert drawn(tmp_path / "odd", MATPLOTLIBRC=rc, MPLBACKEND=backend) == plain


@pytest.mark.parametrize("name", ["$x_{$", "a$b", "\\frac", "𝒱🤖", "größe & <b>", "%", "#"])
def test_any_name_can_stand_in_a_figure(tmp_path: Path, name: str) -> None:
    sweep_figures.variants({name: [1.0], "other": [2.0]}, tmp_path / "variants")
    sweep_figures.grid([[1.0]], [["1"], ["2"]], [name, "y"], tmp_path / "grid")
    assert name.replace("_", " ") in texts(tmp_path / "variants.svg")
    assert name in texts(tmp_path / "grid.svg")


def test_the_user_s_settings_are_back_after_a_figure() -> None:
    with rc_context({"font.size": 33.0, "text.usetex": True}):
        with figures.style():
            assert rcParams["font.size"] == 8.0
            assert not rcParams["text.usetex"]
        assert rcParams["font.size"] == 33.0
        assert rcParams["text.usetex"]

"""What travels in the wheel."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import drake_gait
from drake_gait.files.shipped import find

ROOT = Path(__file__).parents[1]

NAMED = sorted(
    set(re.findall(r"\bstudies/[a-z_]+(?:\.toml)?\b(?!/)", (ROOT / "README.md").read_text()))
)
"""Studies that the README names, as a command takes them."""

AWAY_FROM_THE_CHECKOUT = """
import numpy, sys
from pathlib import Path
from drake_gait import Candidate, simulate
from drake_gait.robot.description import model_path, models_folder
from drake_gait.study.reading import default_study, read_study
from drake_gait.files.shipped import find
from drake_gait.sweep.settings import read_sweep
def read_any(path):
    return (read_sweep if "[sweep]" in path.read_text() else read_study)(path)
for path in (model_path(), models_folder() / "package.xml", default_study()):
    assert Path(sys.argv[1]) in path.parents, path
for name in sys.argv[2].split():
    assert Path(sys.argv[1]) in find(Path(name)).parents, name
    if name.endswith(".toml"):
        assert read_any(find(Path(name)))
space = read_study(default_study()).space
assert simulate(space.decode(numpy.zeros(space.dimension))).frames > 0
"""


@pytest.mark.slow
def test_the_wheel_walks_away_from_the_checkout(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "build", "--wheel", "--outdir", str(tmp_path), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    assert (site / "drake_gait" / "py.typed").is_file()
    for page in ("recording_panel.html", "recording_guard.html"):
        assert (site / "drake_gait" / "visualization" / page).is_file()
    subprocess.run(
        [sys.executable, "-c", AWAY_FROM_THE_CHECKOUT, str(site), " ".join(NAMED)],
        check=True,
        cwd=site,
        env={"PYTHONPATH": str(site), "PATH": ""},
    )


def test_the_citation_is_of_this_version() -> None:
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert cited
    assert cited[1] == drake_gait.__version__


def test_the_readme_names_studies_that_there_are() -> None:
    assert {"studies/far", "studies/toes_or_rigid.toml"} <= set(NAMED)
    for name in NAMED:
        assert (ROOT / name).exists(), name


def test_a_shipped_study_is_found_from_any_folder_and_the_own_one_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in NAMED:
        assert find(Path(name)).exists()
    assert find(Path("studies/none.toml")) == Path("studies/none.toml")
    assert find(Path("studies")) == Path("studies")
    assert find(Path("best.toml")) == Path("best.toml")
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "best.toml").write_text("")
    assert find(Path("studies/best.toml")) == Path("studies/best.toml")
    assert find(Path("studies/reference.toml")).exists()

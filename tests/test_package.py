"""What travels in the wheel."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import drake_gait

ROOT = Path(__file__).parents[1]

AWAY_FROM_THE_CHECKOUT = """
import numpy, sys
from pathlib import Path
from drake_gait import Candidate, simulate
from drake_gait.simulation.plant import model_path, models_folder
from drake_gait.study.settings import default_study, read_study
for path in (model_path(), models_folder() / "package.xml", default_study()):
    assert Path(sys.argv[1]) in path.parents, path
space = read_study(default_study()).space
assert simulate(space.decode(numpy.zeros(space.dimension))).steps > 0
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
        [sys.executable, "-c", AWAY_FROM_THE_CHECKOUT, str(site)],
        check=True,
        cwd=site,
        env={"PYTHONPATH": str(site), "PATH": ""},
    )


def test_the_citation_is_of_this_version() -> None:
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert cited
    assert cited[1] == drake_gait.__version__

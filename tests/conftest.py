import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import settings as hypothesis_settings

from drake_gait.foot import FootDesign
from drake_gait.gait import Gait
from drake_gait.plan import ConfirmationSettings, SearchSettings
from drake_gait.problem import Candidate, DesignSpace
from drake_gait.records import StudyWalk
from drake_gait.settings import StudySettings
from drake_gait.walk import Outcome, Walk

# A law is no race: other processes may hold the machine while an example runs.
hypothesis_settings.register_profile("laws", deadline=None, max_examples=40)
hypothesis_settings.load_profile("laws")


def texts(svg: Path) -> list[str]:
    """Every piece of text in a drawing."""
    root = ElementTree.parse(svg).getroot()
    found = ("".join(node.itertext()).strip() for node in root.iter() if node.tag.endswith("text"))
    return [text for text in found if text]


@pytest.fixture(scope="session")
def repository() -> Path:
    return Path(__file__).parents[1]


@pytest.fixture(scope="session")
def paper_study(repository: Path) -> Path:
    return repository / "studies" / "paper.toml"


@pytest.fixture(scope="session")
def space() -> DesignSpace:
    """A box of 16 coefficients, 2 degrees to each side of a gait like the paper's."""
    return DesignSpace(
        centre=np.radians([[0, -1, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8.5, 0]]),
        half_width=np.full((4, 4), np.radians(2.0)),
    )


@pytest.fixture
def study(space: DesignSpace) -> StudySettings:
    """A small study."""
    return StudySettings(
        name="small",
        space=space,
        search=SearchSettings(samples=40, simulations=55, batch=5),
        confirmation=ConfirmationSettings(walks=0),
    )


@pytest.fixture
def walked() -> Walk:
    """A feasible walk with numbers that need all digits of a double."""
    return Walk(
        outcome=Outcome.WALKED,
        steps=240,
        forward=0.1 + 1 / 30,
        lateral=-1 / 300,
        yaw=np.pi / 97,
        com_height=0.245 + 1e-12 / 3,
    )


@pytest.fixture
def entry(walked: Walk) -> StudyWalk:
    """A walk as a study keeps it."""
    rng = np.random.default_rng(0)
    return StudyWalk(
        id=0,
        stage="infill",
        iteration=3,
        candidate=Candidate(
            gait=Gait(coefficients=rng.normal(size=(4, 4)) / 3.0),
            foot=FootDesign(big_toe_stiffness=0.1 / 3, toe_damping=1e-3 / 7),
        ),
        walk=walked,
        predicted={"forward": 1 / 7, "lateral": -1 / 9, "yaw": 1 / 11, "survival": 1 / 3},
        seconds=1 / 13,
    )


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder and output of a real study of 24 walks, by two workers."""
    folder = tmp_path_factory.mktemp("runs") / "paper"
    arguments = ["--samples", "20", "--simulations", "24", "--workers", "2", "--out", str(folder)]
    ended = subprocess.run(
        [sys.executable, "-m", "drake_gait.optimize", *arguments],
        check=False,
        capture_output=True,
        text=True,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    return folder, ended.stdout

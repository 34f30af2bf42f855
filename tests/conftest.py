import dataclasses
import signal
import socket
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import settings as hypothesis_settings

from drake_gait.execution.base import Finished
from drake_gait.foot import FootDesign
from drake_gait.gait import Gait
from drake_gait.problem import Candidate, DesignSpace
from drake_gait.search.direct import DirectCmaes, DirectIsade
from drake_gait.search.isade_network import NetworkIsade
from drake_gait.search.loop import search
from drake_gait.search.paper import PaperProcedure
from drake_gait.search.proposer import IsadeSettings
from drake_gait.search.trust_region import TrustRegion
from drake_gait.study.reading import read_study
from drake_gait.study.records import StudyWalk
from drake_gait.study.search_settings import ConfirmationSettings, Mode, SearchSettings
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.surrogates.settings import NetworkSettings
from drake_gait.walk import Measures, Outcome, Walk

# A law is no race: other processes may hold the machine while an example runs.
hypothesis_settings.register_profile("laws", deadline=None, max_examples=40)
hypothesis_settings.load_profile("laws")

# In the background of a shell, or under nohup, these would be ignored by all that the tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


DESCRIPTION = {
    "settings": {"study.seed": 0, "search.samples": 20, "walk.model": "khr3hv.sdf"},
    "model_sha256": "abc",
    "versions": {"drake": "1.51"},
}
"""What a study's file says of a study, as far as the file cares."""


def texts(svg: Path) -> list[str]:
    """Every piece of text in a drawing."""
    root = ElementTree.parse(svg).getroot()
    found = ("".join(node.itertext()).strip() for node in root.iter() if node.tag.endswith("text"))
    return [text for text in found if text]


WRITER = """
import pathlib, sys, time
from drake_gait.gait import STANDING
from drake_gait.problem import Candidate
from drake_gait.study.store import Study
from drake_gait.study.records import StudyWalk
from drake_gait.walk import Walk

study = Study.create(pathlib.Path(sys.argv[1]), {"settings": {}, "model_sha256": ""})
for number in range(100_000):
    study.add(StudyWalk(id=number, stage="design", iteration=0,
                        candidate=Candidate(gait=STANDING), walk=Walk.diverged("made up")))
    print(number, flush=True)
    time.sleep(float(sys.argv[2]))
"""
"""A driver that adds walks to the file of its first argument, a time [s] apart, and tells each."""


def free_port() -> int:
    """A port that nobody has; the first free one is for whoever comes first."""
    with socket.socket() as bound:
        bound.bind(("localhost", 0))
        return int(bound.getsockname()[1])


OWN_MOUNTS = ["unshare", "--map-root-user", "--mount"]
"""What a command begins with that is to have mounts of its own."""


def may_mount() -> bool:
    """Whether commands may have mounts of their own here."""
    try:
        return subprocess.run([*OWN_MOUNTS, "true"], check=False).returncode == 0
    except OSError:
        return False


TARGET = np.array([0.8, -0.5, 0.3, 0.4, -0.6, 0.7, -0.2, 0.1])


def walk_at(x):
    """A walk that depends smoothly on the design vector, with a region where the robot falls."""
    if x[3] + x[4] > 1.2:
        return Walk(
            outcome=Outcome.FELL, frames=120, forward=0.05, lateral=0.03, yaw=0.5, com_height=0.1
        )
    return Walk(
        outcome=Outcome.WALKED,
        frames=240,
        forward=float(0.15 - 0.01 * ((x[:8] - TARGET) ** 2).sum()),
        lateral=float(0.03 * x[8] + 0.01 * x[9] * x[10]),
        yaw=float(0.15 * np.sin(x[11])),
        com_height=float(0.2445 + 0.002 * x[12]),
    )


def fall_at(x):
    return Walk(
        outcome=Outcome.FELL,
        frames=int(100 + 20 * x[0]),
        forward=0.0,
        lateral=0.0,
        yaw=0.0,
        com_height=0.1,
    )


class Interruption(BaseException):
    """What stops a driver in the midst of its work."""


class Ground:
    """Computes walks, and remembers what it was asked for, in the order of finishing."""

    def __init__(self, space, walk=walk_at, *, shuffle=None, stop_after=None):
        self.space, self.walk = space, walk
        self.rng = None if shuffle is None else np.random.default_rng(shuffle)
        self.stop_after = stop_after
        self.asked = []
        self.trials = []

    def __call__(self, trials):
        order = np.arange(len(trials))
        if self.rng is not None:
            order = self.rng.permutation(order)
        for index in order.tolist():
            if len(self.asked) == self.stop_after:
                raise Interruption
            x = self.space.encode(trials[index].candidate)
            self.asked.append(x)
            self.trials.append(trials[index])
            yield Finished(index=index, walk=self.walk(x), seconds=0.0)


def planned(settings, **plan):
    return dataclasses.replace(settings, search=SearchSettings(**plan))


QUICK_NETWORK, QUICK_ISADE = NetworkSettings(epochs=20), IsadeSettings(iterations=8)
"""Networks that learn little and short runs of ISADE: the laws of a search hold for any."""


def quick_proposer(settings, network=QUICK_NETWORK, isade=QUICK_ISADE):
    """The proposer of a study's mode, which learns little in a short time."""
    quick = {"isade": isade, "network": network}
    if settings.search.mode is Mode.DEFAULT:
        return TrustRegion(settings, **quick)
    if settings.search.mode is Mode.ISADE_NETWORK:
        return NetworkIsade(settings, network=network)
    if settings.search.mode is Mode.PAPER:
        return PaperProcedure(settings, **quick)
    return (DirectIsade if settings.search.mode is Mode.ISADE else DirectCmaes)(settings)


def run(settings, path, ground=None, report=lambda progress: None, proposer=None):
    """Start or go on with a study that learns little in a short time; its walks."""
    ground = ground or Ground(settings.space)
    opened = Study.open(path, driver=True) if path.exists() else Study.create(path, {})
    with opened as study:
        proposer = proposer or quick_proposer(settings)
        search(settings, study, ground, report, proposer=proposer)
        return study.walks()


def numbers(walks):
    """All that a study says of its walks."""
    return [
        (
            walk.id,
            walk.stage,
            walk.iteration,
            walk.candidate.gait.coefficients.tobytes(),
            dataclasses.astuple(walk.candidate.foot),
            dataclasses.astuple(dataclasses.replace(walk.walk, values={})),
            walk.predicted,
        )
        for walk in walks
    ]


EVERY_KEY = """
[study]
name = "every-key"
question = "What if?"
seed = 7
[search]
samples = 30
simulations = 90
batch = 6
stagnation = 4
[box]
chosen = "by hand"
centre_deg = [[0, -1, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8.5, 0]]
half_width_deg = [[1, 1, 1, 1], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]
[constraints]
lateral_mm = 15
yaw_deg = 4.0
com_height_mm = 240.0
[gait]
start = "paper"
[walk]
model = "khr3hv_cad.sdf"
sole = "points"
fidelity = "reference"
step_ms = 2.5
time_limit_s = 30
[servo]
stiffness_n_m_per_rad = 12.0
damping_n_m_s_per_rad = 0.15
no_load_speed_rad_per_s = 7.0
[foot]
big_toe_stiffness_n_mm_per_deg = 1.0
lesser_toes_stiffness_n_mm_per_deg = 0.5
toe_damping_n_m_s_per_rad = 3e-4
big_toe_width_mm = 25
toe_length_mm = 20
[design]
big_toe_stiffness_n_mm_per_deg = [0.1, 2]
toe_damping_n_m_s_per_rad = [1e-4, 1e-3]
big_toe_width_mm = [10, 40]
"""
"""A study file with every setting that there is."""

MINIMAL = """
[study]
name = "minimal"
[box]
centre_deg = [[0, -1, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8.5, 0]]
half_width_deg = [[1, 1, 1, 1], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]
"""


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


@pytest.fixture(scope="session")
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
        frames=240,
        forward=0.1 + 1 / 30,
        lateral=-1 / 300,
        yaw=np.pi / 97,
        com_height=0.245 + 1e-12 / 3,
    )


@pytest.fixture
def measures() -> Measures:
    """Measures of a walk, no two alike."""
    return Measures(
        energy=7.0 / 3.0,
        positive_energy=5.0 / 3.0,
        cost_of_transport=1.0 / 0.7,
        peak_torque=0.9,
        peak_speed=6.1,
        saturated_fraction=0.011,
        slip=(0.003, 0.004),
        clearance=(0.012, 0.009),
        duty_factor=(0.61, 0.63),
        peak_ground_reaction=1.9,
        toe_range=(0.21, 0.11, 0.23, 0.13),
        torso_tilt=0.15,
        driving_torque=0.8,
        braking_torque=0.91,
        driving_speed=5.9,
        braking_speed=6.11,
        line_share=0.97,
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


@pytest.fixture
def closed(path, entry):
    """Path of a study of 200 walks that no process has open."""
    with Study.create(path, DESCRIPTION) as study:
        for number in range(200):
            study.add(dataclasses.replace(entry, id=number))
    return path


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory, paper_study: Path) -> tuple[Path, str]:
    """Folder and output of a real study of 24 walks, by two workers."""
    folder = tmp_path_factory.mktemp("runs") / "paper"
    options = ("--samples", "20", "--simulations", "24", "--workers", "2")
    arguments = [str(paper_study), *options, "--out", str(folder)]
    ended = subprocess.run(
        [sys.executable, "-m", "drake_gait.optimize", *arguments],
        check=False,
        capture_output=True,
        text=True,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    return folder, ended.stdout


@pytest.fixture
def path(tmp_path):
    return tmp_path / "study.db"


@pytest.fixture
def read(tmp_path):
    """Reads a study from its text."""

    def read_text(text, overrides=None):
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return read_study(path, overrides)

    return read_text

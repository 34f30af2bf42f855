"""Gait families in a study: its file, its box by names, its walks, its report."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from drake_gait import Finished, Harmonics, Study, StudyResult, run_study, write_report
from drake_gait.cli.export import main as export
from drake_gait.cli.optimize import main as optimize
from drake_gait.errors import SettingsError, StudyError
from drake_gait.gait import PAPER, Gait, PaperFamily
from drake_gait.problem import DesignSpace
from drake_gait.report import tables
from drake_gait.report.page import Run, write_study_page
from drake_gait.study.reading import read_study
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.study.settings import study_settings
from drake_gait.study.toml import study_toml
from drake_gait.walk import Outcome, Walk

OWN = """
from dataclasses import dataclass
import numpy as np
from drake_gait import GaitFamily, Variable
from drake_gait.gait import setting
from drake_gait.ranges import MS

@dataclass(frozen=True, kw_only=True)
class Bow(GaitFamily):
    late: float = setting(0.1, MS, lower=0.0, upper=1.0)
    variables = (Variable("depth", lower=0.0, upper=1.0), Variable("order", lower=0.0, upper=1.0))

    def commands(self, x):
        angles = np.zeros((len(self.times(x)), 10))
        angles[:, 1] = x[0]
        return angles
"""

BOW = """
[study]
name = "bow"
[gait]
family = "mine.py:Bow"
period_s = 1.0
cycles = 2
late_ms = 50
[box.centre]
depth_deg = 20
order_deg = 10
[box.half_width]
depth_deg = 5
"""

SERIES = """
[study]
name = "series"
[gait]
family = "harmonics"
walking_s = 2.4
[box.centre]
roll_mean_deg = 0.5
roll_cos1_deg = 1
roll_sin1_deg = 5
hip_mean_deg = 12
hip_cos1_deg = -20
hip_sin1_deg = 10
knee_mean_deg = 20
knee_cos1_deg = -3
knee_sin1_deg = 15
ankle_mean_deg = 9
ankle_cos1_deg = 15
ankle_sin1_deg = 6
[box.half_width]
roll_mean_deg = 0.5
hip_cos1_deg = 2
knee_sin2_deg = 0.5
period_s = 0.05
"""


@pytest.fixture
def bow(tmp_path):
    (tmp_path / "mine.py").write_text(OWN)
    (tmp_path / "bow.toml").write_text(BOW)
    return tmp_path / "bow.toml"


class Made:
    """An executor that makes walks up from the first open variable."""

    deaths: dict[str, int]

    def __init__(self, space):
        self.space, self.deaths = space, {}

    def run(self, trials):
        for index, trial in enumerate(trials):
            x = self.space.encode(trial.candidate)
            planned = trial.candidate.gait.frames
            fell = x[-1] > 0.8
            walk = Walk(
                outcome=Outcome.FELL if fell else Outcome.WALKED,
                frames=planned - 30 if fell else planned,
                forward=float(0.3 + 0.05 * x[0]),
                lateral=0.001,
                yaw=0.01,
                com_height=0.245,
                yaw_swing=0.1,
            )
            yield Finished(index=index, walk=walk, seconds=0.0)


def small(settings, walks=8):
    return dataclasses.replace(
        settings,
        search=SearchSettings(samples=walks, simulations=walks, grounds=False),
        confirmation=ConfirmationSettings(walks=0),
    )


def searched(settings, folder):
    return run_study(small(settings), folder, executor=Made(settings.space))


def test_a_box_by_names_opens_what_has_a_half_width(read):
    space = read(SERIES).space
    assert space.names == ("roll_mean", "hip_cos1", "knee_sin2", "period")
    x = np.array([1.0, -1.0, 0.5, 1.0])
    gait = space.decode(x).gait
    named = space.family.named(gait.variables)
    assert named["roll_mean"] == pytest.approx(np.radians(1.0))
    assert named["hip_cos1"] == pytest.approx(np.radians(-22.0))
    assert named["knee_sin2"] == pytest.approx(np.radians(0.25))
    assert named["period"] == pytest.approx(1.25)
    assert (named["ankle_cos2"], named["duty"]) == (0.0, 0.5)
    assert space.encode(space.decode(x)) == pytest.approx(x)
    assert gait.frames == 180
    assert space.limits[3] == pytest.approx([-18.0, 176.0])


def test_a_description_and_a_file_written_again_are_the_same_settings(read, tmp_path, bow):
    for settings in (read(SERIES), read_study(bow)):
        again = study_settings(json.loads(json.dumps(settings.description())))
        assert again.description() == settings.description()
        path = tmp_path / "again.toml"
        path.write_text(study_toml(settings))
        assert read_study(path).description() == settings.description()


def test_the_paper_s_period_is_a_setting_and_its_default_no_constant(read):
    box = SERIES.partition("[gait]")[0] + (
        "[box]\ncentre_deg = [[0, 0, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8, 0]]\n"
        f"half_width_deg = {np.ones((4, 4)).tolist()}\n"
    )
    assert read(box).space.family == PAPER
    settings = read(f"{box}[gait]\nperiod_s = 1.6\ncycles = 2\nstanding_s = 0.8\nstart = 'shift'\n")
    assert settings.space.family == PaperFamily(period=1.6, cycles=2, standing=0.8)
    assert settings.space.middle.gait.frames == 200
    assert settings.walk.start == "shift"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"harmonics"', '"waltz"', "no gait family is called 'waltz'; there are paper, harmonics"),
        ('"harmonics"', "3", "gait.family must be text, got 3"),
        ('"harmonics"', '"mine.py:Bow"', "no file of a gait family .*mine.py"),
        ('"harmonics"', '"paper"', r"gait.*'walking_s'; the nearest"),
        ("walking_s = 2.4", "start = 'ramp'", "called 'start'"),
        ("walking_s = 2.4", "walking_s = -1", "gait.walking_s must be 0 to 60 s, got -1"),
        ("walking_s = 2.4", "walking_s = nan", "gait.walking_s must be a finite number, got nan"),
        ("walking_s = 2.4", "cycles = 2.5", "cycles .* must be a whole number, got 2.5"),
        ("walking_s = 2.4", "walking_s = [1, 2]", "walking .* must be a number"),
        ("hip_mean_deg = 12", "hip_meen_deg = 12", r"'hip_meen_deg'; .* is 'hip_mean_deg'"),
        ("hip_mean_deg = 12", "", r"\[box.centre\] needs hip_mean_deg of the gait family"),
        (
            "hip_mean_deg = 12",
            "hip_mean_deg = 51",
            r"box\.centre\.hip_mean_deg must be -50 to 50 degrees, got 51",
        ),
        ("hip_mean_deg = 12", "hip_mean_deg = inf", r"box\.centre\.hip_mean_deg must be a finite"),
        (
            "hip_cos1_deg = 2\n",
            "hip_cos1_deg = -2\n",
            r"box\.half_width\.hip_cos1_deg must be .*0.* got -2",
        ),
        ("period_s = 0.05", "period_s = 'x'", r"box\.half_width\.period_s must be a finite .*'x'"),
        (
            "[box.centre]\n",
            "[box]\ncentre_deg = 3\n[box.centre]\n",
            r"\[box.half_width\], got box.centre_deg",
        ),
    ],
)
def test_what_no_study_can_use_is_one_line_that_names_it(read, old, new, told):
    assert old in SERIES
    with pytest.raises(SettingsError, match=told) as caught:
        read(SERIES.replace(old, new))
    assert "\n" not in str(caught.value)


def test_a_setting_is_a_variable_s_centre_where_the_box_names_none(read):
    setting = SERIES.replace("[box.centre]", "period_s = 1\n[box.centre]")
    both = setting.replace("[box.centre]", "[box.centre]\nperiod_s = 1.1")
    periods = [read(text).space.centre[-1] for text in (SERIES, setting, both)]
    assert periods == [1.2, 1.0, 1.1]


def test_a_box_that_opens_nothing_or_is_of_another_family_is_refused(read):
    with pytest.raises(SettingsError, match="opens no variable"):
        read(SERIES.partition("[box.half_width]")[0])
    with pytest.raises(SettingsError, match="has a box of centre_deg and half_width_deg, got box"):
        read(SERIES.replace('family = "harmonics"\nwalking_s = 2.4', 'family = "paper"'))


def test_a_variable_is_set_from_the_shell_by_its_name(read):
    override = {("box", "half_width.duty"): 0.1, ("box", "centre.hip_mean_deg"): 11}
    space = read(SERIES, override).space
    assert "duty" in space.names
    assert space.family.named(space.centre)["hip_mean"] == pytest.approx(np.radians(11))


def test_a_column_s_name_is_no_variable_s(bow):
    (bow.parent / "mine.py").write_text(OWN.replace('"order"', '"stage"'))
    text = bow.read_text().replace("order_deg", "stage_deg")
    bow.write_text(text)
    with pytest.raises(SettingsError, match=r"variable stage .* needs another name"):
        read_study(bow)


def test_a_study_of_another_family_keeps_its_walks_and_its_result(read, tmp_path):
    settings = read(SERIES)
    result = searched(settings, tmp_path / "run")
    again = searched(settings, tmp_path / "run")
    assert again.best.candidate == result.best.candidate
    with Study.open(tmp_path / "run") as study:
        assert study.settings().description() == small(settings).description()
        walks, table = study.walks(), study.table()
    assert {walk.walk.planned for walk in walks} == {180}
    assert table["period"].tolist() == [walk.candidate.gait.variables[-1] for walk in walks]
    assert table["knee_sin2"].std() > 0.0
    assert not table["hip_mean"].std()
    read_again = StudyResult.read(tmp_path / "run")
    assert read_again.best.candidate.gait == result.best.candidate.gait
    content = json.loads((tmp_path / "run" / "result.json").read_text())
    assert content["coefficients_deg"] is None
    assert content["best"]["candidate"]["family"]["family"] == "harmonics"


def test_tables_and_an_export_name_the_variables(read, tmp_path, capsys):
    settings = read(SERIES)
    searched(settings, tmp_path / "run")
    content = json.loads((tmp_path / "run" / "result.json").read_text())
    rows = dict(row[:2] for row in tables.gait(content, settings.space.family).rows)
    assert rows["hip mean"] == "12"
    run = Run(folder=tmp_path / "run", settings=small(settings), result=content, walks=[])
    write_study_page(run, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "knee sin2" in page
    assert "mm in 3.6 s" in page
    assert "all 180" in page
    assert export([str(tmp_path / "run"), "--csv", str(tmp_path / "walks.csv")]) in (None, 0)
    assert "knee_sin2" in (tmp_path / "walks.csv").read_text().partition("\n")[0]


def test_failures_are_counted_by_the_gait_s_own_cycle(read, tmp_path):
    settings = read(SERIES)
    searched(settings, tmp_path / "run")
    with Study.open(tmp_path / "run") as study:
        walks = study.walks()
    assert any(row[0].startswith("fell in gait cycle ") for row in tables.failures(walks).rows)


def test_a_new_study_begins_at_a_winner_of_its_family_or_of_the_paper_s(read, tmp_path, study):
    settings = read(SERIES)
    found = searched(settings, tmp_path / "run")
    paper = run_study(small(study), tmp_path / "paper", executor=Made(study.space))
    corner = SERIES.partition("[box.half_width]")[2]
    text = '[study]\nname="next"\n[gait]\nfamily="harmonics"\n[box]\ncentre_from="{}"\n'
    for folder, candidate in (("run", found.best.candidate), ("paper", paper.best.candidate)):
        space = read(f"{text.format(tmp_path / folder)}[box.half_width]{corner}").space
        wanted = Harmonics().like(candidate.gait) if isinstance(candidate.gait, Gait) else None
        values = space.family.named(space.centre)
        wanted = wanted or candidate.gait.family.named(candidate.gait.variables)
        assert {name: values[name] for name in wanted} == pytest.approx(wanted)
    own = read(
        f"{text.format(tmp_path / 'run')}[box.centre]\nperiod_s = 1.3\n[box.half_width]{corner}"
    ).space
    assert own.family.named(own.centre)["period"] == 1.3


def test_a_paper_s_study_does_not_begin_at_another_family_s_winner(read, tmp_path):
    searched(read(SERIES), tmp_path / "run")
    box = f'[box]\ncentre_from = "{tmp_path / "run"}"\nhalf_width_deg = {np.ones((4, 4)).tolist()}'
    with pytest.raises(SettingsError, match="gait family harmonics, and the study's is paper"):
        read(f'[study]\nname = "next"\n{box}\n')


def test_a_family_of_a_user_s_own_is_found_where_its_file_is(bow, tmp_path):
    settings = read_study(bow)
    assert settings.space.family.late == pytest.approx(0.05)
    searched(settings, tmp_path / "run")
    with Study.open(tmp_path / "run") as study:
        assert study.settings().space.family == settings.space.family
    # A study that has moved brings the file along.
    (tmp_path / "mine.py").rename(tmp_path / "run" / "mine.py")
    with Study.open(tmp_path / "run") as study:
        assert study.walks()[0].candidate.gait.family.label == "Bow"
    (tmp_path / "run" / "mine.py").unlink()
    with Study.open(tmp_path / "run") as study:
        with pytest.raises(StudyError, match=r"needs its gait family: no file .*mine\.py"):
            study.walks()
        assert study.table()["depth"].shape == (8,)


def test_a_study_goes_on_with_the_commands_that_it_began_with(bow, tmp_path):
    searched(read_study(bow), tmp_path / "run")
    (bow.parent / "mine.py").write_text(OWN + "# A comment changes nothing.\n")
    searched(read_study(bow), tmp_path / "run")
    (bow.parent / "mine.py").write_text(OWN.replace("= x[0]", "= x[0] / 2"))
    with pytest.raises(StudyError, match="another version of its gait family"):
        searched(read_study(bow), tmp_path / "run")


@pytest.mark.parametrize(
    ("file", "told"),
    [
        ("class Bow: pass", "declares no gait family"),
        (OWN.replace("class Bow(", "class Curtsey("), "no gait family 'Bow'; there are Curtsey"),
        ("import nothing_of_this_name", "cannot be run: ModuleNotFoundError"),
        (OWN.replace("= x[0]", "= np.nan"), "commands of the gait family Bow.*is nan rad"),
        (OWN.replace("return angles", "return angles[1:]"), "must have 161 rows.* got 160"),
        (OWN.replace("return angles", "raise KeyError(3)"), "cannot be computed: KeyError: 3"),
        (OWN.replace("return angles", "return angles + 3"), "a servo turns 2.356 rad"),
    ],
)
def test_a_bad_family_ends_a_command_with_one_line(bow, tmp_path, capsys, file, told):
    (bow.parent / "mine.py").write_text(file)
    assert optimize([str(bow), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert error.startswith("error: ")
    assert told.partition(".*")[0] in error
    assert not (tmp_path / "run" / "study.db").exists()


def test_a_box_in_python_is_given_by_names():
    names = {name: 0.1 for name in Harmonics().names if name.endswith(("mean", "cos1", "sin1"))}
    space = DesignSpace(family=Harmonics(), centre=names, half_width={"duty": 0.05})
    assert space.names == ("duty",)
    with pytest.raises(SettingsError, match="half_width has no variable 'hop'"):
        DesignSpace(family=Harmonics(), centre=names, half_width={"hop": 0.05})
    with pytest.raises(SettingsError, match="centre must be a finite number for each of the 22"):
        DesignSpace(family=Harmonics(), centre=[0.0], half_width={"duty": 0.05})


@pytest.mark.slow
def test_a_family_of_a_file_walks_in_workers_and_has_a_report(bow, tmp_path):
    options = ["--samples", "4", "--simulations", "4", "--workers", "2"]
    still = ["--set", "box.centre.depth_deg=2", "--set", "confirmation.walks=0"]
    still += ["--set", "box.half_width.depth_deg=1", "--set", "search.grounds=false"]
    command = [sys.executable, "-m", "drake_gait", "optimize", str(bow), *options, *still]
    ended = subprocess.run(
        [*command, "--out", str(tmp_path / "run")], check=False, capture_output=True, text=True
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    result = write_report(tmp_path / "run")
    assert result.best.walk.planned == 160
    assert (tmp_path / "run" / "walk.html").is_file()


def test_the_shipped_study_is_the_default_one_s_box(repository):
    default = read_study(repository / "studies" / "steady.toml")
    general = read_study(repository / "studies" / "harmonics.toml")
    family = general.space.family
    centre = family.named(general.space.centre)
    like = Harmonics().like(default.space.middle.gait)
    assert {name: centre[name] for name in like} == pytest.approx(like)
    assert general.constraints.plain() == default.constraints.plain()
    assert general.space.middle.gait.frames == default.space.middle.gait.frames
    assert {"duty", "period", "hip_sin2"} <= set(general.space.names)

"""A study that begins at the winner of an earlier one, and goes on whatever becomes of that."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
from conftest import MINIMAL

from drake_gait.cli.optimize import parse
from drake_gait.errors import SettingsError, StudyError
from drake_gait.files.strict_json import to_json
from drake_gait.foot import FootDesign
from drake_gait.gait import ANGLE_LIMITS, Gait
from drake_gait.optimization import is_finished, open_study
from drake_gait.problem import Candidate
from drake_gait.report.result import summary
from drake_gait.study.reading import read_study
from drake_gait.study.records import StudyWalk
from drake_gait.study.store import Study
from drake_gait.study.toml import study_toml
from drake_gait.sweep.settings import read_sweep

FOOT = FootDesign(big_toe_stiffness=0.0123456789, toe_length=0.0234567891, big_toe_width=0.03)
GAIT = np.radians([[0.1, 1, 2.7, 0], [12.3, -9, 8, 0.5], [20, -1.5, 12.1, 0], [9, 6, 5, 1.0000001]])


@pytest.fixture
def earlier(study, walked, tmp_path):
    """Writes a finished study whose best walk is this gait on this foot."""

    def write(gait=GAIT, foot=FOOT, *, folder="first", only=("study.db", "result.json")):
        place = tmp_path / folder
        shutil.rmtree(place, ignore_errors=True)
        walk = StudyWalk(
            id=0,
            stage="design",
            iteration=0,
            walk=walked,
            candidate=Candidate(gait=Gait(coefficients=gait), foot=foot),
        )
        description = {"settings": study.description(), "model_sha256": "", "versions": {}}
        with Study.create(place / "study.db", description) as opened:
            opened.add(walk)
        (place / "result.json").write_text(to_json(summary(study, [walk], None, wall_s=0.0)))
        for name in {"study.db", "result.json"} - set(only):
            (place / name).unlink()
        return place

    return write


def second(tmp_path, source, more="", begun=None):
    """Reads a study in a folder of its own that begins at another one."""
    path = tmp_path / "second.toml"
    lines = [line for line in MINIMAL.splitlines() if not line.startswith("centre_deg")]
    text = "\n".join(lines).replace("[box]", f'[box]\ncentre_from = "{source}"')
    path.write_text(f"{text}\n{more}")
    return read_study(path, begun=None if begun is None else lambda name: begun)


@pytest.mark.parametrize("only", [("study.db", "result.json"), ("study.db",), ("result.json",)])
@pytest.mark.parametrize("name", ["first", "first/study.db", "first/result.json"])
def test_a_folder_does_as_well_as_either_of_its_files(earlier, tmp_path, name, only):
    earlier(only=only)
    if "/" in name and name.removeprefix("first/") not in only:
        with pytest.raises(SettingsError, match=r"box\.centre_from: cannot read .*first"):
            second(tmp_path, name)
        return
    settings = second(tmp_path, name)
    assert settings.space.centre == pytest.approx(GAIT, abs=1e-12)
    assert dataclasses.astuple(settings.space.foot) == pytest.approx(dataclasses.astuple(FOOT))


def test_file_and_folder_give_the_same_study_to_the_last_digit(earlier, tmp_path):
    earlier()
    names = ("first", "first/study.db", "first/result.json", str(tmp_path / "first"))
    described = [second(tmp_path, name).description() for name in names]
    assert all(one == described[0] for one in described)


def test_a_study_written_again_has_gait_and_foot_of_the_earlier_one(earlier, tmp_path):
    earlier()
    settings = second(tmp_path, "first")
    path = tmp_path / "again.toml"
    path.write_text(study_toml(settings))
    shutil.rmtree(tmp_path / "first")
    assert read_study(path).description() == settings.description()


def test_the_foot_comes_along_and_is_told(earlier, tmp_path):
    earlier()
    (note,) = second(tmp_path, "first").notes
    assert "comes along" in note
    assert "big_toe_width_mm = 30" in note
    assert "lesser_toes" not in note  # As every study has it.


def test_what_the_file_says_of_its_foot_counts_and_the_loss_is_told(earlier, tmp_path):
    earlier()
    settings = second(tmp_path, "first", "[foot]\nbig_toe_width_mm = 25.5\n")
    assert settings.space.foot.big_toe_width == pytest.approx(0.0255)
    assert settings.space.foot.toe_length == pytest.approx(FOOT.toe_length)
    (note,) = settings.notes
    assert "had big_toe_width_mm = 30, not 25.5" in note


def test_rigid_toes_come_along_unless_they_are_said_to_bend(earlier, tmp_path):
    earlier(foot=FootDesign(rigid_toes=True))
    assert second(tmp_path, "first").space.foot.rigid_toes
    settings = second(tmp_path, "first", "[foot]\nrigid_toes = false\n")
    assert not settings.space.foot.rigid_toes
    assert "rigid_toes = true, not false" in settings.notes[0]


def test_a_result_without_a_foot_is_told_so(tmp_path):
    (tmp_path / "old.json").write_text(json.dumps({"coefficients_deg": np.degrees(GAIT).tolist()}))
    settings = second(tmp_path, "old.json")
    assert settings.space.foot == FootDesign()
    assert "no foot" in settings.notes[0]


def test_a_foot_as_every_study_has_it_needs_no_words(earlier, tmp_path):
    earlier(foot=FootDesign())
    assert second(tmp_path, "first").notes == ()


@pytest.mark.parametrize("end", [0, 1])
def test_a_winner_at_the_very_end_of_table_i_is_a_centre(earlier, tmp_path, end):
    gait = GAIT.copy()
    gait[:, 0] = ANGLE_LIMITS[:, end]
    earlier(gait=np.nextafter(gait, 100.0 if end else -100.0))
    for name in ("first", "first/result.json"):
        assert second(tmp_path, name).space.centre[:, 0] == pytest.approx(gait[:, 0], abs=1e-12)


def test_a_winner_beyond_table_i_is_told_with_all_its_digits(tmp_path):
    rows = np.degrees(GAIT)
    rows[2, 0] = 60.00001
    (tmp_path / "old.json").write_text(json.dumps({"coefficients_deg": rows.tolist()}))
    with pytest.raises(SettingsError, match=r"knee_a .* 0 to 60 degrees, got 60\.00001"):
        second(tmp_path, "old.json")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "no result.json of a study"),
        (b"[1, 2]", "no result.json of a study"),
        (b'{"coefficients_deg": null}', "no walk yet"),
        (b'{"coefficients_deg": [[1]], "foot": {"toe_length": 7}}', "foot that cannot be used"),
        (b'{"coefficients_deg": [[1]], "foot": {"heel": 7}}', "no result.json of a study"),
        (b'{"coefficients_deg": [["a"]]}', "4 rows of 4 numbers"),
        (b"SQLite format 3\0 and no more", "is no study, or is damaged"),
        (b"[study]\nname = 'x'", "no result.json of a study"),
    ],
)
def test_what_is_no_earlier_study_is_one_line_with_its_path(tmp_path, content, told):
    (tmp_path / "thing").write_bytes(content)
    with pytest.raises(SettingsError) as caught:
        second(tmp_path, "thing")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_study_without_walks_is_told_so(earlier, tmp_path, study):
    Study.create(
        tmp_path / "empty" / "study.db", {"settings": study.description(), "model_sha256": ""}
    ).close()
    with pytest.raises(SettingsError, match=r"empty/study\.db has no walk yet"):
        second(tmp_path, "empty")


def begin(tmp_path, **options):
    """Begin the second study."""
    folder = tmp_path / "run"
    settings = second(tmp_path, "first", begun=folder, **options)
    open_study(settings, folder).close()
    return folder, settings


def other():
    gait = GAIT.copy()
    gait[1, 1] += 0.01
    return gait


@pytest.mark.parametrize("change", ["walks", "foot", "deleted", "broken", "empty"])
def test_a_study_goes_on_when_the_earlier_one_has_changed_and_says_so(earlier, tmp_path, change):
    earlier()
    folder, before = begin(tmp_path)
    if change == "walks":
        earlier(gait=other())
    elif change == "foot":
        earlier(foot=FootDesign())
    else:
        shutil.rmtree(tmp_path / "first")
    if change in ("broken", "empty"):
        (tmp_path / "first").mkdir()
        (tmp_path / "first" / "result.json").write_text("{" if change == "broken" else "{}")
    settings = second(tmp_path, "first", begun=folder)
    assert settings.description() == before.description()
    open_study(settings, folder).close()
    assert not is_finished(settings, folder)
    told = [note for note in settings.notes if "goes on around what it began with" in note]
    assert len(told) == 1
    assert "first" in told[0]
    assert str(folder) in told[0]


def test_a_study_whose_earlier_one_has_not_changed_says_nothing_of_it(earlier, tmp_path):
    earlier()
    folder, before = begin(tmp_path)
    settings = second(tmp_path, "first", begun=folder)
    assert settings.notes == before.notes
    assert settings.description() == before.description()


def test_another_earlier_study_is_refused_with_what_differs(earlier, tmp_path):
    earlier()
    folder, _ = begin(tmp_path)
    earlier(gait=other(), folder="another")
    settings = second(tmp_path, "another", begun=folder)
    with pytest.raises(StudyError, match=r"hip_b of box\.centre_deg = -9, not -8\.427\d+; "):
        open_study(settings, folder)


def test_a_foot_that_is_written_since_is_refused_with_what_differs(earlier, tmp_path):
    earlier()
    folder, _ = begin(tmp_path)
    earlier(gait=other())
    settings = second(tmp_path, "first", "[foot]\ntoe_length_mm = 20\n", begun=folder)
    with pytest.raises(StudyError, match=r"foot\.toe_length_mm = 23\.4568, not 20"):
        open_study(settings, folder)


def test_the_command_line_goes_on_too(earlier, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first = earlier()
    (tmp_path / "study.toml").write_text(MINIMAL)
    words = ["study.toml", "--set", "box.centre_from=first", "--out", "run"]
    options = parse(words)
    before = options.settings()
    open_study(before, options.out).close()
    shutil.rmtree(first)
    assert parse(words).settings().description() == before.description()
    monkeypatch.chdir(tmp_path / "run")  # Named from elsewhere, it is the same.
    words[-1], words[0], words[2] = ".", "../study.toml", "box.centre_from=../first"
    assert parse(words).settings().description() == before.description()


def test_a_centre_on_the_command_line_takes_the_place_of_an_earlier_study(tmp_path):
    rows = np.full((4, 4), 1.5)
    path = tmp_path / "second.toml"
    path.write_text(MINIMAL.replace("centre_deg = ", "centre_from = 'gone'  # "))
    settings = read_study(path, {("box", "centre_deg"): rows.tolist()})
    assert np.degrees(settings.space.centre) == pytest.approx(rows)


SWEEP = """
[sweep]
name = "around"
base = "studies/base.toml"
seeds = [0, 4]
[common]
box.centre_from = "first"
[variants.a]
[variants.b]
box.centre_from = "second/result.json"
"""


def test_in_a_sweep_the_earlier_study_is_beside_the_sweep_s_file(earlier, tmp_path, monkeypatch):
    first, later = earlier(), earlier(gait=other(), folder="second")
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "base.toml").write_text(MINIMAL)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    out = tmp_path / "out"
    sweep = read_sweep(tmp_path / "sweep.toml", out)
    hips = {one.variant: one.settings.space.centre[1, 1] for one in sweep.studies}
    assert hips == {"a": pytest.approx(GAIT[1, 1]), "b": pytest.approx(other()[1, 1])}
    for one in sweep.studies:  # As the processes of a sweep read them.
        open_study(one.settings, one.folder(out)).close()
    shutil.rmtree(first)
    shutil.rmtree(later)
    again = read_sweep(tmp_path / "sweep.toml", out)
    for one, before in zip(again.studies, sweep.studies, strict=True):
        assert one.settings.description() == before.settings.description()
        assert not is_finished(one.settings, one.folder(out))

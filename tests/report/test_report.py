"""The page of a study, and the command that writes it again."""

import dataclasses
import json
import re
import shlex
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import (
    FAILING_WEBGL,
    NO_DECOMPRESSION,
    NO_WEBGL,
    PLAYS,
    address,
    in_a_browser,
    opened,
)

from drake_gait.cli.optimize import parse
from drake_gait.cli.report import main
from drake_gait.errors import GaitError, StudyError
from drake_gait.report.page import (
    Run,
    command,
    write_comparison_page,
    write_study_page,
)
from drake_gait.report.result import summary
from drake_gait.report.study_result import read_result
from drake_gait.study.toml import write_study_toml


class Outline(HTMLParser):
    """Headings, pictures without words, tables without a caption, and addresses of a page."""

    def __init__(self, text):
        super().__init__()
        self.headings, self.mute, self.landmarks, self.addresses = [], [], [], []
        self.counts = dict.fromkeys(("table", "caption", "th", "scope"), 0)
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag == "img" and not found.get("alt"):
            self.mute.append(found)
        if tag in ("nav", "header", "main", "footer"):
            self.landmarks.append(tag)
        if tag in self.counts:
            self.counts[tag] += 1
        self.counts["scope"] += "scope" in found
        self.addresses += [found[name] for name in ("src", "href", "action") if found.get(name)]


@pytest.fixture
def run(study, entry, tmp_path):
    """A study of one walk, as if its folder were written."""
    result = json.loads(json.dumps(summary(study, [entry], None, wall_s=12.0)))
    (tmp_path / "figures").mkdir()
    drawing = '<svg xmlns="http://www.w3.org/2000/svg" width="252pt" height="180pt"></svg>'
    (tmp_path / "figures" / "paths.svg").write_text(drawing)
    (tmp_path / "walk.html").write_text("<!doctype html><title>walk</title>a recording")
    return Run(folder=tmp_path, settings=study, result={**result, "measures": None}, walks=[entry])


def written(run):
    path = run.folder / "report.html"
    write_study_page(run, path)
    return path.read_text(encoding="utf-8")


def test_a_page_has_landmarks_headings_in_order_and_words_for_every_picture(run):
    outline = Outline(written(run))
    assert outline.landmarks == ["nav", "header", "main", "footer"]
    assert outline.headings[0] == 1
    assert outline.headings.count(1) == 1
    assert all(b - a <= 1 for a, b in zip(outline.headings, outline.headings[1:], strict=False))
    assert outline.mute == []
    assert outline.counts["table"] == outline.counts["caption"] > 5
    assert outline.counts["th"] == outline.counts["scope"]


def test_a_page_loads_nothing_and_links_only_to_itself_and_the_recording(run):
    addresses = Outline(written(run)).addresses
    assert {found for found in addresses if not found.startswith(("data:", "#"))} == {"walk.html"}


def test_text_from_a_study_is_text_not_markup(run):
    hostile = dataclasses.replace(run.settings, question="is <b>5 > 3</b> & true?")
    page = written(dataclasses.replace(run, settings=hostile))
    assert "is &lt;b&gt;5 &gt; 3&lt;/b&gt; &amp; true?" in page


def test_the_same_study_gives_the_same_page(run):
    assert written(run) == written(run)


def test_a_page_without_a_network_or_a_recording_can_be_written(run):
    (run.folder / "walk.html").unlink()
    page = written(run)
    assert "R²" not in page
    assert "See it walk" not in page


def test_a_study_without_a_feasible_walk_says_so_first(run):
    page = written(dataclasses.replace(run, result={**run.result, "feasible": False}))
    assert "None of 1 walks holds all constraints" in " ".join(page.split())


def test_the_winner_is_what_holds_when_it_is_walked_again(run):
    numbers = {"forward_mm": 133.3, "median_mm": 120.5, "worst_mm": 80.0}
    finalist = {"walk": 0, **numbers, "survived": 8, "feasible": 7, "of": 8, "reference": None}
    again = {**run.result, "finalists": [finalist], "winner": 0, "nominal_best": 0}
    page = " ".join(written(dataclasses.replace(run, result=again)).split())
    assert "<strong>120.5 mm</strong> in the median of 8 walks" in page
    assert '<span class="tag">winner</span>' in page
    page = written(dataclasses.replace(run, result={**again, "winner": None}))
    assert "No finalist is feasible often enough" in page
    assert '<span class="tag">' not in page


def test_a_shuffle_is_called_one_beside_the_best_walk_that_does_not_slide(run, measures):
    slid = dataclasses.asdict(dataclasses.replace(measures, slip=(0.003, 0.0134)))
    numbers = {"forward_mm": 133.3, "median_mm": 120.5, "worst_mm": 80.0}
    finalist = {
        "walk": 0,
        **numbers,
        "survived": 8,
        "feasible": 7,
        "of": 8,
        "reference": None,
        "measures": slid,
    }
    of_it = {**run.result, "measures": slid, "finalists": [finalist], "best_unslipping": None}
    page = " ".join(written(dataclasses.replace(run, result=of_it)).split())
    assert "3/13 <small>mm</small>" in page
    assert "It slides" in page
    assert "So do all others that were measured." in page
    page = " ".join(
        written(dataclasses.replace(run, result={**of_it, "best_unslipping": 0})).split()
    )
    assert "walk 0 with <strong>133.3 mm</strong>" in page
    kept = {**of_it, "measures": dataclasses.asdict(measures)}
    assert "It slides" not in written(dataclasses.replace(run, result=kept))


def test_a_study_s_own_limits_stand_beside_the_paper_s(run, measures):
    measured = {**run.result, "measures": dataclasses.asdict(measures)}
    page = written(dataclasses.replace(run, result=measured))
    assert "Eqs. 11–14 of the paper</dd>" in page
    assert "range of the torso's heading</dd>" in page
    limits = run.settings.constraints.but(yaw_swing=np.radians(20.0))
    settings = dataclasses.replace(run.settings, constraints=limits)
    page = written(dataclasses.replace(run, result=measured, settings=settings))
    assert "Eqs. 11–14 of the paper; yaw swing</dd>" in page
    assert "range of the torso's heading, at most 20</dd>" in page


@pytest.mark.parametrize(
    "name", ["run", "two words", "it's $HOME; `true`", "größer", "-x", "#1", 'a "b" c']
)
def test_the_command_names_the_study_s_own_file_for_a_shell(run, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    folder = Path(name)
    folder.mkdir()
    write_study_toml(run.settings, folder)
    words = shlex.split(command(dataclasses.replace(run, folder=folder)))
    assert words[:3] == ["python", "-m", "drake_gait.optimize"]
    options = parse(words[3:])
    assert options.study.samefile(folder / "study.toml")
    assert options.settings().description() == run.settings.description()
    assert options.out.name == f"{name}-again"
    assert not options.out.exists()


def test_the_command_of_a_study_without_a_file_writes_it_first(run):
    first, second = command(run).split(" && ")
    assert shlex.split(first) == ["python", "-m", "drake_gait", "report", str(run.folder)]
    assert shlex.split(second)[3] == f"{run.folder}/study.toml"


def test_a_file_that_somebody_keeps_in_the_study_s_folder_is_left_alone(run):
    mine = run.folder / "study.toml"
    mine.write_text("[study]")
    write_study_toml(run.settings, run.folder)
    assert mine.read_text() == "[study]"
    assert f"{run.folder}/study-settings.toml" in shlex.split(command(run))


def test_a_comparison_has_a_column_for_each_study(run):
    other = dataclasses.replace(run, settings=dataclasses.replace(run.settings, seed=9))
    path = run.folder / "comparison.html"
    write_comparison_page([run, other], path)
    page = path.read_text(encoding="utf-8")
    outline = Outline(page)
    assert outline.headings[0] == 1
    assert outline.mute == []
    assert "study.seed" in page
    assert page.count("data:image/svg+xml") == 2


def test_a_page_that_cannot_be_written_is_named(run):
    with pytest.raises(GaitError, match=r"report .*nowhere"):
        write_study_page(run, run.folder / "nowhere" / "report.html")


@pytest.mark.parametrize("content", [None, "{", "[]"], ids=["none", "half", "a list"])
def test_a_result_that_cannot_be_read_is_named_with_the_cure(tmp_path, content):
    if content is not None:
        (tmp_path / "result.json").write_text(content)
    with pytest.raises(StudyError, match=r"result\.json"):
        read_result(tmp_path)


def test_a_folder_without_a_study_is_one_line(capsys, tmp_path):
    assert main([str(tmp_path)]) == 2
    assert main([str(tmp_path), str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 2
    assert "no study file" in said


def test_a_single_run_has_its_page_in_its_folder(capsys, tmp_path):
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path), "--out", "page.html"])
    assert ended.value.code == 2
    assert "report.html" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_remakes_a_report_and_compares_runs(finished_run, capsys, tmp_path):
    folder, _ = finished_run
    copy = tmp_path / "copy"
    copy.mkdir()
    shutil.copy(folder / "study.db", copy)
    assert main([str(copy)]) == 0
    assert capsys.readouterr().out == f"{copy / 'report.html'}\n"
    again, first = (read_result(place) for place in (copy, folder))
    assert again == {**first, "wall_s": again["wall_s"]}
    out = tmp_path / "both.html"
    assert main([str(folder), str(copy), "--out", str(out)]) == 0
    assert "All settings are the same." in out.read_text(encoding="utf-8")


@pytest.mark.slow
@in_a_browser
def test_a_report_in_a_browser_shows_the_numbers_of_result_json(finished_run):
    folder, _ = finished_run
    result = read_result(folder)
    with opened(address(folder / "report.html")) as seen:
        values = seen.page.eval_on_selector_all(
            "data", "nodes => nodes.map(node => [Number(node.value), node.textContent])"
        )
        keys = ("forward_mm", "lateral_mm", "yaw_deg", "com_height_mm", "frames")
        for key, (value, text) in zip(keys, values, strict=True):
            assert value == result[key]
            shown = float(text.replace("\N{MINUS SIGN}", "-"))
            assert shown == pytest.approx(result[key], abs=0.051)
        gait = seen.page.eval_on_selector_all(
            "table",
            """tables => [...tables.find(table => table.caption.textContent.includes(
            "Coefficients")).querySelectorAll("td")].map(cell => cell.textContent)""",
        )
        degrees = np.ravel(result["coefficients_deg"])
        assert [float(text.replace("\N{MINUS SIGN}", "-")) for text in gait] == pytest.approx(
            degrees, abs=0.0051
        )
        loaded = "nodes => nodes.every(node => node.complete && node.naturalWidth > 100)"
        assert seen.page.eval_on_selector_all("img", loaded)
        assert seen.page.locator("figure img").count() >= 8
        assert seen.requests == [address(folder / "report.html")]
        assert seen.complaints == []


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_report_fits_a_phone_and_takes_the_colours_of_its_reader(finished_run, scheme):
    folder, _ = finished_run
    with opened(address(folder / "report.html"), width=390, height=844, scheme=scheme) as seen:
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= 390
        corner = seen.shot(x=0, y=200, width=8, height=8)
        assert (corner.mean() > 0.9) == (scheme == "light")
        # Each number within its tile, and of each table the words above it within the page.
        inside = "nodes => nodes.every(node => node.scrollWidth <= node.clientWidth)"
        assert seen.page.eval_on_selector_all(".tiles div", inside)
        words = "nodes => Math.max(...nodes.map(node => node.getBoundingClientRect().right))"
        assert seen.page.eval_on_selector_all("caption span", words) <= 390
        # The robot's legs are black; they do not stand on black.
        behind = "node => getComputedStyle(node).backgroundColor"
        shown = seen.page.eval_on_selector(".portrait", behind)
        assert (shown == "rgba(0, 0, 0, 0)") == (scheme == "light")


@pytest.mark.slow
@in_a_browser
def test_the_recording_plays_inside_the_report(finished_run):
    folder, _ = finished_run
    with opened(address(folder / "report.html")) as seen:
        seen.page.focus("#play")
        seen.page.keyboard.press("Enter")
        frame = seen.page.wait_for_selector("iframe").content_frame()
        frame.wait_for_function(PLAYS)
        begin = frame.evaluate("viewer.animator.time")
        seen.page.wait_for_timeout(1000)
        assert frame.evaluate("viewer.animator.time") != begin
        assert seen.complaints == []
        assert seen.requests == [address(folder / "report.html")]


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize("lacking", [NO_WEBGL, FAILING_WEBGL, NO_WEBGL + NO_DECOMPRESSION])
def test_a_report_shows_the_portrait_where_nothing_draws_in_three_dimensions(finished_run, lacking):
    folder, _ = finished_run
    with opened(address(folder / "report.html"), lacking=lacking) as seen:
        seen.page.click("#play")
        assert "WebGL 2" in seen.page.inner_text("#stage")
        shown, portrait = (
            seen.page.get_attribute(f"{where} .portrait", "src") for where in ("#stage", "header")
        )
        assert shown == portrait
        assert seen.page.is_visible("#stage .portrait")
        assert seen.page.locator("iframe, #play").count() == 0
        assert seen.complaints == []
        assert seen.requests == [address(folder / "report.html")]


@pytest.mark.slow
@in_a_browser
def test_a_report_says_why_it_cannot_unpack_its_recording_and_links_the_file(finished_run):
    folder, _ = finished_run
    with opened(address(folder / "report.html"), lacking=NO_DECOMPRESSION) as seen:
        seen.page.click("#play")
        assert "DecompressionStream" in seen.page.inner_text("#stage")
        seen.page.click("#stage a")
        seen.page.wait_for_function(PLAYS)
        assert seen.page.url == address(folder / "walk.html")
        assert seen.complaints == []


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize("damaged", ["!!!!", "AAAA", None])
def test_a_report_says_that_its_recording_is_damaged(finished_run, tmp_path, damaged):
    folder, _ = finished_run
    before, opening, after = (folder / "report.html").read_text("utf-8").partition('recording">')
    packed, closing, rest = after.partition("<")
    packed = packed[:4000] + (damaged + packed[4004:] if damaged else "")
    (tmp_path / "report.html").write_text(before + opening + packed + closing + rest, "utf-8")
    with opened(address(tmp_path / "report.html")) as seen:
        seen.page.click("#play")
        seen.page.wait_for_selector("#stage a")
        assert "damaged" in seen.page.inner_text("#stage")
        assert seen.page.get_attribute("#stage a", "href") == "walk.html"
        assert seen.page.locator("iframe").count() == 0
        assert seen.complaints == []


@pytest.mark.slow
@in_a_browser
def test_a_report_without_scripts_has_no_button_that_does_nothing(finished_run):
    folder, _ = finished_run
    with opened(address(folder / "report.html"), scripts=False) as seen:
        assert not seen.page.is_visible("#play")
        assert seen.page.is_visible("a[href='walk.html']")

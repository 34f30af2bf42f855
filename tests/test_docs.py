"""What README, CONTRIBUTING and docs/ say can be done."""

import argparse
import json
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest

import drake_gait
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.records import StudyWalk
from drake_gait.study.store import Study

ROOT = Path(__file__).parents[1]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]

SNIPPET = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^    (python .*(?:\n +[\[-].*)*)", re.MULTILINE)
INLINE = re.compile(r"`(python [^`]*)`")
MAKE = re.compile(r"(?:^    |`)make ([\w-]+)(?: ARGS=\"([^\"]*)\")?", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.*)", re.MULTILINE)


def name(page):
    return str(page.relative_to(ROOT))


def snippets():
    return [
        pytest.param(
            text,
            id=f"{name(page)}-{number}",
            marks=[pytest.mark.slow] if "run_study(" in text else [],
        )
        for page in PAGES
        for number, text in enumerate(SNIPPET.findall(page.read_text(encoding="utf-8")))
    ]


def own_commands():
    """Arguments of every command line of ours, and of each `make walk` what it hands on."""
    found = {}
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for line in [*INDENTED.findall(text), *INLINE.findall(text)]:
            # Usage lines write [--option N] and --this | --that; several spaces part a command
            # from its meaning.
            command = re.split(r"(?<=\S) {3,}(?!-|\[)| \| ", re.sub(r"(?: \\)?\n +", " ", line))[0]
            words = shlex.split(re.sub(r"[\[\]()]|\.\.\.", "", command), comments=True)[1:]
            ours = words[0] == "-m" and words[1].startswith("drake_gait")
            if (ours and page.name != "CHANGELOG.md") or words[0].startswith(
                ("tools/", "studies/")
            ):
                # A choice a|b, or a bare name, is a mention; --help shows that there is such a one.
                *first, last = words[:-1] if words[-1] == "&" else words
                choices = last.split("|") if "|" in last else [last]
                bare = "|" in last or len(words) == 1 + ours
                for choice in choices:
                    mentioned = [*first, choice, *["--help"] * bare]
                    found.setdefault(" ".join(mentioned), mentioned)
        for target, arguments in MAKE.findall(text):
            if target == "walk" and arguments:
                words = ["-m", "drake_gait.optimize", *shlex.split(arguments)]
                found.setdefault(" ".join(words), words)
    return found


COMMANDS = own_commands()


class AcceptedError(Exception):
    """A parser took its command line."""


@pytest.fixture
def run_folder(tmp_path: Path, entry: StudyWalk, monkeypatch) -> Path:
    """A working folder that holds what `make walk` leaves, as far as a snippet may read it."""
    settings = read_study(default_study())
    study = Study.create(
        tmp_path / "runs" / "steady" / "study.db",
        {"settings": settings.description(), "model_sha256": "", "versions": {}},
    )
    with study:
        study.add(entry)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("text", snippets())
@pytest.mark.usefixtures("run_folder")
def test_a_snippet_runs_as_it_stands(text):
    exec(compile(text, "snippet", "exec"), {"__name__": "snippet"})


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_link_leads_somewhere(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if re.match(r"\w+://|mailto:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), target
        if anchor:
            titles = HEADING.findall(file.read_text(encoding="utf-8"))
            slugs = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
            assert anchor in slugs, target


NAMED = re.compile(r"[` ]((?:drake_gait|tests|tools)/[\w/]+\.\w+)")


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=name)
def test_a_file_of_ours_that_a_page_names_is_there(page):
    # The changelog may name files as they were.
    for path in NAMED.findall(page.read_text(encoding="utf-8")):
        assert (ROOT / path).exists(), path


def linked(file):
    """The files that a page leads to."""
    targets = LINK.findall(file.read_text(encoding="utf-8"))
    return {(file.parent / target.partition("#")[0]).resolve() for target in targets}


SHELVES = [path.parent for path in sorted((ROOT / "docs").rglob("index.md"))]


@pytest.mark.parametrize("shelf", SHELVES, ids=name)
def test_the_index_of_a_shelf_leads_to_every_page_on_it(shelf):
    pages = {page for page in shelf.glob("*.md") if page.name != "index.md"}
    below = set(shelf.glob("*/index.md"))
    assert (pages | below) - linked(shelf / "index.md") == set()


def test_every_page_stands_on_a_shelf():
    # The tutorial is one page, which the first page leads to itself.
    shelves = {*SHELVES, ROOT / "docs" / "tutorial"}
    assert {page.parent for page in PAGES if "docs" in page.parts} == shelves
    assert set((ROOT / "docs" / "tutorial").glob("*.md")) <= linked(ROOT / "docs" / "index.md")


def test_readme_and_first_page_lead_to_every_shelf():
    shelves = {shelf / "index.md" for shelf in SHELVES if shelf.parent == ROOT / "docs"}
    assert len(shelves) == 4
    for first in ("README.md", "docs/index.md"):
        assert shelves - linked(ROOT / first) == set(), first


def test_readme_is_read_in_a_few_minutes():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 700
    results = text.partition("\n## Results\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\|.*\|$", results, re.MULTILINE)[2:]
    assert 0 < len(rows) <= 6


@pytest.mark.parametrize(
    "statement", re.findall(r"`(from drake_gait[^`]*)`", (ROOT / "README.md").read_text())
)
def test_a_method_of_the_readme_is_imported_as_it_says(statement):
    exec(statement)


EXPERIMENTS = sorted((ROOT / "docs" / "experiments").glob("[!i]*.md"))


@pytest.mark.parametrize("page", EXPERIMENTS, ids=name)
def test_an_experiment_has_a_date_a_question_a_command_a_result_and_a_verdict(page):
    assert re.match(r"20\d\d-[01]\d-[0-3]\d-[a-z]", page.name)
    text = page.read_text(encoding="utf-8")
    sections = re.findall(r"^## (.*)\n\n+(?!#)", text, re.MULTILINE)
    assert sections == ["Question", "Command", "Result", "Verdict"]
    command = text.partition("\n## Command\n")[2].partition("\n## ")[0]
    assert re.search(r"^    (python|pytest|make) ", command, re.MULTILINE)


HOW_TOS = sorted((ROOT / "docs" / "howto").glob("*.md"))


@pytest.mark.parametrize("page", HOW_TOS, ids=name)
def test_the_code_of_a_how_to_is_short(page):
    text = page.read_text(encoding="utf-8")
    fenced = [line for block in SNIPPET.findall(text) for line in block.splitlines()]
    assert len(fenced) + len(re.findall(r"^    \S", text, re.MULTILINE)) <= 40


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_a_command_line_is_accepted(words, monkeypatch):
    take = argparse.ArgumentParser.parse_known_args

    def accept(parser, arguments=None, namespace=None):
        _, unknown = take(parser, arguments, namespace)
        if unknown:
            parser.error(f"unrecognized arguments: {' '.join(unknown)}")
        raise AcceptedError

    monkeypatch.setattr(argparse.ArgumentParser, "parse_known_args", accept)
    module = words[0] == "-m"
    file = ROOT / words[0]
    if module:
        file = ROOT / words[1].replace(".", "/")
        file = file / "__main__.py" if file.is_dir() else file.with_suffix(".py")
    numbers = {"N": "1", "ID": "1"}
    arguments = [numbers.get(word, word) for word in words[1 + module :]]
    monkeypatch.setattr(sys, "argv", [str(file), *arguments])
    monkeypatch.syspath_prepend(str(file.parent))
    with pytest.raises((AcceptedError, SystemExit)) as end:
        runpy.run_path(str(file), run_name="__main__")
    assert end.type is AcceptedError or end.value.code == 0


def test_the_commands_of_the_pages_are_found():
    # The law above would hold of pages without commands.
    found = " ".join(COMMANDS)
    for known in ("-m drake_gait.optimize", "-m drake_gait replay", "tools/bench_walk.py"):
        assert known in found


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_make_has_the_targets_that_are_named(page):
    known = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for target, _ in MAKE.findall(page.read_text(encoding="utf-8")):
        assert target in known


def test_the_api_lists_what_the_package_exports():
    listed = re.findall(r"`(\w+) <drake_gait\.", (ROOT / "docs/reference/api/index.md").read_text())
    assert sorted(listed) == sorted(drake_gait.__all__)


def test_the_api_names_its_modules_as_python_does():
    folder = ROOT / "docs" / "reference" / "api"
    index = (folder / "index.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[.*?\]\((\w+\.md)\) \| (.*) \|$", index, re.MULTILINE)
    assert len(rows) == len(list(folder.glob("*.md"))) - 1
    for file, names in rows:
        text = (folder / file).read_text(encoding="utf-8")
        headings = re.findall(r"^## (.*)", text, re.MULTILINE)
        modules = re.findall(r"^\.\. automodule:: drake_gait\.(.*)", text, re.MULTILINE)
        assert re.findall(r"`(.*?)`", names) == headings == modules, file


TUTORIAL = ROOT / "studies" / "tutorial.py"


def code_cells():
    """Code of every cell of the tutorial's notebook."""
    content = json.loads(TUTORIAL.with_suffix(".ipynb").read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in content["cells"] if cell["cell_type"] == "code"]


def test_the_notebook_is_the_tutorial_s_script_without_outputs():
    make = runpy.run_path(str(ROOT / "tools" / "make_notebook.py"))
    script = TUTORIAL.read_text(encoding="utf-8")
    written = TUTORIAL.with_suffix(".ipynb").read_text(encoding="utf-8")
    assert written == make["notebook"](script), "run python tools/make_notebook.py"
    _, _, code = script.partition("# %%")
    kept = [line for line in "\n".join(code_cells()).splitlines() if line.strip()]
    wanted = [line for line in code.splitlines()[1:] if line.strip() and line[:4] != "# %%"]
    assert kept == wanted


@pytest.mark.slow
def test_the_notebook_s_cells_run_one_after_the_other(tmp_path, monkeypatch, capfd):
    budget = ["--samples", "28", "--simulations", "30", "--confirmations", "8"]
    budget += ["--out", str(tmp_path / "tutorial")]
    monkeypatch.setattr(sys, "argv", ["ipykernel_launcher.py", "-f", "kernel.json", *budget])
    names = {"__name__": "__main__"}
    for place, code in enumerate(code_cells()):
        exec(compile(code, f"cell {place}", "exec", dont_inherit=True), names)
    printed = capfd.readouterr().out
    for step in range(1, 9):
        assert f"\n{step}. " in f"\n{printed}"
    for written in ("first.html", "gait/result.json", "codesign/walk.html"):
        assert (tmp_path / "tutorial" / written).is_file()

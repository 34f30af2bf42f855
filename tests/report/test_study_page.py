"""What docs/reference/study.md says of settings and columns is what there is."""

import importlib
import re
import tomllib

import pytest

from drake_gait.errors import SettingsError
from drake_gait.problem import BUILT_IN
from drake_gait.study.keys import KEYS
from drake_gait.study.reading import default_study, read_override, read_study
from drake_gait.study.store import SCHEMA, Study
from drake_gait.walk import _CAUSES

WORDS = ("required", "empty", "none")
"""Defaults that are no value."""


@pytest.fixture(scope="module")
def page(repository):
    return (repository / "docs" / "reference" / "study.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def settings(page):
    """The table of settings: name to unit, default, range and meaning."""
    rows = re.findall(r"^\| `(\w+\.\w+)` \|(.*)\|$", page, flags=re.MULTILINE)
    return {name: [cell.strip() for cell in cells.split("|")] for name, cells in rows}


@pytest.fixture
def read(tmp_path):
    """Reads a study that has what it must have, and one more setting if it is given."""
    required = {("study", "name"), ("box", "centre_deg"), ("box", "half_width_deg")}
    with default_study().open("rb") as file:
        paper = tomllib.load(file)
    lines = [
        f"{section}.{key} = {paper[section][key]!r}".replace("'", '"') for section, key in required
    ]
    path = tmp_path / "least.toml"
    path.write_text("\n".join(lines))

    def read(name=None, value=None):
        return read_study(path, dict([read_override(f"{name}={value}")]) if name else None)

    return read


def test_the_tables_are_those_that_the_code_makes(page, repository, monkeypatch):
    """`python tools/make_reference.py` writes them."""
    monkeypatch.syspath_prepend(repository / "tools")
    make_reference = importlib.import_module("make_reference")
    assert make_reference.written(page) == page
    for one in BUILT_IN.values():
        assert page.count(f"\n| `{one.name}` | {one.symbol}") >= 1


def test_the_page_has_every_setting_once(settings, page):
    sections = [section for section in KEYS if section != "design"]  # As [foot], it says.
    assert list(settings) == [f"{section}.{key}" for section in sections for key in KEYS[section]]
    assert set(KEYS["design"]) <= set(KEYS["foot"])


def test_the_defaults_on_the_page_are_those_of_a_study_that_says_nothing(settings, read):
    said = read().description()
    checked = 0
    for name, (_, default, *_) in settings.items():
        if default not in WORDS:
            found = read(name, default).description()
            assert found.keys() == said.keys()
            for key, value in found.items():
                like = pytest.approx(said[key]) if isinstance(value, float) else said[key]
                assert value == like, name
            checked += 1
    assert checked >= 15


def beyond(text):
    """Values just outside a range, as the page writes ranges."""
    if found := re.fullmatch(r"≥ (\d+)", text):
        return [int(found[1]) - 1]
    if found := re.fullmatch(r"> (\d+)", text):
        return [int(found[1]), -1]
    if found := re.fullmatch(r"([\d.]+) to ([\d.]+)", text):
        low, high = float(found[1]), float(found[2])
        return [0.99 * low if low else -0.001, 1.01 * high]
    return []


def test_a_value_beyond_the_range_on_the_page_is_refused_and_its_ends_are_not(settings, read):
    checked = 0
    for name, (_, _, extent, _) in settings.items():
        for value in beyond(extent):
            with pytest.raises(SettingsError):
                read(name, value)
            checked += 1
        for end in extent.split(" to ") if " to " in extent else []:
            read(name, end)
    assert checked >= 20


def test_the_page_has_every_column_of_the_study_file(page, study, entry, tmp_path):
    with Study.create(tmp_path / "study.db", {"settings": study.description()}) as opened:
        columns = list(opened.table())
    named = set(re.findall(r"`(\w+)`", page))
    grouped = {"roll": "`roll_a` … `ankle_d`", "predicted": "`predicted_…`"}
    assert all(text in page for text in grouped.values())
    gait = {"roll", "hip", "knee", "ankle"}
    missing = {
        name
        for name in columns
        if name not in named and name.split("_")[0] not in gait | {"predicted"}
    }
    assert not missing
    told = re.findall(
        r"`(\w+)`",
        "".join(re.findall(r"^\| (`.*?) \|", page.split("| columns |")[1].split("\n\n")[0], re.M)),
    )
    assert set(told) - {"roll_a", "ankle_d"} <= set(columns)


def test_the_page_is_of_the_schema_that_is_written(page):
    assert f"this is schema {SCHEMA}." in page


def test_the_causes_of_failures_on_the_page_are_those_that_are_counted(page):
    rows = set(re.findall(r"^\| ([a-z ]+) \| ", page, flags=re.MULTILINE))
    assert {*_CAUSES, "fell", "lost"} <= rows

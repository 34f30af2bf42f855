"""Names and texts that people give a study: what a folder, a page and a command line can hold."""

import json
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_gait.cli import _optimize, optimize
from drake_gait.errors import SettingsError
from drake_gait.study._toml import as_toml
from drake_gait.study.reading import default_study, read_override, read_study
from drake_gait.sweep.settings import read_sweep

ANY_TEXT = st.text(st.characters(exclude_categories=["Cs"]))
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | ANY_TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(ANY_TEXT, inner, max_size=3),
    max_leaves=8,
)


@given(VALUES)
def test_every_value_returns_from_toml_in_ascii(value):
    written = as_toml(value)
    assert written.isascii()
    assert "\n" not in written
    assert tomllib.loads(f"value = {written}") == {"value": value}


@pytest.mark.parametrize(
    "text", ["1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", "nan", "-inf", "[[1, 2.5], []]"]
)
def test_a_value_of_a_file_is_written_as_it_was_read(text):
    value = tomllib.loads(f"value = {text}")["value"]
    assert repr(tomllib.loads(f"value = {as_toml(value)}")["value"]) == repr(value)


@given(ANY_TEXT)
def test_a_sweep_hands_its_studies_every_text(text):
    assert read_override(f"study.question={as_toml(text)}") == (("study", "question"), text)


def test_toml_has_no_other_values():
    with pytest.raises(SettingsError, match="None"):
        as_toml(None)


GOOD = ["a", "größe", "🤖 𝔽", "x" * 255, "ü" * 127, "a.b", "$x_{$", "-a", "con", "a b"]
BAD = {
    "": "''",
    ".": "'.'",
    "..": "'..'",
    ".hidden": ".hidden",
    "a/b": "a/b",
    "/etc": "/etc",
    "x" * 256: "255 bytes",
    "ü" * 128: "255 bytes",
    "🤖" * 64: "255 bytes",
    "a\0b": "U+0000",
    "a\x07b": "U+0007",
    "a\x7fb": "U+007F",
    "a\x85b": "U+0085",
    "a\nb": "folder's name",
    "a\tb": "folder's name",
    "a\ud83e": "U+D83E",
}


@pytest.mark.parametrize("name", GOOD)
def test_a_name_that_a_folder_can_have_is_taken(name):
    assert read_study(default_study(), {("study", "name"): name}).name == name


@pytest.mark.parametrize("name", BAD)
def test_a_name_that_no_folder_can_have_is_refused(name, tmp_path):
    with pytest.raises(SettingsError) as caught:
        read_study(default_study(), {("study", "name"): name})
    assert "study.name" in str(caught.value)
    assert BAD[name] in str(caught.value)
    assert "\n" not in str(caught.value)
    if "\ud83e" in name:
        return  # No file in UTF-8 has that.
    head = f'[sweep]\nname = "s"\nbase = {json.dumps(str(default_study()))}\nseeds = [0]\n'
    (tmp_path / "s.toml").write_text(f"{head}[variants.{as_toml(name)}]\n")
    with pytest.raises(SettingsError, match="variant"):
        read_sweep(tmp_path / "s.toml")
    (tmp_path / "s.toml").write_text(f"{head.replace(as_toml('s'), as_toml(name))}[variants.a]\n")
    with pytest.raises(SettingsError, match=r"sweep\.name|needs a name"):
        read_sweep(tmp_path / "s.toml")


@pytest.mark.parametrize("key", [("study", "question"), ("box", "chosen")])
def test_a_text_has_lines_and_any_character_but_halves_and_controls(key):
    for good in ("", "zwei\nZeilen\t🤖 $x$ <b> \\", "x" * 10_000):
        read_study(default_study(), {key: good})
    for bad, named in (("a\0", "U+0000"), ("\x1b[2J", "U+001B"), ("\udcff", "U+DCFF")):
        with pytest.raises(SettingsError) as caught:
            read_study(default_study(), {key: bad})
        assert ".".join(key) in str(caught.value)
        assert named in str(caught.value)


@pytest.mark.parametrize("out", ["x" * 300, "x/" * 3000, "file", "file/below"])
def test_a_folder_that_cannot_be_made_is_one_line_before_anything_walks(
    tmp_path, capsys, monkeypatch, out
):
    monkeypatch.setattr(
        _optimize, "search_study", lambda *arguments, **options: pytest.fail("walked")
    )
    (tmp_path / "file").write_text("")
    assert optimize.main(["--out", str(tmp_path / out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert out[:2] in error


@pytest.mark.parametrize("name", ["result.json", "walk.html", "report.html", "figures"])
def test_what_stands_in_the_way_of_a_report_is_named_before_anything_walks(
    tmp_path, capsys, monkeypatch, name
):
    monkeypatch.setattr(
        _optimize, "search_study", lambda *arguments, **options: pytest.fail("walked")
    )
    if name == "figures":
        (tmp_path / name).write_text("")
    else:
        (tmp_path / name).mkdir()
    assert optimize.main(["--out", str(tmp_path)]) == 2
    assert str(tmp_path / name) in capsys.readouterr().err

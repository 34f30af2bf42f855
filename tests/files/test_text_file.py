"""Texts in the encodings that editors save."""

import codecs
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_gait.errors import SettingsError
from drake_gait.files.strict_json import from_json
from drake_gait.files.text import decode, read_text
from drake_gait.study.reading import default_study, read_study
from drake_gait.sweep.settings import read_sweep

ENCODINGS = {
    "utf-8": b"",
    "utf-8-sig": b"",
    "utf-16": b"",
    "utf-32": b"",
    "utf-16-le": codecs.BOM_UTF16_LE,
    "utf-16-be": codecs.BOM_UTF16_BE,
    "utf-32-be": codecs.BOM_UTF32_BE,
}
"""Encodings, and the mark that goes before."""


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r\ufeff\0")))
def test_a_text_returns_from_every_encoding_with_a_mark(text):
    for encoding, mark in ENCODINGS.items():
        if encoding != "utf-8" and text:
            assert decode(mark + text.encode(encoding)) == text
    assert decode(text.encode()) == text


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "utf-32-le", "utf-32-be"])
def test_a_text_that_begins_in_ascii_returns_without_a_mark(encoding):
    for text in ('[study]\nname = "größe 🤖"\n', '{"a": 1}', "# é\n"):
        assert decode(text.encode(encoding)) == text


def test_every_end_of_a_line_is_one():
    assert decode(b"a\r\nb\rc\nd") == "a\nb\nc\nd"


@pytest.mark.parametrize("encoding", [*ENCODINGS, "utf-16-le", "utf-32-le"])
def test_a_study_a_sweep_and_a_result_are_read_in_every_encoding(encoding, tmp_path):
    mark = ENCODINGS.get(encoding, b"")
    study = default_study().read_text(encoding="utf-8")
    (tmp_path / "study.toml").write_bytes(mark + study.replace("\n", "\r\n").encode(encoding))
    assert read_study(tmp_path / "study.toml").name == "steady"
    sweep = '[sweep]\nname = "größe"\nbase = "study.toml"\nseeds = [0]\n[variants."🤖"]\n'
    (tmp_path / "sweep.toml").write_bytes(mark + sweep.encode(encoding))
    assert read_sweep(tmp_path / "sweep.toml").variants == ("🤖",)
    result = json.dumps({"coefficients_deg": [1.0], "question": "🤖"}, ensure_ascii=False)
    (tmp_path / "result.json").write_bytes(mark + result.encode(encoding))
    assert from_json((tmp_path / "result.json").read_bytes())["coefficients_deg"] == [1.0]


@pytest.mark.parametrize(
    ("data", "named"),
    [
        ('a = 1\nb = "größe"\n'.encode("latin-1"), "line 2: byte 0xf6"),
        (b"\xff\xfea\x00b", "byte 0x62"),
        (codecs.BOM_UTF16_LE + b"\x00\xd8a\x00", "byte 0x00"),
        (b"\x80", "line 1: byte 0x80"),
    ],
)
def test_bytes_that_are_not_text_are_named_by_file_line_and_byte(data, named, tmp_path):
    (tmp_path / "a.toml").write_bytes(data)
    with pytest.raises(SettingsError) as caught:
        read_text(tmp_path / "a.toml", "study")
    assert f"{tmp_path / 'a.toml'}" in str(caught.value)
    assert named in str(caught.value)
    assert "UTF-8" in str(caught.value)


@pytest.mark.parametrize("name", ["none.toml", "", "x" * 300, "a\0b"])
def test_a_file_that_cannot_be_read_is_named(name, tmp_path):
    with pytest.raises(SettingsError) as caught:
        read_text(tmp_path / name, "study")
    assert "study" in str(caught.value)
    assert str(tmp_path / name).replace("\0", "\\x00") in str(caught.value)

"""Tables of the commands: whole and plain in a pipe, within the width of a terminal."""

import os
import pty
import re
import sys

import pytest

from drake_gait.cli._table import show
from drake_gait.report.tables import Table

LONG = "a value of more than a hundred characters " * 4
TABLE = Table(
    caption="of two rows",
    columns=["name", "first", "second"],
    rows=[["[bold]one[/bold]", "\N{MINUS SIGN}1.5", "\N{EN DASH}"], [LONG, "20.25", "ö 漢字"]],
    marked=0,
)


@pytest.mark.parametrize("colours", [{}, {"FORCE_COLOR": "1"}, {"COLUMNS": "20"}])
def test_a_piped_table_has_every_row_in_one_line_without_colours(capsys, monkeypatch, colours):
    for name, value in colours.items():
        monkeypatch.setenv(name, value)
    show(TABLE)
    text = capsys.readouterr().out
    caption, heads, one, long = text.splitlines()
    assert (caption, heads.split()) == ("of two rows", ["name", "first", "second"])
    assert one.split() == ["[bold]one[/bold]", "-1.5", "-"]
    assert long.split() == [*LONG.split(), "20.25", "ö", "漢字"]
    assert "\x1b" not in text
    assert all(line == line.rstrip() for line in text.splitlines())


def test_numbers_stand_below_each_other_and_words_begin_alike(capsys):
    rows = [["x", "1.5"], ["y", "20.25"]]
    show(Table(caption="", columns=["", "value"], rows=rows))
    assert capsys.readouterr().out == "   value\nx    1.5\ny  20.25\n"
    show(Table(caption="", columns=["", "value"], rows=rows, numbers=False))
    assert capsys.readouterr().out == "   value\nx  1.5\ny  20.25\n"


def test_columns_without_names_have_no_line_of_heads(capsys):
    show(Table(caption="", columns=["", ""], rows=[["walks", "6"]], numbers=False))
    assert capsys.readouterr().out == "walks  6\n"


def test_a_terminal_breaks_wide_cells_into_lines_and_loses_no_word(monkeypatch):
    reader, terminal = pty.openpty()
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setenv("TERM", "xterm")
    with os.fdopen(terminal, "w", encoding="utf-8") as output:
        monkeypatch.setattr(sys, "stdout", output)
        show(TABLE)
        output.flush()
        text = os.read(reader, 100_000).decode()
    os.close(reader)
    lines = re.sub(r"\x1b\[[0-9;]*m", "", text).splitlines()
    assert max(map(len, lines)) <= 60
    assert len(lines) > 5
    words = " ".join(lines).split()
    assert all(words.count(word) >= LONG.split().count(word) for word in LONG.split())

"""Tables on standard output: within the width of a terminal, whole and plain elsewhere."""

import sys

from rich.console import Console
from rich.table import Table as Drawn
from rich.text import Text

from drake_gait.report.tables import Table

_GAP = 2  # Spaces between two columns.
_ENDLESS = 1_000_000  # Width of a line where nobody sees its end.
_PLAIN = str.maketrans("\N{MINUS SIGN}", "-")


def show(table: Table) -> None:
    """Print a table.

    On a terminal, a cell that is too wide is broken into lines. In a file or a pipe every row is
    one line, with the whole of every cell and without colours.
    """
    on_terminal = sys.stdout.isatty()  # FORCE_COLOR would make that true of files.
    console = Console(
        force_terminal=on_terminal,
        no_color=None if on_terminal else True,
        width=None if on_terminal else _ENDLESS,
        highlight=False,
    )
    with console.capture() as captured:
        if table.caption:
            console.print(Text(table.caption, style="italic" if on_terminal else ""))
        console.print(_drawn(table, on_terminal))
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))


def _drawn(table: Table, on_terminal: bool) -> Drawn:
    drawn = Drawn(
        box=None,
        pad_edge=False,
        padding=(0, _GAP, 0, 0),
        show_header=any(table.columns),
        header_style="bold" if on_terminal else "",
    )
    for place, name in enumerate(table.columns):
        right = table.numbers and place > 0
        drawn.add_column(Text(name), justify="right" if right else "left", overflow="fold")
    for number, row in enumerate(table.rows):
        marked = on_terminal and number == table.marked
        drawn.add_row(*(Text(_plain(cell)) for cell in row), style="bold" if marked else "")
    return drawn


def _plain(cell: str) -> str:
    """Return a cell with the signs that programs read as numbers."""
    return "-" if cell == "\N{EN DASH}" else cell.translate(_PLAIN)

"""Markdown tables, as pages have them: a row may be printed as soon as it is known."""

from collections.abc import Iterable, Sequence


def heading(columns: Sequence[str], words: int = 1) -> str:
    """Return the two lines above a table's rows; all columns but the first `words` are numbers."""
    marks = ["---"] * words + ["---:"] * (len(columns) - words)
    return f"{row(columns)}\n|{'|'.join(marks)}|"


def row(cells: Iterable[object]) -> str:
    """Return a line of a table."""
    return f"| {' | '.join(map(str, cells))} |"

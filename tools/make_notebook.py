"""Write the tutorial's notebook from its script: `python tools/make_notebook.py`.

studies/tutorial.py is the one source. Its docstring and the titles of its cells, which follow
`# %%`, become Markdown; everything else becomes code. The notebook has no outputs.
"""

import argparse
import ast
import json
import re
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parents[1] / "studies" / "tutorial.py"
"""The tutorial."""

_TITLE = re.compile(r"^# %% (.*)$", re.MULTILINE)


def notebook(script: str) -> str:
    """Return the notebook of a script in cells, as nbformat 4.5."""
    docstring = ast.get_docstring(ast.parse(script)) or ""
    parts = _TITLE.split(script)[1:]
    title, _, about = docstring.partition("\n\n")
    cells = [_markdown(f"# {title}\n\n{about}")]
    for title, code in zip(parts[::2], parts[1::2], strict=True):
        heading, _, rest = title.partition(". ") if not title[0].isdigit() else _numbered(title)
        cells += [_markdown(f"## {heading.rstrip('.')}\n\n{rest}"), _code(code)]
    content = {
        "cells": [{"id": f"cell-{place}", **cell} for place, cell in enumerate(cells)],
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _numbered(title: str) -> tuple[str, str, str]:
    """Part "1. One gait. Sixteen coefficients ..." after its second dot."""
    number, _, rest = title.partition(". ")
    heading, dot, rest = rest.partition(". ")
    return f"{number}. {heading}", dot, rest


def _markdown(text: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "metadata": {}, "source": _lines(text)}


def _code(text: str) -> dict[str, Any]:
    return {
        "cell_type": "code",
        "execution_count": None,
        "metadata": {},
        "outputs": [],
        "source": _lines(text),
    }


def _lines(text: str) -> list[str]:
    return text.strip().splitlines(keepends=True)


def main() -> None:
    """Write the notebook beside the script."""
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    path = SCRIPT.with_suffix(".ipynb")
    path.write_text(notebook(SCRIPT.read_text(encoding="utf-8")), encoding="utf-8")
    print(f"wrote {path}")


if __name__ == "__main__":
    main()

"""The site that `make docs` builds: the Markdown pages, and the API from its docstrings."""

import itertools
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from numpy.typing import ArrayLike
from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config, GoogleDocstring
from sphinx.util import logging
from sphinx.util.typing import stringify_annotation
from sphinx.writers.html5 import HTML5Translator

import drake_gait
from drake_gait.gait import FloatArray
from drake_gait.optimizers._box import Array

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
import make_reference

project = "drake_gait"
version = release = drake_gait.__version__
copyright = "the drake_gait developers, BSD-3-Clause"

extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["_build"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
# A page must also read well on a git host, which shows ```math and $...$ as this site does.
myst_fence_as_directive = ["math"]

add_module_names = False
default_role = "code"  # A docstring's single backquotes name code.
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True

# Links into this package are checked; the names of others lead nowhere, because the site is built
# and read without a network.
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!drake_gait\.).*"), ("py:.*", r"drake_gait\..*\._[\w.]+")]

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["equations.css"]
html_title = "drake_gait"
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"


_ALIASES = {
    name: stringify_annotation(alias, "smart", short_literals=False)
    for name, alias in (("ArrayLike", ArrayLike), ("FloatArray", FloatArray), ("Array", Array))
}


def _mathml(translator: HTML5Translator, node: nodes.math | nodes.math_block) -> None:
    """Write an equation as MathML, which browsers show without scripts, fonts or a network."""
    block = isinstance(node, nodes.math_block)
    try:
        text = tex2mathml(node.astext(), as_block=block)
    except MathError as error:
        logging.getLogger(__name__).warning("cannot read equation: %s", error, location=node)
        text = translator.encode(node.astext())
    translator.body.append(f'<div class="equation">{text}</div>' if block else text)
    raise nodes.SkipNode


def _readable(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Turn a docstring, which is written to be read as it stands, into reStructuredText."""
    lines[:] = [line.replace("|", r"\|") for line in _with_literal_blocks(lines)]
    # napoleon takes what precedes a colon in a field's docstring for its type.
    if what not in ("attribute", "data", "property"):
        style = Config(napoleon_use_ivar=True)
        lines[:] = GoogleDocstring(lines, style, app, what, name, obj, options).lines()


def _with_literal_blocks(lines: list[str]) -> Iterator[str]:
    """Mark what is indented after an empty line as code, or as a table of its author's."""
    inside = False
    for before, line in itertools.pairwise(["", *lines]):
        indented = line.startswith("    ")
        if indented and not before and not inside:
            yield from ("::", "")
        inside = indented or (inside and not line)
        yield line


def _with_tables(app: Sphinx, name: str, content: list[str]) -> None:
    """Make the tables of the reference anew from the code."""
    content[0] = make_reference.written(content[0])


def _linked_from_the_site(app: Sphinx, name: str, content: list[str]) -> None:
    """Let links to Markdown outside of docs/, which a git host shows, lead to the file."""
    content[0] = re.sub(r"\]\((?=(\.\./)+[A-Z]+\.md\))", "](path:", content[0])


def _short_signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str | None, result: Any
) -> tuple[str | None, Any]:
    """Write numpy's aliases by their names: ArrayLike alone is a union of half a page."""
    for alias, expanded in _ALIASES.items():
        signature = signature and signature.replace(expanded, alias)
        result = result and result.replace(expanded, alias)
    return signature, result


def setup(app: Sphinx) -> None:
    """Tell Sphinx about links, docstrings, signatures and equations."""
    app.connect("source-read", _with_tables)
    app.connect("source-read", _linked_from_the_site)
    app.connect("autodoc-process-docstring", _readable)
    app.connect("autodoc-process-signature", _short_signature)
    app.add_html_math_renderer("mathml", (_mathml, None), (_mathml, None))

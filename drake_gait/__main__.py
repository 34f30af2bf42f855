"""The commands of drake_gait: `python -m drake_gait COMMAND ...`, or `drake-gait COMMAND ...`.

`python -m drake_gait COMMAND --help` tells of one of them.
"""

from drake_gait.cli._signals import begin, leave

if __name__ == "__main__":
    begin()  # Before the slow imports.

import ast
import difflib
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.resources import files

from drake_gait import __version__
from drake_gait.cli._command import conduct
from drake_gait.errors import SettingsError

COMMANDS = (
    "optimize",
    "sweep",
    "replay",
    "report",
    "studies",
    "export",
    "play",
    "overlay",
    "identify",
    "check",
)
"""Modules of `cli` that are commands."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names, or list them; returns the exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] in COMMANDS:
        status: int = import_module(f"drake_gait.cli.{words[0]}").main(words[1:])
        return status
    return conduct(lambda: _tell(words))


def script() -> None:
    """Be the program `drake-gait`."""
    begin()
    leave(main())


def _tell(words: Sequence[str]) -> None:
    """List the commands, or refuse a word that names none."""
    if words == ["--version"]:
        print(f"drake_gait {__version__}")
        return
    if words and words[0] not in ("-h", "--help"):
        near = difflib.get_close_matches(words[0], COMMANDS, n=1, cutoff=0.0)[0]
        raise SettingsError(
            f"no command is called '{words[0]}'; the nearest is '{near}' of {', '.join(COMMANDS)}"
        )
    print("usage: python -m drake_gait COMMAND ...\n")
    width = max(map(len, COMMANDS))
    for name in COMMANDS:
        print(f"  {name:<{width}}  {_summary(name)}")
    print("\n`python -m drake_gait COMMAND --help` tells of one of them.")


def _summary(name: str) -> str:
    """Return the first words of a command's help, without the seconds that importing it takes."""
    source = (files("drake_gait.cli") / f"{name}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition(":")[0]


if __name__ == "__main__":
    leave(main())

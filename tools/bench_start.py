"""Measure the time until a command line is answered, and the heavy libraries that it loads.

    python tools/bench_start.py
    python tools/bench_start.py report none

Without words it measures the package's import, the helps and some mistakes; else one command line.
The times are the best of several runs. The longest import is by `python -X importtime`.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence

HEAVY = ("torch", "pydrake", "matplotlib", "scipy", "sklearn", "cmaes", "distributed", "jinja2")

IMPORT = ["-c", "import drake_gait"]
COMMAND = ["-m", "drake_gait"]
LINES = (
    ["--help"],
    ["optimise"],
    ["optimize", "--help"],
    ["optimize", "--seed", "x"],
    ["optimize", "none.toml"],
    ["sweep", "none.toml"],
    ["replay", "none", "--live"],
    ["report", "none"],
    ["studies", "show", "none"],
    ["export", "none", "--csv", "-"],
)
"""Command lines that should be answered at once."""

_IMPORTED = re.compile(r"import time:\s+(\d+) \|\s+(\d+) \|\s+(\S+)")


def seconds(command: Sequence[str]) -> tuple[float, float]:
    """Run a command; returns its wall time and its CPU time [s]."""
    before, start = os.times(), time.perf_counter()
    subprocess.run([sys.executable, *command], check=False, capture_output=True)
    wall, after = time.perf_counter() - start, os.times()
    used = after.children_user + after.children_system
    return wall, used - before.children_user - before.children_system


def imports(command: Sequence[str]) -> tuple[list[str], str]:
    """Run a command; returns the heavy libraries that it loads, and its longest import."""
    ended = subprocess.run(
        [sys.executable, "-X", "importtime", *command], check=False, capture_output=True, text=True
    )
    found = {name: int(own) for own, _, name in _IMPORTED.findall(ended.stderr)}
    longest = max(found, key=lambda name: found[name])
    loaded = [name for name in HEAVY if name in found]
    return loaded, f"{longest} ({1e-3 * found[longest]:.0f} ms)"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5, metavar="N", help="runs of each (5)")
    parser.add_argument(
        "words", nargs=argparse.REMAINDER, help="one command line, without its name"
    )
    options = parser.parse_args()
    lines = [options.words] if options.words else list(LINES)
    commands = {f"drake-gait {' '.join(words)}": [*COMMAND, *words] for words in lines}
    if not options.words:
        commands = {"import drake_gait": IMPORT, **commands}
    print(f"{'':<32} wall [s]  CPU [s]  heavy libraries; longest import")
    for name, command in commands.items():
        wall, used = (
            min(times)
            for times in zip(*(seconds(command) for _ in range(options.runs)), strict=True)
        )
        loaded, longest = imports(command)
        print(f"{name:<32} {wall:8.2f} {used:8.2f}  {', '.join(loaded) or 'none'}; {longest}")


if __name__ == "__main__":
    main()

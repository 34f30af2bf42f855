"""`python -m drake_gait COMMAND`, the same as `drake-gait COMMAND`."""

import sys
from importlib import import_module

from drake_gait.cli._signals import ctrl_c_ends_at_once, leave

COMMANDS = ("optimize", "sweep", "replay", "report", "studies", "export")


def main() -> None:
    """Run the command that the command line names."""
    ctrl_c_ends_at_once()  # Before the slow imports.
    if len(sys.argv) < 2 or sys.argv[1] not in COMMANDS:
        sys.stderr.write(f"usage: python -m drake_gait {{{','.join(COMMANDS)}}} ...\n")
        sys.exit(0 if sys.argv[1:2] in (["-h"], ["--help"]) else 2)
    leave(import_module(f"drake_gait.cli.{sys.argv[1]}").main(sys.argv[2:]))


if __name__ == "__main__":
    main()

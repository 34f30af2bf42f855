"""`python -m drake_gait COMMAND`, the same as `drake-gait COMMAND`."""

import runpy
import sys

COMMANDS = ("optimize", "sweep", "replay", "report", "studies", "export")

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in COMMANDS:
        sys.stderr.write(f"usage: python -m drake_gait {{{','.join(COMMANDS)}}} ...\n")
        sys.exit(0 if sys.argv[1:2] in (["-h"], ["--help"]) else 2)
    command = sys.argv.pop(1)
    runpy.run_module(f"drake_gait.cli.{command}", run_name="__main__", alter_sys=True)

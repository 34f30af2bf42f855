"""`python -m drake_gait.optimize`, the same as `drake-gait optimize`."""

from drake_gait.cli._signals import begin, leave

if __name__ == "__main__":
    begin()  # Before the slow imports.

from drake_gait.cli.optimize import main

if __name__ == "__main__":
    leave(main())

"""`python -m drake_gait.optimize`, the same as `drake-gait optimize`."""

from drake_gait.cli._signals import ctrl_c_ends_at_once

if __name__ == "__main__":
    ctrl_c_ends_at_once()  # Before the slow imports.

from drake_gait.cli._signals import leave
from drake_gait.cli.optimize import main

if __name__ == "__main__":
    leave(main())

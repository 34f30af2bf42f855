"""Quantities of a user's own: a Python file that declares them."""

from pathlib import Path

from drake_gait.errors import SettingsError
from drake_gait.files.python import run
from drake_gait.problem import BUILT_IN, Quantity

_MODULE = "_drake_gait_quantities"
"""Name of the file as a module. Nobody can import it: workers get its functions by value."""


def load_quantities(path: Path) -> tuple[Quantity, ...]:
    """Return the quantities that a Python file declares; it is run for that.

    Args:
        path: The file. Each Quantity among its names counts, in their order.

    Raises:
        SettingsError: it cannot be run, or declares none; names the file.
    """
    if not path.is_file():
        raise SettingsError(f"no file of quantities {path}; give study.quantities another path")
    module = run(path, module=_MODULE, what="file of quantities")
    found = {
        one.name: one
        for one in vars(module).values()
        if isinstance(one, Quantity) and one is not BUILT_IN.get(one.name)
    }
    if not found:
        raise SettingsError(
            f'the file of quantities {path} declares none; write NAME = Quantity(name="...", ...)'
        )
    return tuple(found.values())

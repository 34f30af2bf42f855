"""Python files of a user's own, run for what they declare."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from drake_gait.errors import SettingsError


def run(path: Path, *, module: str, what: str, content: bytes | None = None) -> ModuleType:
    """Run a Python file, and return the module that it makes.

    Nobody can import the module afterwards: workers get its functions and classes by value.

    Args:
        path: The file.
        module: Name of the module.
        what: What the file is, for messages: "file of quantities".
        content: Content of the file, where it was read before.

    Raises:
        SettingsError: it is no Python, or cannot be run; names the file.
    """
    spec = spec_from_file_location(module, path)
    if spec is None or spec.loader is None:
        raise SettingsError(f"the {what} {path} must be Python, with the ending .py")
    made = module_from_spec(spec)
    sys.modules[module] = made  # Dataclasses look their module up.
    try:
        text = path.read_bytes() if content is None else content
        exec(compile(text, path, "exec"), made.__dict__)
    except Exception as error:
        raise SettingsError(
            f"the {what} {path} cannot be run: {type(error).__name__}: {error}"
        ) from error
    finally:
        del sys.modules[module]
    return made

"""Studies that come with the package: `studies/best.toml` and others, from any folder."""

from importlib.resources import files
from pathlib import Path

FOLDER = "studies"
"""Where they are, in a checkout and in an installed package."""


def shipped_folder() -> Path:
    """Return where these studies are: in an installed package, or beside it in a checkout."""
    package = Path(str(files("drake_gait")))
    inside = package / FOLDER
    return inside if inside.is_dir() else package.parent / FOLDER


def find(path: Path) -> Path:
    """Return a path, or what it names in the package where it begins with `studies/`.

    What is in the current folder comes first.
    """
    if path.parts[:1] != (FOLDER,) or path.exists():
        return path
    ours = shipped_folder().joinpath(*path.parts[1:])
    return ours if len(path.parts) > 1 and ours.exists() else path

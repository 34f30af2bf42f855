"""Identity of the code: versions of libraries and fingerprints of files, which decide a walk."""

import hashlib
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def versions() -> dict[str, str]:
    """Versions of what decides the numbers."""
    found = {"python": platform.python_version()}
    for package in ("drake-gait", "drake", "mujoco", "numpy", "scipy", "torch"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def file_sha256(path: Path) -> str:
    """Fingerprint of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@lru_cache(maxsize=1)
def source_sha256() -> str:
    """Fingerprint of this package's source, as it was when this was first asked for."""
    folder = Path(__file__).parent
    sources = sorted(folder.rglob("*.py"))
    digests = "".join(
        f"{path.relative_to(folder).as_posix()} {file_sha256(path)}\n" for path in sources
    )
    return hashlib.sha256(digests.encode()).hexdigest()

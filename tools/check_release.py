"""Build the wheel and the sdist, and run the quick tests on them in a bare virtual environment.

    python tools/check_release.py
    python tools/check_release.py --keep -- -k wheel

The wheel is built from the sdist, and both are left in dist/. A new environment gets the wheel with
the extra `dev`, and the tests of the unpacked sdist run on the installed package. What follows `--`
goes to pytest.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]

_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""As the Makefile has it: the tests run on all cores."""

_WHERE = "import drake_gait, sys; print(drake_gait.__file__.startswith(sys.prefix))"
_PACKAGES = "import sysconfig; print(sysconfig.get_path('purelib'))"


def build(folder: Path) -> tuple[Path, Path]:
    """Build the sdist, and the wheel from it, into a folder; returns both."""
    shutil.rmtree(folder, ignore_errors=True)
    _run([sys.executable, "-m", "build", "--outdir", folder, ROOT])
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return sdist, wheel


def install(wheel: Path, folder: Path) -> Path:
    """Install the wheel with the tests' libraries into a new environment; returns its Python."""
    _run([sys.executable, "-m", "venv", "--clear", folder])
    python = folder / "bin" / "python"
    constraints = ["--constraint", ROOT / "constraints.txt"]
    _run([python, "-m", "pip", "install", "--quiet", *constraints, f"{wheel}[dev]"])
    return python


def check(sdist: Path, python: Path, folder: Path, arguments: Sequence[str]) -> None:
    """Run the quick tests of an sdist on the package that is installed beside a Python."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    source = folder / sdist.name.removesuffix(".tar.gz")
    # Workers import functions of `tests`. The installed package comes before the sdist's own one,
    # as Python's safe path has no current folder.
    packages = subprocess.run([python, "-c", _PACKAGES], check=True, capture_output=True, text=True)
    (Path(packages.stdout.strip()) / "sdist.pth").write_text(f"{source}\n", encoding="utf-8")
    environment = {**os.environ, **_ONE_THREAD, "PYTHONSAFEPATH": "1"}
    environment.pop("PYTHONPATH", None)
    told = subprocess.run(
        [python, "-c", _WHERE], cwd=source, env=environment, check=True, capture_output=True
    )
    if told.stdout.split() != [b"True"]:
        sys.exit("the tests would not run on the installed package")
    _run([python.with_name("drake-gait"), "--version"], cwd=source, env=environment)
    tests = ["--numprocesses", "logical", "--dist", "loadfile", "-m", "not slow", *arguments]
    _run([python, "-m", "pytest", *tests], cwd=source, env=environment)


def main() -> None:
    """Build, install, test."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", action="store_true", help="leave the environment, and say where")
    parser.add_argument("arguments", nargs="*", metavar="-- ARGUMENT", help="of pytest")
    options = parser.parse_args()
    sdist, wheel = build(ROOT / "dist")
    folder = Path(tempfile.mkdtemp(prefix="drake-gait-"))
    try:
        check(sdist, install(wheel, folder / "venv"), folder, options.arguments)
    finally:
        if options.keep:
            print(f"kept: {folder}")
        else:
            shutil.rmtree(folder)


def _run(command: Sequence[str | Path], **options: object) -> None:
    print("+", *command, flush=True)
    ended = subprocess.run([str(word) for word in command], check=False, **options)
    if ended.returncode:
        sys.exit(ended.returncode)


if __name__ == "__main__":
    main()

"""What decides a walk's numbers, as text."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np

import drake_gait
from drake_gait.provenance import file_sha256, source_sha256, versions


def test_the_versions_are_those_of_what_decides_the_numbers():
    found = versions()
    assert set(found) == {"python", "drake-gait", "drake", "mujoco", "numpy", "scipy", "torch"}
    assert found["numpy"] == np.__version__


def test_a_fingerprint_is_the_sha256_of_the_file(tmp_path):
    path = tmp_path / "robot.sdf"
    path.write_bytes(b"<sdf/>\n")
    assert file_sha256(path) == hashlib.sha256(b"<sdf/>\n").hexdigest()
    before = file_sha256(path)
    path.write_bytes(b"<sdf />\n")
    assert file_sha256(path) != before


def test_the_fingerprint_of_the_source_is_that_of_a_copy_until_one_line_changes(tmp_path):
    copy = tmp_path / "drake_gait"
    copy.mkdir()
    package = Path(drake_gait.__file__).parent
    for path in package.rglob("*.py"):
        target = copy / path.relative_to(package)
        target.parent.mkdir(exist_ok=True)
        target.write_bytes(path.read_bytes())

    def fingerprint_of_copy():
        code = "from drake_gait.provenance import source_sha256; print(source_sha256())"
        return subprocess.run(
            [sys.executable, "-c", code],
            check=True,
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={"PYTHONPATH": str(tmp_path)},
        ).stdout.strip()

    assert fingerprint_of_copy() == source_sha256()
    with (copy / "gait.py").open("a") as gait:
        gait.write("# changed\n")
    assert fingerprint_of_copy() != source_sha256()

"""A study whose driver is killed again and again."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import numbers

from drake_gait.study.store import Study

KILLER = """
import json, os, pickle, signal, sys, time
from pathlib import Path

import numpy as np
from conftest import Ground, run
from drake_gait.study.store import Study

folder = Path(sys.argv[1])
settings = pickle.loads((folder / "settings").read_bytes())


class Noted(Ground):
    # Computes walks, slowly, and leaves one byte for each.
    def __call__(self, trials):
        for finished in super().__call__(trials):
            time.sleep(0.004)
            os.write(self.log, b".")
            yield finished


def driver(path):
    # Forked, so that one start pays for all imports.
    process = os.fork()
    if process == 0:
        ground = Noted(settings.space)
        ground.log = os.open(path.with_suffix(".log"), os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
        run(settings, path, ground)
        os._exit(0)
    return process


def walks(path):
    if not path.exists():
        return 0
    with Study.open(path) as study:
        return len(study.walks())


def simulated(path):
    log = path.with_suffix(".log")
    return log.stat().st_size if log.exists() else 0


start = time.monotonic()
assert os.waitpid(driver(folder / "whole.db"), 0)[1] == 0
duration = time.monotonic() - start
rng = np.random.default_rng(0)
kills, number, runs = 0, 0, []
while True:
    path = folder / f"killed-{number}.db"
    before = walks(path)
    path.with_suffix(".log").unlink(missing_ok=True)
    process = driver(path)
    if kills < 20:
        time.sleep(rng.uniform(0.0, 0.3) * duration)
        os.kill(process, signal.SIGKILL)
    _, status = os.waitpid(process, 0)
    assert status in (0, signal.SIGKILL)
    runs.append([status, before, simulated(path), walks(path)])
    kills += status != 0
    if status == 0 and kills < 20:
        number += 1
    elif status == 0:
        break
print(json.dumps(runs))
"""


@pytest.mark.slow
def test_a_study_killed_at_twenty_random_moments_is_the_same_walk_for_walk(study, tmp_path):
    (tmp_path / "settings").write_bytes(pickle.dumps(study))
    here = Path(__file__).parent
    killer = subprocess.run(
        [sys.executable, "-c", KILLER, tmp_path],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        env={
            **os.environ,
            "PYTHONPATH": f"{here.parents[1]}:{here.parent}",
            "OMP_NUM_THREADS": "1",
        },
    )
    runs = json.loads(killer.stdout)
    killed = [run for run in runs if run[0] != 0]
    assert len(killed) == 20
    # In the midst of it, not only before the first walk and after the last.
    assert sum(0 < after < study.search.simulations for *_, after in killed) >= 10
    for status, before, simulated, after in runs:
        # What was simulated was missing, and is kept; a kill may come between the two.
        assert after - before in ((simulated, simulated - 1) if status else (simulated,))
    with Study.open(tmp_path / "whole.db") as whole:
        expected = numbers(whole.walks())
    for path in tmp_path.glob("killed-*.db"):
        with Study.open(path) as study_file:
            assert numbers(study_file.walks()) == expected

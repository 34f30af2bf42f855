"""Soak a study: kill its workers again and again, and count its walks.

    python tools/soak.py [--walks N] [--every SECONDS] [--workers N] [--out DIR]

The default study runs. Every so many seconds one of its workers, at random, is killed by SIGKILL,
as a system without memory does. The deaths that the study counts are compared with the kills. Exit
status 1 if a walk is missing or was given up for a kill.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

from drake_gait.study.ranking import search_walks
from drake_gait.study.store import Study
from drake_gait.walk import Outcome


def main() -> int:
    """Run the tool."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--walks", type=int, default=2000, help="walks of the study (2000)")
    parser.add_argument("--every", type=float, default=20.0, help="time between kills [s] (20)")
    parser.add_argument("--workers", type=int, default=2, help="worker processes (2)")
    parser.add_argument("--out", type=Path, default=Path("runs/soak"), help="the study's folder")
    options = parser.parse_args()
    command = [sys.executable, "-m", "drake_gait.optimize", "--workers", str(options.workers)]
    command += ["--simulations", str(options.walks), "--out", str(options.out)]
    start = time.monotonic()
    driver = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    kills = kill_workers(driver, options.every)
    seconds = time.monotonic() - start
    with Study.open(options.out / "study.db") as study:
        walks, deaths = study.walks(), study.description()["worker_deaths"]
    given_up = Counter(walk.walk.reason for walk in walks if walk.walk.outcome is Outcome.DIVERGED)
    searched = len(search_walks(walks))
    print(f"exit status {driver.returncode} after {seconds:.0f} s")
    print(f"walks: {searched} of {options.walks}, and {len(walks) - searched} confirmations")
    print(f"workers killed: {kills}; died in the midst of a walk: {sum(deaths.values())} {deaths}")
    print(f"walks given up: {sum(given_up.values())} {dict(given_up)}")
    killed = any("its process died" in reason for reason in given_up)
    return int(driver.returncode != 0 or searched != options.walks or killed)


def kill_workers(driver: "subprocess.Popen[bytes]", every: float) -> int:
    """Kill a worker every so many seconds until the driver ends; how many were killed."""
    rng, kills = random.Random(0), 0
    while True:
        try:
            driver.wait(every)
        except subprocess.TimeoutExpired:
            workers = children(driver.pid)
            if workers:
                os.kill(rng.choice(workers), signal.SIGKILL)
                kills += 1
        else:
            return kills


def children(process: int) -> list[int]:
    """Ids of the living processes that a process has started (Linux)."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = path.read_text().rpartition(")")[2].split()[:2]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(parent) == process and state != "Z":
            found.append(int(path.parent.name))
    return sorted(found)


if __name__ == "__main__":
    sys.exit(main())

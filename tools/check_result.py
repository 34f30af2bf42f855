"""Walk a study's winner again, finer and perturbed: `python tools/check_result.py RESULT.json ...`.

One walk at reference fidelity, and eight at search fidelity with every coefficient changed by a
normal number of 0.05 degrees: what a single walk of a search is worth.
"""

import argparse
import functools
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_gait.foot import FootDesign
from drake_gait.gait import Gait
from drake_gait.problem import Candidate, assess
from drake_gait.result import in_words
from drake_gait.settings import StudySettings, study_settings
from drake_gait.simulation import simulate
from drake_gait.store import Study
from drake_gait.walk import Fidelity
from drake_gait.workers import LocalProcesses

PERTURBED, DEVIATION = 8, 0.05  # walks, degrees


def check(path: Path, workers: int) -> None:
    """Print the winner of one result.json as it walks nominally, finer and perturbed."""
    result = json.loads(path.read_text())
    with Study.open(path.parent / "study.db") as study:
        settings: StudySettings = study_settings(study.description()["settings"])
    degrees = np.array(result["coefficients_deg"])
    candidate = Candidate(gait=Gait.from_degrees(degrees), foot=FootDesign(**result["foot"]))
    rng = np.random.default_rng(0)
    perturbed = [
        replace(
            candidate, gait=Gait.from_degrees(degrees + DEVIATION * rng.standard_normal((4, 4)))
        )
        for _ in range(PERTURBED)
    ]
    reference = replace(settings.walk, fidelity=Fidelity.REFERENCE)
    fine = simulate(candidate, reference)
    with LocalProcesses(
        functools.partial(simulate, settings=settings.walk), count=workers
    ) as processes:
        walks = [finished.walk for finished in processes.run(perturbed)]
    survived = [1e3 * walk.forward for walk in walks if walk.survived]
    feasible = sum(assess(walk, settings.constraints).feasible for walk in walks)
    print(f"{path}")
    print(f"  nominal    {in_words(simulate(candidate, settings.walk))}")
    print(f"  reference  {in_words(fine)}, {fine.outcome}")
    print(
        f"  perturbed  {len(survived)} of {PERTURBED} survive, {feasible} feasible, Z median "
        f"{np.median(survived) if survived else np.nan:.1f} mm, "
        f"least {min(survived, default=np.nan):.1f} mm"
    )


def main() -> None:
    """Check every result that is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULT.json")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args()
    for path in options.results:
        check(path, options.workers)


if __name__ == "__main__":
    main()

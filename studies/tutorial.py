"""From a first gait to a co-designed foot: `python studies/tutorial.py`, about three minutes.

docs/tutorial/gait_to_foot.md explains what it prints. tutorial.ipynb has the same cells, for
Jupyter. The smallest budget, `--samples 28 --simulations 30 --confirmations 8`, takes half a minute
and teaches nothing.
"""

# %% Budget and folder. A notebook takes the defaults below: change them here.
import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_gait import (
    Candidate,
    Fidelity,
    FootDesign,
    Gait,
    Study,
    StudyResult,
    StudySettings,
    assess,
    default_study,
    read_study,
    record,
    run_study,
    simulate,
    write_report,
)
from drake_gait.foot import N_MM_PER_DEG
from drake_gait.gait import WAVEFORMS
from drake_gait.report.result import in_words
from drake_gait.search.proposer import training_data
from drake_gait.study.ranking import best_walk, feasible_walks
from drake_gait.surrogates.ensemble import fit
from drake_gait.visualization.walk import waveforms

parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0], allow_abbrev=False)
parser.add_argument("--out", type=Path, default=Path("runs/tutorial"), help="folder to write")
parser.add_argument("--samples", type=int, default=60, help="walks of each Latin hypercube")
parser.add_argument("--simulations", type=int, default=90, help="walks of each study in all")
parser.add_argument("--confirmations", type=int, default=16, help="walks of each tier, at most")
parser.add_argument("--seed", type=int, default=0, help="seed of both studies")
options, _ = parser.parse_known_args()  # A notebook has arguments of its own.
options.out.mkdir(parents=True, exist_ok=True)
overrides = {
    ("study", "seed"): options.seed,
    ("search", "samples"): options.samples,
    ("search", "simulations"): options.simulations,
    ("confirmation", "walks"): options.confirmations,
    ("confirmation", "reference_walks"): options.confirmations,
}
settings = read_study(default_study(), overrides)

# %% 1. One gait. The middle of the study's box, in degrees; what comes back is in SI units.
first = Candidate(gait=Gait.from_degrees(np.degrees(settings.space.centre).round(2)))
print("1. the first gait: a, b, c, d in degrees")
for name, row in zip(WAVEFORMS, first.gait.degrees, strict=True):
    print(f"   {name:<6} " + " ".join(f"{value:7.2f}" for value in row))
walk = simulate(first, settings.walk, history=True)
violations = assess(walk, settings.constraints).violations
named = zip(settings.constraints.names, violations, strict=True)
broken = ", ".join(f"{name} by {value:.2f}" for name, value in named if value > 0.0)
print(f"   {in_words(walk)}, {walk.outcome}; it breaks {broken or 'no limit'}")

# %% 2. Look at it. A recording for the browser, and what the joints did.
if walk.history is not None:
    record(walk, first, options.out / "first.html", caption="the tutorial's first gait")
    waveforms(walk.history, options.out / "first_waveforms.png")
    toes = np.degrees(walk.history.toes.max(axis=0))
    print(f"2. {options.out}/first.html; the toes bend up to {toes.round(1)} degrees")


# %% 3. Perturb it. Every coefficient changes by a normal number of 0.05 degrees.
def perturbed(candidate: Candidate, count: int = 8) -> str:
    """Return how a candidate walks with servos that are not quite true, in words."""
    rng = np.random.default_rng(0)
    walks = []
    for _ in range(count):
        noise = 0.05 * rng.standard_normal((4, 4))
        shaken = Gait.from_degrees(candidate.gait.degrees + noise)
        walks.append(simulate(Candidate(gait=shaken, foot=candidate.foot), settings.walk))
    forward = [1e3 * walk.forward for walk in walks if walk.survived]
    feasible = sum(assess(walk, settings.constraints).feasible for walk in walks)
    spread = f"Z {min(forward):.0f} to {max(forward):.0f} mm" if forward else "none walks"
    return f"{len(forward)} of {count} survive, {feasible} feasible, {spread}"


print(f"3. the first gait, perturbed: {perturbed(first)}")


# %% 4. A small study. A Latin hypercube around that gait, and a search.
def run(settings: StudySettings, folder: Path) -> StudyResult:
    """Run a study, or resume it, and write its report."""
    run_study(settings, folder)
    return write_report(folder)


found = run(settings, options.out / "gait")
print(f"4. {found.verdict}")

# %% 5. What the samples say. How many walk, and what a network learns from them.
with Study.open(options.out / "gait") as study:
    walks = study.walks()
samples = [walk for walk in walks if walk.stage == "design"]
feasible = feasible_walks(samples, settings.constraints)
survived = sum(walk.walk.survived for walk in samples)
print(f"5. of {len(samples)} samples {survived} walk, {len(feasible)} are feasible")
network = fit(*training_data(samples, settings.space, settings.outputs), seed=options.seed)
for name, train, heldout in zip(
    settings.outputs, network.r2_train, network.r2_heldout, strict=True
):
    print(f"   R² of {name:<11}  walks learnt from {train:5.2f}   held out {heldout:5.2f}")


# %% 6. What the search made of it. The furthest walk, and the one that was confirmed.
def robustness(result: StudyResult) -> str:
    """Return what a study's best walk is worth, in words."""
    if result.winner is None:
        return "the furthest; none was robust"
    first = result.finalists[0]
    return f"tier T{first.tier}: {first.feasible} of {first.of} perturbed feasible"


furthest = best_walk(walks, settings.constraints)
on_paper_foot = found.best
assert on_paper_foot is not None  # Of a study with walks.
print(f"6. best sample:  {in_words(best_walk(samples, settings.constraints).walk)}")
print(f"   furthest:     {in_words(furthest.walk)}")
print(f"   winner:       {in_words(on_paper_foot.walk)} ({robustness(found)})")

# %% 7. Open the foot. The same study also chooses springs and width of the big toe [SI].
ranges = (
    ("big_toe_stiffness", 0.1 * N_MM_PER_DEG, 2.6 * N_MM_PER_DEG),
    ("lesser_toes_stiffness", 0.05 * N_MM_PER_DEG, 1.3 * N_MM_PER_DEG),
    ("big_toe_width", 0.014, 0.040),
)
opened = replace(settings, name="codesign", space=replace(settings.space, foot_ranges=ranges))
designed = run(opened, options.out / "codesign")
codesigned = designed.best
assert codesigned is not None
print(f"7. winner:       {in_words(codesigned.walk)} ({robustness(designed)})")


# %% 8. Compare. Nominal, perturbed, and in the finer steps of the reference.
def foot_in_words(foot: FootDesign) -> str:
    """Return a foot's design as people write it."""
    return (
        f"big toe {1e3 * foot.big_toe_width:.1f} mm and "
        f"{foot.big_toe_stiffness / N_MM_PER_DEG:.2f} N·mm/deg, "
        f"lesser toes {foot.lesser_toes_stiffness / N_MM_PER_DEG:.2f} N·mm/deg"
    )


reference = replace(settings.walk, fidelity=Fidelity.REFERENCE)
print("8. compare")
for name, candidate in (
    ("first gait", first),
    ("paper's foot", on_paper_foot.candidate),
    ("co-designed", codesigned.candidate),
):
    print(f"   {name}: {foot_in_words(candidate.foot)}")
    print(f"      nominal    {in_words(simulate(candidate, settings.walk))}")
    print(f"      perturbed  {perturbed(candidate)}")
    fine = simulate(candidate, reference)
    print(f"      reference  {in_words(fine)}, {fine.outcome}")
print(f"recordings: {options.out}/first.html, gait/walk.html and codesign/walk.html")

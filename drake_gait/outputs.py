"""What a study leaves in its folder beside study.db: result.json, the recording, the figures."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait import figures, surrogate
from drake_gait.errors import StudyError
from drake_gait.problem import assess
from drake_gait.recording import leg_points, record
from drake_gait.result import in_words, summary
from drake_gait.search import best_walk, training_data
from drake_gait.settings import StudySettings
from drake_gait.simulation import simulate
from drake_gait.store import StudyWalk
from drake_gait.surrogate import Surrogate
from drake_gait.walk import Walk

STALL_TORQUE = 1.373
"""Limit drawn into the figure of torques [N·m]: 14.0 kgf·cm, KRS-2552 data."""


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """What was written, for a command to print."""

    result: dict[str, Any]
    """The content of result.json."""
    best: StudyWalk
    """The furthest feasible walk, or the one nearest to feasible."""
    replayed: Walk
    """The same walk, with its history and measures."""
    network: Surrogate | None
    """The network of all walks, if enough survived."""


def write_outputs(
    settings: StudySettings, walks: list[StudyWalk], folder: Path, *, wall_s: float
) -> Outputs:
    """Write result.json, walk.html and the figures of a study's walks into its folder.

    Raises:
        GaitError: a file cannot be written.
    """
    network = _network(settings, walks)
    best = best_walk(walks, settings.constraints)
    replayed = simulate(best.candidate, settings.walk, history=True)
    jumps = np.degrees(np.abs(best.candidate.gait.jumps)).max(axis=1)
    result = {
        **summary(settings, walks, network, wall_s=wall_s),
        "measures": asdict(replayed.measures) if replayed.measures else None,
        "jumps_deg": {"0.3 s": float(jumps[0]), "3.3 s": float(jumps[1])},
    }
    try:
        (folder / "result.json").write_text(json.dumps(result, indent=2) + "\n")
    except OSError as error:
        raise StudyError(f"cannot write {folder / 'result.json'}: {error.strerror}") from None
    _draw_walk(settings, best, replayed, folder)
    figures.convergence(
        [1e3 * walk.walk.forward if walk.walk.survived else np.nan for walk in walks],
        [assess(walk.walk, settings.constraints).feasible for walk in walks],
        folder / "convergence.png",
        samples=settings.search.samples,
    )
    if network is not None:
        _draw_network(network, folder / "network.png")
    return Outputs(result=result, best=best, replayed=replayed, network=network)


def _network(settings: StudySettings, walks: list[StudyWalk]) -> Surrogate | None:
    """The network that all walks of the study give, if enough survived."""
    x, outputs, survived = training_data(walks, settings.space)
    if survived.sum() < surrogate.FEWEST_SURVIVORS:
        return None
    return surrogate.fit(x, outputs, survived, seed=settings.seed)


def _draw_walk(settings: StudySettings, best: StudyWalk, replayed: Walk, folder: Path) -> None:
    """The recording, and the figures of one walk."""
    history, model = replayed.history, settings.walk.model
    if history is None:
        return
    caption = f"{settings.name}, walk {best.id}: {in_words(best.walk)}"
    record(replayed, best.candidate, folder / "walk.html", model=model, caption=caption)
    figures.waveforms(history, folder / "waveforms.png")
    figures.paths(history, folder / "paths.png")
    figures.ground_reaction(history, folder / "ground_reaction.png")
    figures.torques(history, folder / "torques.png", STALL_TORQUE)
    legs = leg_points(history, best.candidate, model=model)
    figures.postures(history, legs, folder / "postures.png")


def _draw_network(network: Surrogate, path: Path) -> None:
    units = np.array([1e3, 1e3, np.degrees(1.0), 1e3])
    shown = [("Z", "mm"), ("X", "mm"), ("R", "deg")]
    columns = slice(0, len(shown))
    figures.predicted_against_simulated(
        (network.targets * units)[:, columns],
        (network.fitted * units)[:, columns],
        (network.heldout * units)[:, columns],
        network.r2_train[columns].tolist(),
        network.r2_heldout[columns].tolist(),
        shown,
        path,
    )

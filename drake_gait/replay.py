"""Record a walk of a study again: `python -m drake_gait.replay RUN_DIR --walk ID --out FILE.html`.

The walk is simulated anew, as the study did, and written as one self-contained page.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from drake_gait.errors import GaitError, StudyError
from drake_gait.ranking import best_walk
from drake_gait.recording import record
from drake_gait.records import StudyWalk
from drake_gait.result import file_sha256, in_words
from drake_gait.robot import model_path
from drake_gait.settings import study_settings
from drake_gait.simulation import simulate
from drake_gait.store import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    summary, _, _ = (__doc__ or "").partition(":")
    parser = argparse.ArgumentParser(prog="python -m drake_gait.replay", description=summary)
    parser.add_argument("folder", type=Path, metavar="RUN_DIR", help="a study's folder")
    parser.add_argument("--walk", type=int, metavar="ID", help="its number (the best walk)")
    parser.add_argument("--out", type=Path, required=True, help="the page to write")
    options = parser.parse_args(arguments)
    try:
        _replay(options.folder, options.walk, options.out)
    except GaitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _replay(folder: Path, number: int | None, out: Path) -> None:
    with Study.open(folder / "study.db") as study:
        settings = study_settings(study.description()["settings"])
        study.require({"model_sha256": file_sha256(model_path(settings.walk.model))})
        walks = study.walks()
    if not walks:
        raise StudyError(f"{folder} has no walks yet")
    chosen = best_walk(walks, settings.constraints) if number is None else _find(walks, number)
    walk = simulate(chosen.candidate, settings.walk, history=True)
    caption = f"{settings.name}, walk {chosen.id}: {in_words(walk)}"
    record(walk, chosen.candidate, out, model=settings.walk.model, caption=caption)
    print(f"{out}: {caption}")
    if in_words(walk) != in_words(chosen.walk):
        print(
            f"warning: the study in {folder} has {in_words(chosen.walk)} for it; other versions or "
            "another processor walk otherwise",
            file=sys.stderr,
        )


def _find(walks: list[StudyWalk], number: int) -> StudyWalk:
    for walk in walks:
        if walk.id == number:
            return walk
    raise StudyError(f"no walk {number}; the study has walks {walks[0].id} to {walks[-1].id}")


if __name__ == "__main__":
    sys.exit(main())

"""The work of `optimize`: search a study, write its report and print its table."""

from pathlib import Path

from drake_gait.cli._table import show as show_table
from drake_gait.cli.progress import display
from drake_gait.execution.machine import default_workers
from drake_gait.optimization import open_study, search_study, workers_of
from drake_gait.report.build import check_outputs, write_outputs
from drake_gait.report.result import baselines_line, manner_in_words, r_squared_line
from drake_gait.report.tables import beside_the_paper, tiers
from drake_gait.search.loop import useful_workers
from drake_gait.study.ranking import search_walks
from drake_gait.study.robot import with_robot
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.surrogates.prediction import FEWEST_SURVIVORS


def work(settings: StudySettings, folder: Path, workers: int | None, dask: str | None) -> None:
    """Bring a study to its end, and write and print what came out."""
    workers = workers or default_workers(useful_workers(settings))
    for note in settings.notes:
        print(note)
    with open_study(settings, folder) as study:
        check_outputs(folder)
        if "finished" in study.description():
            print(
                f"{folder} is finished; more --simulations go on with it, another seed or --out "
                "starts another study"
            )
        else:
            walks = len(search_walks(study.walks()))
            with (
                display(settings, walks) as show,
                workers_of(settings, study, workers, dask=dask) as executor,
            ):
                search_study(settings, study, executor, show)
        _write_results(settings, study, folder)


def _write_results(settings: StudySettings, study: Study, folder: Path) -> None:
    """Write what the study's folder is to hold, and print the table."""
    walks, wall_s = study.walks(), study.description().get("wall_s", 0.0)
    written = write_outputs(with_robot(settings, study), walks, folder, wall_s=wall_s)
    searched = len(search_walks(walks))
    if written.network is not None:
        part = "all" if written.network.walks == searched else "the latest"
        told = f"network of {part} {written.network.walks} walks"
        print(f"{told}: {r_squared_line(written.network)}")
        print(baselines_line(written.result))
    else:
        print(
            f"no network: {written.result['survivors']} of {searched} walks survived, and it "
            f"needs {FEWEST_SURVIVORS}; move the box to gaits that walk, or let more be simulated"
        )
    print()
    show_table(beside_the_paper(walks, settings.constraints))
    print()
    if (walked_again := tiers(settings, walks)) is not None:
        show_table(walked_again)
    else:
        print("Walked again: none, as no candidate is feasible or [confirmation] has no walks left")
    print()
    print(written.result["verdict"])
    if written.best is not None and (manner := manner_in_words(written.best.walk)):
        print(f"how it walks: {manner}")
    print(f"{folder}: {', '.join(written.files)}")

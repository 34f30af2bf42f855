"""Make the pictures of the README, in docs/images: `python tools/make_readme_picture.py [RUN]`.

`walk.webp` shows the whole walk of a study's winner in motion. `walk.png` shows the robot at five
instants of the second cycle, with the phases of the paper's Fig. 12. The walk is simulated, its
recording is opened in Chromium, and Meshcat draws it. The study's own postures.png, paths.png and
network.png are copied in fewer bytes. Without a study, a gait that walks is shown. Nothing here is
imported by the package.
"""

import argparse
import base64
import io
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from drake_gait.cli._replay import choose
from drake_gait.errors import GaitError
from drake_gait.gait import FRAME_TIME, Gait
from drake_gait.problem import Candidate
from drake_gait.report.page import FIGURES
from drake_gait.simulation.simulate import simulate
from drake_gait.visualization.recording import record
from drake_gait.visualization.style import GAIT_PHASES, style
from drake_gait.visualization.walk import posture_frames
from drake_gait.walk import History, WalkSettings

IMAGES = Path(__file__).parents[1] / "docs" / "images"

# A gait that walks, when no result is given [deg].
COEFFICIENTS = ((0, -1.5, 3, 0), (13, -11, 8, 0), (16, -3, 14, 0), (8, 8, 8.5, 0))

STRIP_VIEW = (0.80, -1.00, 0.30)  # from the target to the camera [m]; from the right, ahead
STRIP_SIZE = (440, 720)  # width and height of one posture [pixel]
FILM_VIEW = (0.95, -1.10, 0.38)
FILM_SIZE = (480, 440)
FILM_EVERY = 4  # frames of 0.02 s from one picture of the film to the next

# Draws the walk at given instants and leaves each picture in the page, where it is read from.
SHOOT = """
<script>
  setTimeout(function shoot() {
    if (!(viewer.animator.duration > 0)) { setTimeout(shoot, 50); return; }
    viewer.animator.pause();
    for (const end of ["top_color", "bottom_color"]) {
      viewer.set_property(["Background", "<object>"], end, [1, 1, 1]);
    }
    for (const shot of @shots@) {
      viewer.animator.seek(shot.time);
      viewer.camera.zoom = 1;
      viewer.camera.position.set(...shot.camera);
      viewer.set_camera_target(shot.target);
      const picture = document.createElement("img");
      picture.className = "shot";
      picture.src = viewer.capture_image(...@size@);
      document.body.append(picture);
    }
  }, 50);
</script>
"""


OF_THE_STUDY = ("postures", "paths", "network")


def read_candidate(folder: Path | None) -> tuple[Candidate, WalkSettings]:
    """A study's winner and how it was simulated, or the default."""
    if folder is None:
        return Candidate(gait=Gait.from_degrees(COEFFICIENTS)), WalkSettings()
    _, chosen, as_then = choose(folder, None)
    return chosen.candidate, as_then


def few_colours(picture: Image.Image) -> Image.Image:
    """A palette is a third of the size; an octree keeps the few saturated pixels of the toes."""
    return picture.convert("RGB").quantize(256, method=Image.Quantize.FASTOCTREE)


def save_figures(folder: Path, out: Path) -> None:
    """The study's own figures."""
    for name in OF_THE_STUDY:
        path = folder / FIGURES / f"{name}.png"
        if not path.is_file():
            raise SystemExit(f"there is no {path}; `python -m drake_gait report {folder}` draws it")
        few_colours(Image.open(path)).save(out / path.name, optimize=True)
        tell(out / path.name)


def tell(path: Path) -> None:
    """Say what was written."""
    print(f"wrote {path} ({path.stat().st_size / 1e3:.0f} kB)", flush=True)


def browser() -> str:
    """The Chromium on the PATH."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if path := shutil.which(name):
            return path
    raise SystemExit("this tool needs Chromium; install it and put it on the PATH")


def three(p_W: np.ndarray) -> list[float]:
    """A point of the world (z up) as Meshcat's camera takes it (y up)."""
    x, y, z = (float(value) for value in p_W)
    return [x, z, -y]


def shots(
    page: str,
    times: list[float],
    targets: np.ndarray,
    view: tuple[float, ...],
    size: tuple[int, int],
) -> list[Image.Image]:
    """Pictures of a recording at times [s], looking at targets [m], shape (n, 3)."""
    wanted = [
        {"time": time, "target": three(target), "camera": three(target + view)}
        for time, target in zip(times, targets, strict=True)
    ]
    script = SHOOT.replace("@shots@", json.dumps(wanted)).replace("@size@", json.dumps(size))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.html"
        path.write_text(page.replace("</body>", script + "</body>"), encoding="utf-8")
        command = [
            browser(),
            "--headless",
            "--no-sandbox",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--disable-background-networking",
            "--disable-sync",
            "--no-first-run",
            f"--user-data-dir={folder}/profile",
            "--virtual-time-budget=10000",
            "--dump-dom",
            path.as_uri(),
        ]
        document = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found = re.findall(r'<img class="shot" src="data:image/png;base64,([^"]+)"', document)
    if len(found) != len(times):
        raise SystemExit(f"Chromium drew {len(found)} pictures of {len(times)}")
    return [Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB") for data in found]


def camera_targets(history: History, times: list[float], *, glides: bool) -> np.ndarray:
    """Return the points to look at [m], shape (n, 3): half-way up, at the centre of mass.

    A camera that glides goes from where it begins to where it ends at one speed.
    """
    if glides:
        share = np.array(times)[:, None] / history.time[-1]
        targets = history.com[0] + share * (history.com[-1] - history.com[0])
    else:
        targets = history.com[np.round(np.array(times) / FRAME_TIME).astype(int)]
    targets[:, 2] = 0.190
    return targets


def save_strip(page: str, history: History, path: Path) -> None:
    """Five postures side by side."""
    times = [FRAME_TIME * frame for frame in posture_frames(history)]
    pictures = shots(
        page, times, camera_targets(history, times, glides=False), STRIP_VIEW, STRIP_SIZE
    )
    with style():
        figure = Figure(figsize=(7.2, 2.75))
        FigureCanvasAgg(figure)
        panels = figure.subplots(1, len(pictures))
        figure.subplots_adjust(left=0.0, right=1.0, bottom=0.13, top=1.0, wspace=0.02)
        for axes, picture, time, (_, phase) in zip(
            panels, pictures, times, GAIT_PHASES, strict=True
        ):
            axes.imshow(picture, interpolation="lanczos")
            axes.set_axis_off()
            axes.text(
                0.5,
                -0.02,
                f"{time:.1f} s\n{phase}",
                transform=axes.transAxes,
                ha="center",
                va="top",
            )
        buffer = io.BytesIO()
        figure.savefig(buffer, dpi=200)
    few_colours(Image.open(buffer)).save(path, optimize=True)


def save_film(page: str, history: History, path: Path) -> None:
    """The whole walk in real time, looping."""
    times = [float(time) for time in history.time[::FILM_EVERY]]
    targets = camera_targets(history, times, glides=True)
    first, *others = shots(page, times, targets, FILM_VIEW, FILM_SIZE)
    first.save(
        path,
        save_all=True,
        append_images=others,
        loop=0,
        quality=50,
        method=4,
        duration=round(1e3 * FILM_EVERY * FRAME_TIME),
    )


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", metavar="RUN", help="a study's folder")
    parser.add_argument("--out", type=Path, default=IMAGES, help="folder (default: docs/images/)")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.folder is not None:
        save_figures(arguments.folder, arguments.out)
    candidate, settings = read_candidate(arguments.folder)
    walk = simulate(candidate, settings, history=True)
    if walk.history is None or not walk.survived:
        raise SystemExit(f"this walk is no picture for a README: {walk.reason}")
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "walk.html"
        record(walk, candidate, recording, model=settings.model)
        page = recording.read_text(encoding="utf-8")
    for name, save in (("walk.png", save_strip), ("walk.webp", save_film)):
        save(page, walk.history, arguments.out / name)
        tell(arguments.out / name)


if __name__ == "__main__":
    try:
        main()
    except GaitError as error:
        sys.exit(f"error: {error}")

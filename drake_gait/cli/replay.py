"""Show walks of a study: `python -m drake_gait replay RUN --out FILE.html`.

The best walk, or the one that --walk names, is simulated anew, as the study did. It becomes one
self-contained page; `--live` shows it in a browser while it is simulated. `--gallery` puts the best
walks of several studies side by side into one page, for example of several seeds. `--rigid-toes`
puts every walk beside itself on a foot whose toes cannot bend. `--engine both` puts its walk in
Drake beside that in MuJoCo.
"""

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

from drake_gait.cli._command import conduct, require_studies
from drake_gait.cli._signals import importing
from drake_gait.files.destination import check
from drake_gait.files.shipped import find


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """The options of the command line."""

    folder: Path
    """A study's folder."""
    walk: int | None
    """Number of its walk; the best one if None."""
    out: Path | None
    """The page to write."""
    gallery: list[Path] | None
    """Further folders, for a page of several walks."""
    rigid_toes: bool
    """Whether every walk of a gallery is beside itself on rigid toes."""
    engine: str | None
    """What simulates, or "both"; the study's own engine if None."""
    live: bool
    """Whether to show the walk while it is simulated."""
    port: int | None
    """Port of the page that shows it."""


def parse(arguments: Sequence[str] | None = None) -> Options:
    """Read the command line; exits with status 2 where it cannot."""
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait replay",
        description=summary.partition(":")[0],
        epilog=rest,
        allow_abbrev=False,
    )
    parser.add_argument("folder", type=Path, metavar="RUN", help="a study's folder")
    parser.add_argument("--walk", type=int, metavar="ID", help="its number (the best walk)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the page to write; - for stdout")
    parser.add_argument(
        "--gallery", type=Path, nargs="*", metavar="RUN", help="walks of these studies beside it"
    )
    parser.add_argument(
        "--rigid-toes", action="store_true", help="every walk also on toes that cannot bend"
    )
    parser.add_argument(
        "--engine", choices=("drake", "mujoco", "both"), help="what simulates it (the study's)"
    )
    parser.add_argument("--live", action="store_true", help="show it while it is simulated")
    parser.add_argument(
        "--port", type=int, metavar="N", help="port of the live page (the first free one)"
    )
    found = Options(**vars(parser.parse_args(arguments)))
    if found.live == (found.out is not None):
        parser.error("give --out FILE to write a page, or --live to watch")
    if found.port is not None and not (found.live and 1024 <= found.port <= 65535):
        parser.error(f"argument --port: is for --live, from 1024 to 65535, got {found.port}")
    if found.live and (found.gallery is not None or found.rigid_toes or found.engine == "both"):
        parser.error("--live shows one walk; --gallery, --rigid-toes and both need --out FILE")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _work(parse(arguments)))


def _work(options: Options) -> None:
    if options.out is not None:
        check(options.out, what="the recording ")
    require_studies(find(folder) for folder in (options.folder, *(options.gallery or [])))
    with importing():  # What a wrong input needs not wait for.
        from drake_gait.cli import _replay
    _replay.work(options)

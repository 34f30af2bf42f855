"""Laws of tools/draw_patches.py: the five phases of a step, found in any walk."""

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from drake_gait.gait import CYCLE_TIME


@pytest.fixture(scope="module")
def tool(repository: Path) -> ModuleType:
    """tools/draw_patches.py."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(repository / "tools")
        return importlib.import_module("draw_patches")


def seen(
    tool: ModuleType, number: int, load: float, ahead: float, rear: float, extent: float
) -> Any:
    """A print with these numbers, at an instant that its number says."""
    return tool.Print(
        time=CYCLE_TIME + 0.01 * number,
        load=load,
        ahead=ahead,
        rear=rear,
        extent=extent,
        outlines=[],
        faces=[],
        pressures=[],
        points=[],
        forces=[],
    )


def a_stance(tool: ModuleType) -> list[Any]:
    """A foot lands on its heel, is flat, rolls forward and leaves with its toes."""
    ahead = np.linspace(-30.0, 30.0, 13)
    extents = [0.0, 10.0, 50.0, 95.0, 100.0, 100.0, 100.0, 100.0, 90.0, 60.0, 30.0, 10.0, 0.0]
    loads = [0.0, 5.0, 20.0] + 8 * [14.0] + [3.0, 0.0]
    rears = 8 * [-0.1] + [0.2, 2.0, 5.0, 8.0, 9.0]
    rows = zip(loads, ahead, rears, extents, strict=True)
    return [seen(tool, number, *row) for number, row in enumerate(rows, 1)]


def test_phases_follow_the_load_the_centre_of_mass_and_the_rear_edge(tool: ModuleType) -> None:
    stance = a_stance(tool)
    strike, flat, middle, off, last = tool.phases(stance, weight=14.7)
    assert (strike, last) == (stance[1], stance[11])
    assert flat is stance[3]
    assert middle.ahead > 0.0 >= stance[stance.index(middle) - 1].ahead
    assert off.rear > 0.0 >= stance[stance.index(off) - 1].rear


@pytest.mark.parametrize("load", [0.0, 14.7])
def test_a_foot_that_never_lifts_or_never_lands_has_no_phases(
    tool: ModuleType, load: float
) -> None:
    still = [seen(tool, number, load, 0.0, 0.0, 0.0) for number in range(20)]
    with pytest.raises(SystemExit, match="no whole stance"):
        tool.phases(still, weight=14.7)

import dataclasses

import pytest

from drake_gait.foot import FootDesign
from drake_gait.problem import Constraints
from drake_gait.report import tables as report_tables
from drake_gait.report.tables import number
from drake_gait.study.search_settings import Mode
from drake_gait.walk import Outcome, Walk

FINALIST = {
    "walk": 7,
    "forward_mm": 300.0,
    "median_mm": 290.0,
    "worst_mm": -0.04,
    "survived": 8,
    "feasible": 7,
    "of": 8,
    "measures": {},
    "robust": True,
    "reference": {
        "outcome": "walked",
        "forward_mm": 288.0,
        "lateral_mm": 3.0,
        "yaw_deg": -2.0,
        "feasible": True,
    },
}


def fell(entry, walk_id, frame):
    walk = Walk(
        outcome=Outcome.FELL,
        frames=frame,
        forward=0.0,
        lateral=0.0,
        yaw=0.0,
        com_height=0.1,
        reason="fell",
    )
    return dataclasses.replace(entry, id=walk_id, walk=walk)


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.25, "1.2"), (-0.04, "0.0"), (-3.0, "−3.0"), (None, "–"), (float("nan"), "–")],
)
def test_numbers_for_people_have_a_minus_and_no_minus_zero(value, text):
    assert number(value, 1) == text


def test_failures_are_counted_by_the_cycle_they_happened_in(entry):
    lost = dataclasses.replace(entry, id=9, walk=Walk.diverged("solver: no convergence"))
    walks = [entry, fell(entry, 1, 10), fell(entry, 2, 59), fell(entry, 3, 60), lost]
    table = report_tables.failures(walks)
    assert [list(row) for row in table.rows] == [
        ["fell between 0.0 and 1.2 s", "2"],
        ["fell between 1.2 and 2.4 s", "1"],
        ["solver", "1"],
    ]


def test_a_search_without_failures_says_so(entry):
    assert list(report_tables.failures([entry]).rows) == [["none", "0"]]


def test_stages_add_up(entry, study):
    walks = [dataclasses.replace(entry, id=0, stage="design"), fell(entry, 1, 10), entry]
    rows = [list(row) for row in report_tables.stages(walks, study).rows]
    assert rows == [
        ["design of experiments", "1", "1", "1"],
        ["proposed by the network", "2", "1", "1"],
        ["all", "3", "2", "2"],
    ]


@pytest.mark.parametrize("mode", Mode)
def test_walks_are_said_to_be_proposed_by_what_proposed_them(entry, study, mode):
    search = dataclasses.replace(study.search, mode=mode)
    walks = [dataclasses.replace(entry, id=0, stage="design"), entry]
    table = report_tables.stages(walks, dataclasses.replace(study, search=search))
    names = " ".join(row[0] for row in table.rows)
    assert ("network" in names) == search.learns
    assert ("ISADE" in names) == (mode in (Mode.ISADE, Mode.ISADE_NETWORK, Mode.PAPER))
    assert ("CMA-ES" in names) == (mode is Mode.CMAES)


def test_the_furthest_feasible_walks_stand_beside_the_paper_s_eight(entry):
    walks = [
        dataclasses.replace(
            entry, id=place, walk=dataclasses.replace(entry.walk, forward=0.1 + place / 100)
        )
        for place in range(12)
    ]
    walks.append(fell(entry, 12, 100))
    rows = report_tables.beside_the_paper(walks, Constraints()).rows
    assert [row[1] for row in rows] == ["11", "10", "9", "8", "7", "6", "5", "4"]
    assert list(rows[0]) == [
        *("1", "11", "−3.33", "210.00", "1.86", "240"),
        *("F8", "0.04", "177.96", "1.20", "240"),
    ]
    alone = report_tables.beside_the_paper(walks[-1:], Constraints()).rows
    assert [row[6] for row in alone] == ["F8", "F7", "F6", "F5", "F4", "F3", "F2", "F1"]
    assert {cell for row in alone for cell in row[1:6]} == {"–"}


def test_finalists_are_listed_and_the_winner_is_marked():
    others = {**FINALIST, "walk": 3, "feasible": 5}
    early = {**FINALIST, "walk": 4, "of": 2, "survived": 2, "feasible": 0, "reference": None}
    result = {"finalists": [others, FINALIST, early], "winner": 7}
    table = report_tables.finalists(result)
    assert [row[0] for row in table.rows] == ["3", "7"]
    assert table.marked == 1
    assert list(table.rows[1]) == [
        *("7", "300.0", "290.0", "0.0", "8 of 8", "7 of 8", "T1", *("–",) * 6),
        *("walked", "288.0", "3.0", "−2.0", "yes"),
    ]
    dropped = report_tables.finalists(result, dropped=True)
    assert [row[0] for row in dropped.rows] == ["4"]
    assert dropped.marked is None
    assert list(dropped.rows[0][4:]) == ["2 of 2", "0 of 2"]  # no columns of a finer walk
    assert len(dropped.columns) == len(dropped.rows[0])


def test_a_finalist_s_tiers_are_told_and_one_that_was_tried_finer_is_not_among_the_dropped():
    converged = {"of": 8, "survived": 8, "feasible": 7, "median_mm": 281.0, "worst_mm": 270.0}
    servo = {"of": 16, "survived": 15, "feasible": 11, "median_mm": 270.0, "worst_mm": 3.0}
    entry = {**FINALIST, "tier": 2, "trusted_mm": 281.0, "converged": converged, "servo": servo}
    failed = {**entry, "walk": 8, "tier": 1, "trusted_mm": None, "servo": None, "reference": None}
    result = {"finalists": [entry, failed], "winner": 7}
    first, second = report_tables.finalists(result).rows
    assert list(first[6:11]) == ["T2", "281.0", "7 of 8", "15 of 16", "11 of 16"]
    assert list(second[6:11]) == ["T1", "281.0", "7 of 8", "–", "–"]
    assert report_tables.finalists(result, dropped=True) is None


def test_walks_elsewhere_are_told_as_parts_of_the_distance():
    sole = {"outcome": "walked", "of_distance": 0.934, "passed": True}
    short = {**sole, "of_distance": 0.6, "passed": False}
    fallen = {**short, "outcome": "fell"}
    for engine, told in ((None, "not installed"), (short, "60 %, fails"), (fallen, "fell")):
        entry = {**FINALIST, "other_sole": sole, "other_engine": engine}
        (row,) = report_tables.finalists({"finalists": [entry], "winner": 7}).rows
        assert list(row[11:13]) == ["93 %", told]


def test_without_a_winner_none_is_marked_and_without_finalists_there_is_no_table():
    assert report_tables.finalists({"finalists": [FINALIST], "winner": None}).marked is None
    assert report_tables.finalists({}) is None


def test_beside_the_finalists_stands_how_far_they_slide_and_swing(measures):
    measured = {"yaw_swing": 0.31, "measures": dataclasses.asdict(measures)}
    entries = [FINALIST, {**FINALIST, "walk": 9, **measured}]
    table = report_tables.manner_of_finalists({"finalists": entries, "winner": 9})
    assert [list(row) for row in table.rows] == [["9", "300.0", "3", "4", "18", "9", "1.43"]]
    assert table.marked == 0
    assert report_tables.manner_of_finalists({"finalists": [FINALIST], "winner": 7}) is None


def test_the_foot_is_told_in_the_paper_s_units():
    rows = {
        row[0]: list(row[1:]) for row in report_tables.foot(dataclasses.asdict(FootDesign())).rows
    }
    assert rows["big toe stiffness"] == ["0.52", "N·mm/deg"]
    assert rows["big toe width"] == ["22", "mm"]
    assert rows["rigid toes"] == ["no", ""]


def test_only_settings_that_differ_are_told(study):
    one = study.description()
    other = dataclasses.replace(study, seed=5).description()
    table = report_tables.differences(["a", "b"], [one, other])
    assert [list(row) for row in table.rows] == [["study.seed", "0", "5"]]
    assert report_tables.differences(["a", "b"], [one, one]) is None


def test_every_row_of_every_table_has_a_cell_for_every_column(entry, study):
    tables = [
        report_tables.beside_the_paper([entry], Constraints()),
        report_tables.coefficients(entry.candidate.gait.degrees.tolist()),
        report_tables.settings(study.description()),
        report_tables.finalists({"finalists": [FINALIST], "winner": 7}),
        report_tables.versions({"python": "3"}),
    ]
    for table in tables:
        assert {len(row) for row in table.rows} == {len(table.columns)}, table.caption


def test_the_network_s_table_has_the_baselines_beside_it():
    result = {
        "r2_train": {"forward": 0.9},
        "r2_heldout": {"forward": 0.5},
        "r2_heldout_ridge": {"forward": 0.25},
        "r2_heldout_kriging": {"forward": None},
    }
    table = report_tables.network(result)
    assert list(table.columns)[2:] == ["held out", "ridge, held out", "kriging, held out"]
    assert list(table.rows[0]) == ["Z, forward", "0.90", "0.50", "0.25", "–"]
    of_before = {key: result[key] for key in ("r2_train", "r2_heldout")}
    assert list(report_tables.network(of_before).rows[0])[3:] == ["–", "–"]

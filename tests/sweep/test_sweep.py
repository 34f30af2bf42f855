"""A sweep: its file, its table, and its command."""

import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from drake_gait.cli import _sweep as command
from drake_gait.cli import optimize
from drake_gait.cli.sweep import main, parse
from drake_gait.errors import SettingsError
from drake_gait.foot import N_MM_PER_DEG
from drake_gait.study._lock import driver_lock, is_driven
from drake_gait.sweep.results import read_row, summaries, table, write_results
from drake_gait.sweep.settings import read_sweep

HEAD = """
[sweep]
name = "toes"
question = "Do toes help?"
base = "{base}"
"""
SWEEP = (
    HEAD
    + """
seeds = [0, 7]
[common]
search.samples = 20
search.simulations = 24
[variants.toes]
[variants.rigid]
foot.rigid_toes = true
[variants.wide]
design.big_toe_width_mm = [30, 50]
search.samples = 22
"""
)


@pytest.fixture
def write(tmp_path, paper_study):
    def write(text, name="sweep.toml"):
        path = tmp_path / name
        path.write_text(text.replace("{base}", str(paper_study)))
        return path

    return write


# --- The file -------------------------------------------------------------------------------------


def test_a_sweep_is_every_variant_with_every_seed(write, tmp_path):
    sweep = read_sweep(write(SWEEP))
    assert (sweep.name, sweep.question) == ("toes", "Do toes help?")
    assert sweep.variants == ("toes", "rigid", "wide")
    assert [(study.variant, study.seed) for study in sweep.studies] == [
        (variant, seed) for seed in (0, 7) for variant in ("toes", "rigid", "wide")
    ]
    assert sweep.studies[4].folder(tmp_path) == tmp_path / "rigid" / "seed-7"


def test_a_variant_changes_what_it_says_and_nothing_else(write):
    toes, rigid, wide, *_ = read_sweep(write(SWEEP)).studies
    before = toes.settings.description()
    for study, changed in (
        (rigid, {"study.name", "foot.rigid_toes"}),
        (wide, {"study.name", "search.samples", "design.big_toe_width"}),
    ):
        after = study.settings.description()
        differing = {
            key for key in before.keys() | after.keys() if before.get(key) != after.get(key)
        }
        assert differing == changed
    assert before["search.simulations"] == 24
    assert wide.settings.name == "toes-wide"


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('name = "toes"', "", "needs a name"),
        ('base = "{base}"', "", "needs a base"),
        ("[sweep]", "[swep]", r"'swep'.*sweep, common"),
        ("seeds =", "seed =", ".sweep..*'seed'"),
        ("[0, 7]", "[0, 0]", r"sweep.seeds.*got \[0, 0\]"),
        ("[0, 7]", "[]", r"sweep.seeds.*got \[\]"),
        ("[0, 7]", "[true]", r"sweep.seeds.*got \[True\]"),
        ("[variants.rigid]", '[variants."../rigid"]', "must do as a folder's name"),
        ("[variants.rigid]", '[variants."a\\u0007b"]', "text that can be printed.*U\\+0007"),
        ("[variants.rigid]", '[variants.""]', "must do as a folder's name"),
        ("[variants.rigid]", f"[variants.{'x' * 300}]", "255 bytes at most.*'xxx.* has 300"),
        ("[variants.rigid]", f"[variants.'{'ä' * 151}']", "255 bytes at most.* has 302"),
        ("[variants.rigid]", "[variants.TOES]", "'TOES'.*toes"),
        ("[variants.rigid]", '[variants."sweep.json"]', "the sweep's sweep.json"),
        ("[variants.rigid]", "[variants.toes]", "is not TOML"),
        ("foot.rigid_toes", "foot.stiff_toes", r"\[foot\].*'stiff_toes'"),
        ("[30, 50]", "[30, 60]", r"big_toe_width_mm.*8 to 50 mm"),
        ("search.samples = 22", "search = 22", r"\[variants.wide.search\]"),
        ("[variants.", "[common.", "either"),
        ('base = "{base}"', 'base = "none.toml"', "cannot read study"),
        ("[0, 7]", "[0, 7", "is not TOML"),
    ],
)
def test_a_sweep_that_cannot_be_used_is_refused_in_one_line(write, old, new, complaint, capsys):
    assert old in SWEEP
    path = write(SWEEP.replace(old, new))
    with pytest.raises(SettingsError, match=complaint) as refusal:
        read_sweep(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert main([str(path)]) == 2
    assert capsys.readouterr().err == f"error: {refusal.value}\n"


def test_the_committed_sweeps_can_be_read(repository):
    found = {
        path.stem: read_sweep(path)
        for path in (repository / "studies").glob("*.toml")
        if "[sweep]" in path.read_text()
    }
    assert set(found) >= {
        "toe_codesign",
        "big_toe_ratio",
        "toes_or_rigid",
        "toe_stiffness",
        "energy",
    }
    assert all(sweep.name == name and sweep.question for name, sweep in found.items())
    ratios = [
        study.settings.space.foot.big_toe_width / 0.078 for study in found["big_toe_ratio"].studies
    ]
    named = [float(study.variant[6:].replace("_", ".")) for study in found["big_toe_ratio"].studies]
    assert ratios == pytest.approx(named, abs=0.005)
    grid = found["toe_stiffness"].grid
    assert len(found["toe_codesign"].studies) == 10
    # The paper's foot is one of the grid's.
    assert grid.settings.space.foot in [foot for row in grid.feet for foot in row]


GRID = (
    HEAD
    + """
[grid]
replicas = 2
noise_deg = 0.05
coefficients_deg = [[[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11], [12, 13, 14, 15]]]
[[grid.axes]]
name = "stiffness"
big_toe_stiffness_n_mm_per_deg = [0.1, 0.2, 0.4]
lesser_toes_stiffness_n_mm_per_deg = [0.05, 0.1, 0.2]
[[grid.axes]]
toe_damping_n_m_s_per_rad = [1e-4, 1e-3]
"""
)


def test_a_grid_has_a_foot_for_every_pair_of_levels(write):
    grid = read_sweep(write(GRID)).grid
    assert [axis.name for axis in grid.axes] == ["stiffness", "toe_damping_n_m_s_per_rad"]
    assert [len(row) for row in grid.feet] == [2, 2, 2]
    foot = grid.feet[2][1]
    assert foot.big_toe_stiffness == pytest.approx(0.4 * N_MM_PER_DEG)
    assert foot.lesser_toes_stiffness == pytest.approx(0.2 * N_MM_PER_DEG)
    assert foot.toe_damping == pytest.approx(1e-3)
    assert foot.big_toe_width == grid.settings.space.foot.big_toe_width


def test_a_grid_s_gaits_may_be_those_of_results(write, tmp_path):
    degrees = [[0, 1, 2, 3]] * 4
    (tmp_path / "result.json").write_text(json.dumps({"coefficients_deg": degrees}))
    path = write(GRID.replace("replicas = 2", 'replicas = 2\nresults = ["result.json"]'))
    grid = read_sweep(path).grid
    assert len(grid.gaits) == 2
    assert grid.gaits[1].degrees == pytest.approx(np.array(degrees, dtype=float))
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(SettingsError, match=r"result\.json"):
        read_sweep(path)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("replicas = 2", "replicas = 0", r"grid.replicas.*>= 1, got 0"),
        ("0.05\nc", "-1\nc", r"grid.noise_deg.*0 to 1"),
        ("coefficients_deg = [", "results = []#", "needs gaits"),
        ("[[0, 1, 2, 3], ", "[", r"shape \(4, 4\)"),
        ("[0.05, 0.1, 0.2]", "[0.05, 0.1]", "equally many values"),
        ("toe_damping_n_m_s_per_rad = ", "big_toe_stiffness_n_mm_per_deg = ", "both axes"),
        ("toe_damping_n_m_s_per_rad", "toe_dumping", ".foot..*'toe_dumping'"),
        (
            "[1e-4, 1e-3]",
            "[1e-4, 1]",
            r"foot\.toe_damping_n_m_s_per_rad must be 1e-05 to 0\.01 N·m·s/rad, got 1",
        ),
        ("[grid]", "[variants.toes]\n[grid]", "either"),
        ("[grid]", "seeds = [1]\n[grid]", "no sweep.seeds"),
        ("replicas = 2", "replicas = 1", "grid.replicas = 1 .*no scatter"),
        ("replicas = 2\nnoise_deg = 0.05", "", "grid.replicas = 1 .*no scatter"),
        ("noise_deg = 0.05", "noise_deg = 0", "grid.replicas = 2 with grid.noise_deg = 0"),
        ("noise_deg = 0.05", "", "grid.replicas = 2 with grid.noise_deg = 0"),
        ("[1e-4, 1e-3]", "[1e-3, 1e-3]", "toe_damping_n_m_s_per_rad.*0.001 twice"),
        ("[1e-4, 1e-3]", "[1e-3]", "two or more"),
        ('name = "stiffness"', 'name = "toe_damping_n_m_s_per_rad"', "both axes .* are called"),
        ("coefficients_deg = [", "coefficients_deg = 3#", "grid.coefficients_deg .*got 3"),
        ("replicas = 2", "replicas = 2\nresults = 'a.json'", "grid.results must be a list"),
        ("replicas = 2", "replicas = 2\nresults = [1]", "grid.results must be a list"),
    ],
)
def test_a_grid_that_cannot_be_used_is_refused(write, old, new, complaint):
    assert old in GRID
    with pytest.raises(SettingsError, match=complaint):
        read_sweep(write(GRID.replace(old, new)))


def test_levels_may_share_one_of_their_keys(write):
    grid = read_sweep(write(GRID.replace("[0.1, 0.2, 0.4]", "[0.1, 0.1, 0.4]"))).grid
    assert len({foot for row in grid.feet for foot in row}) == 6


def test_gaits_without_noise_are_walked_once_each_and_must_differ(write):
    once = GRID.replace("replicas = 2\nnoise_deg = 0.05\n", "")
    gait = once.split("coefficients_deg = [")[1].split("]]]")[0] + "]]"
    other = once.replace(gait, f"{gait}, {gait.replace('15', '14')}")
    assert len(read_sweep(write(other)).grid.gaits) == 2
    with pytest.raises(SettingsError, match="twice"):
        read_sweep(write(once.replace(gait, f"{gait}, {gait}")))


# --- The table ------------------------------------------------------------------------------------


def result(forward_mm, *, feasible=True, slip=(0.01, 0.02)):
    """A result whose winner went 50 mm less far than the furthest walk."""
    finalists = [
        {"walk": 8, "forward_mm": forward_mm - 50.0, "median_mm": forward_mm - 60.0},
        {"walk": 5, "forward_mm": forward_mm, "median_mm": 0.0},
    ]
    return {
        "study": "toes-rigid",
        "seed": 0,
        "walk": 8 if feasible else 5,
        "winner": 8 if feasible else None,
        "nominal_best": 5,
        "finalists": finalists if feasible else [],
        "feasible": feasible,
        "feasible_count": 3 if feasible else 0,
        "forward_mm": forward_mm - 50.0 * feasible,
        "coefficients_deg": [[0.0] * 4] * 4,
        "foot": {"big_toe_width": 0.03, "rigid_toes": False},
        "measures": {"cost_of_transport": 0.5, "energy": 3.0, "slip": list(slip)},
        "versions": {"drake": "1"},
    }


def put(sweep, out, results):
    for study in sweep.studies:
        folder = study.folder(out)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "result.json").write_text(json.dumps(results[study.variant, study.seed]))
    return [read_row(study, out) for study in sweep.studies]


@pytest.fixture
def rows(write, tmp_path):
    sweep = read_sweep(write(SWEEP))
    results = {
        (study.variant, study.seed): result(300.0 + 10.0 * number)
        for number, study in enumerate(sweep.studies)
    }
    results["wide", 7] = result(900.0, feasible=False)
    results["wide", 0] = result(900.0, feasible=False)
    return put(sweep, tmp_path, results)


def test_a_row_has_the_design_and_the_measures_beside_the_walk(rows):
    row = rows[1]
    assert (row["variant"], row["seed"], row["forward_mm"]) == ("rigid", 0, 260.0)
    assert (row["furthest_mm"], row["robust_mm"]) == (310.0, 250.0)
    assert (rows[2]["furthest_mm"], rows[2]["robust_mm"]) == (None, None)
    assert row["foot.big_toe_width"] == 0.03
    assert row["measures.slip.1"] == 0.02
    assert row["slip_mm"] == pytest.approx(30.0)
    assert not any("coefficients" in key or "finalists" in key for key in row)


def test_a_variant_s_numbers_are_of_its_feasible_walks_only(rows):
    toes, rigid, wide = summaries(rows, ("toes", "rigid", "wide"))
    distance = rigid.spreads["furthest_mm"]
    assert (distance.lowest, distance.median, distance.highest) == (310.0, 325.0, 340.0)
    assert rigid.spreads["robust_mm"].median == 265.0
    assert (toes.feasible, toes.robust, toes.studies, toes.p_values) == (2, 2, 2, {})
    assert (wide.feasible, wide.robust, wide.studies, wide.p_values) == (0, 0, 2, {})
    assert wide.spreads == {}
    # Of the 6 orders of two and two, as many as this or more extreme: 2/3 for this one.
    assert rigid.p_values["furthest_mm"] == rigid.p_values["robust_mm"] == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    "distances",
    [
        {"toes": [300.0], "rigid": [310.0]},
        {"toes": [300.0, 300.0], "rigid": [300.0, 300.0]},
        {"toes": [300.0, 310.0], "rigid": [305.0]},
    ],
)
def test_one_seed_or_equal_distances_give_no_probability(distances):
    rows = [
        {"variant": name, "feasible_count": 1, "winner": 1, "furthest_mm": one, "robust_mm": one}
        for name, found in distances.items()
        for one in found
    ]
    toes, rigid = found = summaries(rows, ("toes", "rigid"))
    assert toes.p_values == rigid.p_values == {}
    assert table(found).rows[1][-2:] == ["-", "-"]


def test_the_table_has_a_line_for_each_variant(rows):
    _, rigid, wide = table(summaries(rows, ("toes", "rigid", "wide"))).rows
    assert rigid[:4] == ["rigid", "2/2", "2/2", "325.0 (310.0 to 340.0)"]
    assert rigid[4].startswith("265.0 ")
    assert rigid[-2:] == ["0.667", "0.667"]
    assert wide == ["wide", "0/2", "0/2", *["-"] * 8]


def test_both_files_hold_every_study(write, rows, tmp_path):
    write_results(read_sweep(write(SWEEP)), rows, tmp_path)
    content = json.loads((tmp_path / "sweep.json").read_text())
    assert content["question"] == "Do toes help?"
    assert [row["forward_mm"] for row in content["studies"]] == [row["forward_mm"] for row in rows]
    lines = (tmp_path / "sweep.csv").read_text().splitlines()
    assert len(lines) == 1 + len(rows)
    assert lines[0].startswith("variant,seed,furthest_mm,robust_mm,walk,winner,nominal_best")


# --- The command ----------------------------------------------------------------------------------


def test_workers_must_be_at_least_one(capsys):
    with pytest.raises(SystemExit, match="2"):
        parse(["sweep.toml", "--workers", "0"])
    assert "must be >= 1, got 0" in capsys.readouterr().err


@pytest.fixture
def pretended(monkeypatch):
    """Studies that take no time; which were started, and the most at once."""
    started = []

    def start(sweep, study, out, lifeline):
        folder = study.folder(out)
        folder.mkdir(parents=True)
        (folder / "result.json").write_text(json.dumps(result(100.0 + len(started))))
        started.append((study.variant, study.seed))
        return subprocess.Popen([sys.executable, "-c", ""])

    monkeypatch.setattr(command, "_start", start)
    monkeypatch.setattr(
        command, "_has_result", lambda study, out: (study.folder(out) / "result.json").exists()
    )
    return started


def test_the_command_runs_every_study_once_and_resumes(write, tmp_path, capsys, pretended):
    arguments = [str(write(SWEEP)), "--workers", "2", "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    assert sorted(pretended) == sorted(
        (variant, seed) for variant in ("toes", "rigid", "wide") for seed in (0, 7)
    )
    output = capsys.readouterr().out
    assert "6 studies, 0 of them finished before" in output
    assert "6/6 " in output
    for name in ("sweep.csv", "sweep.json", "sweep.png", "pareto.png"):
        assert (tmp_path / "out" / name).stat().st_size > 0
    (tmp_path / "out" / "rigid" / "seed-7" / "result.json").unlink()
    (tmp_path / "out" / "rigid" / "seed-7").rmdir()
    del pretended[:]
    assert main(arguments) == 0
    assert pretended == [("rigid", 7)]
    assert "6 studies, 5 of them finished before" in capsys.readouterr().out


def test_ctrl_c_stops_the_studies_that_run(write, tmp_path, capsys, monkeypatch):
    running = []

    def start(sweep, study, out, lifeline):
        running.append(
            subprocess.Popen(
                [sys.executable, "-c", "import time; time.sleep(60)"], stderr=subprocess.DEVNULL
            )
        )
        return running[-1]

    def interrupt(seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "_start", start)
    monkeypatch.setattr(command, "time", SimpleNamespace(sleep=interrupt))
    assert main([str(write(SWEEP)), "--workers", "3", "--out", str(tmp_path / "out")]) == 130
    assert len(running) == 3
    assert all(process.poll() is not None for process in running)
    assert "the same command goes on" in capsys.readouterr().out


@pytest.mark.slow
def test_a_study_that_is_refused_ends_the_sweep_with_its_reason(write, tmp_path, capsys):
    text = SWEEP.replace("[common]", '[common]\nwalk.model = "none.sdf"')
    assert main([str(write(text)), "--workers", "1", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert re.match(
        r"error: .*toes/seed-0 ended with status 2.*'no robot description '.*none\.sdf'", error
    )
    assert error.count("\n") == 1


@pytest.fixture
def finished(monkeypatch):
    """Takes studies with a report and a result that can be read as finished."""
    monkeypatch.setattr(command, "is_finished", lambda settings, folder: folder.exists())


@pytest.mark.parametrize("damage", ["", "{", "[]", "null", '{"feasible_count": 1}', None])
def test_a_study_whose_result_is_damaged_or_gone_is_run_again(write, tmp_path, finished, damage):
    sweep = read_sweep(write(SWEEP))
    put(sweep, tmp_path, {(one.variant, one.seed): result(300.0) for one in sweep.studies})
    for study in sweep.studies:
        (study.folder(tmp_path) / "report.html").touch()
        assert command._has_result(study, tmp_path)
    study = sweep.studies[0]
    path = study.folder(tmp_path) / "result.json"
    path.unlink() if damage is None else path.write_text(damage)
    assert not command._has_result(study, tmp_path)


def test_a_study_without_its_report_is_run_again(write, tmp_path, finished):
    sweep = read_sweep(write(SWEEP))
    put(sweep, tmp_path, {(one.variant, one.seed): result(300.0) for one in sweep.studies})
    assert not command._has_result(sweep.studies[0], tmp_path)


def test_more_seeds_extend_a_sweep(write, tmp_path, pretended):
    arguments = ["--workers", "2", "--out", str(tmp_path / "out")]
    assert main([str(write(SWEEP)), *arguments]) == 0
    del pretended[:]
    assert main([str(write(SWEEP.replace("[0, 7]", "[0, 3, 7]"))), *arguments]) == 0
    assert sorted(pretended) == [("rigid", 3), ("toes", 3), ("wide", 3)]
    content = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert len(content["studies"]) == 9


def test_a_variant_that_is_removed_is_in_no_file_and_its_studies_stay(write, tmp_path, pretended):
    arguments = ["--workers", "2", "--out", str(tmp_path / "out")]
    assert main([str(write(SWEEP)), *arguments]) == 0
    fewer = SWEEP.replace("[variants.rigid]\nfoot.rigid_toes = true\n", "")
    (tmp_path / "out" / "sweep.json").write_text("{")  # It is written, never read.
    assert main([str(write(fewer)), *arguments]) == 0
    content = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert {row["variant"] for row in content["studies"]} == {"toes", "wide"}
    assert (tmp_path / "out" / "rigid" / "seed-0" / "result.json").exists()


@pytest.mark.parametrize(
    ("child", "complaint"),
    [
        ("import os; os.kill(os.getpid(), 9)", "ended by SIGKILL.*memory.*said nothing"),
        ("import os; os.kill(os.getpid(), 11)", "ended by SIGSEGV.*said nothing"),
        ("import os; os.kill(os.getpid(), 40)", "ended by signal 40.*said nothing"),
        ("raise SystemExit(3)", "ended with status 3.*said nothing"),
        ("print('so far', end='\\n\\n\\n'); 1 / 0", "status 1.*said 'ZeroDivisionError"),
        ("import shutil, sys; shutil.rmtree(sys.argv[1]); exit(2)", "log.txt cannot be read"),
    ],
)
def test_a_study_that_ends_early_is_named_with_how_and_what_runs_it_alone(
    write, tmp_path, capsys, monkeypatch, child, complaint
):
    def start(sweep, study, out, lifeline):
        folder = study.folder(out)
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "log.txt").open("wb") as log:
            return subprocess.Popen([sys.executable, "-c", child, folder], stdout=log, stderr=log)

    monkeypatch.setattr(command, "_start", start)
    arguments = [str(write(SWEEP)), "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.match(f"error: the study in .*toes/seed-0.*{complaint}", error)
    alone = shlex.split(error.partition("alone: ")[2])
    assert alone[:3] == ["python", "-m", "drake_gait.optimize"]
    options = optimize.parse(alone[3:])
    assert options.out == tmp_path / "out" / "toes" / "seed-0"
    planned = read_sweep(write(SWEEP)).studies[0].settings
    assert options.settings().description() == planned.description()


def test_two_sweeps_do_not_share_a_folder(write, tmp_path, capsys, pretended):
    out = tmp_path / "out"
    with driver_lock(out / "sweep"):
        for text in (SWEEP, GRID):
            assert main([str(write(text)), "--workers", "1", "--out", str(out)]) == 2
            assert f"another process is working on {out}" in capsys.readouterr().err
    assert pretended == []


SMALL = SWEEP.replace("[0, 7]", "[0]").split("[variants.rigid]")[0]


def studies_that_run(out):
    """Processes that work on a study of a sweep's folder."""
    listed = subprocess.run(
        ["ps", "-ww", "-eo", "pid,args"], check=True, stdout=subprocess.PIPE, text=True
    )
    lines = [line for line in listed.stdout.splitlines() if f"--out {out}/" in line]
    return [int(line.split()[0]) for line in lines]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_a_sweep_that_is_ended_leaves_no_process_and_is_resumed(write, tmp_path, number):
    out = tmp_path / "out"
    arguments = [sys.executable, "-m", "drake_gait", "sweep", str(write(SMALL)), "--out", str(out)]
    walks = out / "toes" / "seed-0" / "study.db"

    def begun():
        """The sweep, when its study is under way in a process that was not there before."""
        before = studies_that_run(out)
        sweep = subprocess.Popen(arguments, stdout=subprocess.DEVNULL)
        while not (set(studies_that_run(out)) - set(before) and is_driven(walks)):
            assert sweep.poll() is None
            time.sleep(0.1)
        return sweep

    for sent in (number, signal.SIGKILL):
        sweep = begun()
        sweep.send_signal(sent)
        sweep.wait()
    while studies_that_run(out):
        time.sleep(0.1)


@pytest.mark.slow
def test_a_base_that_is_changed_under_a_sweep_is_named(write, tmp_path, capsys):
    out = tmp_path / "out"
    assert main([str(write(SMALL)), "--out", str(out)]) == 0
    changed = SMALL.replace("search.samples = 20", "search.samples = 18")
    assert main([str(write(changed)), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert re.search(r"toes/seed-0.*search\.samples = 20, not 18.*--out", error)
    shutil.rmtree(out / "toes" / "seed-0")
    assert main([str(write(changed)), "--out", str(out)]) == 0


@pytest.mark.slow
def test_a_real_sweep_is_the_studies_that_optimize_runs(write, tmp_path, finished_run):
    out = tmp_path / "out"
    text = SWEEP.replace("[0, 7]", "[0]").split("[variants.rigid]")[0]
    arguments = [str(write(text)), "--workers", "2", "--out", str(out)]
    assert main(arguments) == 0
    folder, _ = finished_run
    ours, theirs = (
        json.loads((path / "result.json").read_text()) for path in (out / "toes" / "seed-0", folder)
    )
    assert ours["coefficients_deg"] == theirs["coefficients_deg"]
    assert ours["forward_mm"] == theirs["forward_mm"]
    assert main(arguments) == 0

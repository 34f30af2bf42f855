"""From a study to the robot: `export --motion`, `play` and `overlay`."""

import csv
import io
import threading

import numpy as np
import pytest
from rcb4_board import HELD, Board

from drake_gait.cli import export, overlay, play
from drake_gait.gait import JOINTS
from drake_gait.hardware.servo_map import read_servo_map


@pytest.fixture(scope="module")
def run(repository):
    """A committed study whose winner walks."""
    return str(repository / "studies" / "best")


@pytest.fixture(scope="module")
def soft(run, tmp_path_factory):
    """The winner's motion in degrees, softened."""
    path = tmp_path_factory.mktemp("motion") / "soft.csv"
    assert export.main([run, "--motion", str(path), "--soften", "--allow", "collision"]) == 0
    return path


def rows_of(text):
    header, *rows = csv.reader(io.StringIO(text))
    return header, np.array(rows, dtype=float)


def test_a_motion_has_241_frames_of_ten_joints(soft):
    header, rows = rows_of(soft.read_text())
    assert header == ["time_s", *JOINTS]
    assert rows.shape == (241, 11)
    assert rows[-1, 0] == pytest.approx(4.8)


def test_positions_are_those_of_the_angles(run, soft, capsys):
    arguments = ["--units", "rcb4", "--soften", "--allow", "collision", "--frame-ms", "10"]
    assert export.main([run, "--motion", "-", *arguments]) == 0
    header, rows = rows_of(capsys.readouterr().out)
    servos = read_servo_map()
    assert header == ["time_ms", *(f"servo_{number}" for number in servos.ids)]
    assert len(rows) == 481
    angles = np.radians(rows_of(soft.read_text())[1][:, 1:])
    assert np.abs(rows[::2, 1:] - servos.positions(angles)).max() <= 1


def test_a_jump_faster_than_the_servo_is_refused_and_nothing_is_written(run, tmp_path, capsys):
    path = tmp_path / "motion.csv"
    assert export.main([run, "--motion", str(path), "--allow", "collision"]) == 2
    assert not path.exists()
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("error: ")
    for needed in ("frame", "rad/s", "--soften", "--allow speed"):
        assert needed in last
    assert (
        export.main([run, "--motion", str(path), "--allow", "collision", "--allow", "speed"]) == 0
    )
    assert path.exists()


def test_softening_says_what_it_costs(run, capsys):
    assert export.main([run, "--motion", "-", "--soften", "0.6", "--allow", "collision"]) == 0
    told = capsys.readouterr().err
    assert "as it is, it walks" in told
    assert "softened, it falls" in told  # This gait lives on the speed of its servos.


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--soften", "0"], "--soften"),
        (["--soften", "2"], "--soften"),
        (["--frame-ms", "17"], "17"),
        (["--walk", "123456"], "123456"),
        (["--robot", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_a_value_that_no_motion_can_have_is_named(run, capsys, arguments, named):
    assert export.main([run, "--motion", "-", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert named in captured.err.splitlines()[-1]


def test_options_of_a_motion_are_refused_without_one(run, capsys):
    with pytest.raises(SystemExit, match="2"):
        export.main([run, "--csv", "-", "--soften"])
    assert "--soften" in capsys.readouterr().err


def test_a_dry_run_prints_every_frame_and_opens_no_port(run, capsys):
    assert play.main([run, "--dry-run", "--soften", "--allow", "collision"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 241
    assert all(len(line.split()) == 11 for line in lines[1:])


@pytest.mark.slow
def test_a_walk_is_played_in_its_own_time(run, capsys):
    pytest.importorskip("rcb4")
    board = Board()
    try:
        arguments = ["--port", board.port, "--yes", "--soften", "--allow", "collision"]
        assert play.main([run, *arguments]) == 0
    finally:
        board.close()
    assert not board.wrong
    times = [time for time, _, places in board.moves if set(places.values()) != {HELD}]
    assert len(times) == 1 + 241
    assert np.ptp(times[1:]) > 4.7
    assert "241 frames played" in capsys.readouterr().out


@pytest.mark.slow
def test_ctrl_c_leaves_the_servos_holding(run, capsys):
    pytest.importorskip("rcb4")
    import _thread

    board = Board()

    def interrupt():
        while len(board.moves) < 20:
            pass
        _thread.interrupt_main()

    threading.Thread(target=interrupt, daemon=True).start()
    try:
        arguments = ["--port", board.port, "--yes", "--soften", "--allow", "collision"]
        assert play.main([run, *arguments]) == 130
    finally:
        board.close()
    assert set(board.moves[-1][2].values()) == {HELD}
    assert len(board.moves) < 200
    assert "hold" in capsys.readouterr().err


@pytest.fixture(scope="module")
def measured(run, tmp_path_factory):
    """A log of the winner's knees, 30 ms late and with noise of half a degree."""
    from pathlib import Path

    from drake_gait.cli._replay import choose
    from drake_gait.simulation.simulate import simulate

    _, chosen, as_then = choose(Path(run), None)
    history = simulate(chosen.candidate, as_then, history=True).history
    rng = np.random.default_rng(1)
    times = np.arange(0.0, 4.8, 0.01)
    lines = ["time_s,knee_r,knee_l,battery"]
    columns = [
        np.degrees(np.interp(times - 0.03, history.time, history.angles[:, JOINTS.index(name)]))
        + 0.5 * rng.normal(size=len(times))
        for name in ("knee_r", "knee_l")
    ]
    lines += [
        f"{t:.3f},{r:.3f},{left:.3f},11.1" for t, r, left in zip(times, *columns, strict=True)
    ]
    path = tmp_path_factory.mktemp("log") / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_delay_and_the_noise_of_a_log_are_found(run, measured, tmp_path, capsys):
    figure = tmp_path / "overlay.svg"
    assert overlay.main([run, str(measured), "--out", str(figure)]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    found = {row[0]: [float(cell) for cell in row[1:]] for row in rows if row[0] in JOINTS}
    assert set(found) == {"knee_r", "knee_l"}
    for delay, rms, aligned in found.values():
        assert delay == pytest.approx(30.0, abs=3.0)
        assert aligned == pytest.approx(0.5, abs=0.1)
        assert rms > 2.0 * aligned
    assert figure.stat().st_size > 10_000


def test_a_log_of_another_time_is_refused_with_both_spans(run, measured, capsys):
    assert overlay.main([run, str(measured), "--shift", "10"]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "4.8" in last
    assert "10" in last


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "time_s"),
        ("time_s,elbow\n0,1\n1,2\n", "time_s"),
        ("time_s,knee_l\n0,1\n", "1 rows"),
        ("time_s,knee_l\n0,1\n1,x\n", "'x'"),
        ("time_s,knee_l\n0,1\n1\n", "line 3"),
        ("time_s,knee_l\n0,1\n0,2\n", "rise"),
        ("time_s;knee_l\n0;1,5\n1;2,5\n", "time_s"),
    ],
)
def test_a_log_that_cannot_be_used_is_named(run, tmp_path, capsys, text, named):
    path = tmp_path / "log.csv"
    path.write_text(text)
    assert overlay.main([run, str(path)]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert str(path) in last
    assert named in last

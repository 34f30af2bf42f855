"""How every command begins and ends."""

import importlib
import io
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import drake_gait
from drake_gait import __main__ as front_door
from drake_gait.cli import _command as command
from drake_gait.cli._command import LastingStream, conduct
from drake_gait.cli._signals import Terminated
from drake_gait.errors import SettingsError

WITHOUT_UTF8 = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def raises(error):
    """Work that ends so."""

    def work():
        raise error

    return work


class Pipe(io.TextIOBase):
    """A stream that can be written no more."""

    def __init__(self, number):
        self.number = number

    def write(self, text):
        raise OSError(self.number, os.strerror(self.number))

    def isatty(self):
        return False


def test_a_command_that_is_done_says_nothing_of_its_own(capsys):
    assert conduct(lambda: sys.stdout.write("done\n")) == 0
    assert capsys.readouterr() == ("done\n", "")


@pytest.mark.parametrize(
    ("error", "named"),
    [
        (SettingsError("walk.friction is 7\nand more"), "walk.friction is 7 and more"),
        (PermissionError(13, "Permission denied", "/runs/a"), "/runs/a: Permission denied"),
        (OSError("no such host"), "no such host"),
        (MemoryError(), "--workers"),
        (UnicodeEncodeError("ascii", "größe", 2, 3, "ordinal not in range"), "größe"),
    ],
)
def test_what_a_user_can_cure_is_one_line_and_status_2(capsys, error, named):
    assert conduct(raises(error)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert named in err


def test_a_bug_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        conduct(raises(ZeroDivisionError()))


@pytest.mark.parametrize(("error", "status"), [(KeyboardInterrupt, 130), (Terminated, 143)])
@pytest.mark.parametrize("searches", [False, True])
def test_who_stops_a_command_reads_one_line(capsys, error, status, searches):
    assert conduct(raises(error()), stopped="stopped here", searches=searches) == status
    out, err = capsys.readouterr()
    assert out + err == "stopped here\n"
    assert (out == "") is not searches  # A product and these words do not mix.


@pytest.mark.parametrize(("sent", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_stops_a_command(capsys, sent, status):
    def work():
        os.kill(os.getpid(), sent)
        threading.Event().wait(60.0)

    assert conduct(work) == status
    assert capsys.readouterr() == ("", "stopped\n")


def test_a_command_in_another_thread_leaves_the_signals_alone():
    found = []
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    thread = threading.Thread(target=lambda: found.append(conduct(raises(KeyboardInterrupt()))))
    thread.start()
    thread.join()
    assert found == [130]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.parametrize("number", [28, 32, 5])
def test_a_search_goes_on_where_its_output_goes_nowhere(capsys, monkeypatch, number):
    done = []

    def work():
        for step in range(3):
            sys.stdout.write(f"{step}\n")
            done.append(step)

    monkeypatch.setattr(sys, "stdout", Pipe(number))
    assert conduct(work, searches=True) == 0
    assert done == [0, 1, 2]
    warning = capsys.readouterr().err
    assert warning.count("\n") == 1
    assert os.strerror(number) in warning


@pytest.mark.parametrize(("number", "status"), [(28, 2), (32, 0), (5, 2)])
def test_a_product_that_goes_nowhere_is_an_error_unless_its_reader_left(
    capsys, monkeypatch, number, status
):
    monkeypatch.setattr(sys, "stdout", Pipe(number))
    assert conduct(lambda: sys.stdout.write("product")) == status
    assert (os.strerror(number) in capsys.readouterr().err) is (status == 2)


def test_a_search_whose_output_is_gone_is_still_stopped_in_one_line(capsys, monkeypatch):
    def work():
        sys.stdout.write("gone")
        raise KeyboardInterrupt

    monkeypatch.setattr(sys, "stdout", Pipe(32))
    assert conduct(work, stopped="stopped here", searches=True) == 130
    assert capsys.readouterr().err.endswith("stopped here\n")


@pytest.mark.parametrize("closed", ["stdout", "stderr"])
def test_a_stream_that_is_closed_breaks_off_no_search(monkeypatch, closed):
    monkeypatch.setattr(sys, closed, None)
    assert conduct(lambda: print("x", file=getattr(sys, closed)), searches=True) == 0


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8", "utf-16"])
@pytest.mark.parametrize("text", ["größe 🤖 N·m R² −1", "half \ud83e", "bytes \udcff"])
def test_what_a_stream_cannot_encode_is_replaced(encoding, text):
    raw = io.BytesIO()
    stream = LastingStream(io.TextIOWrapper(raw, encoding=encoding))
    stream.write(text)
    stream.writelines(["\n", text])
    stream.flush()
    found = raw.getvalue().decode(encoding)
    assert found == "\n".join([text.encode(encoding, "replace").decode(encoding)] * 2)


def test_the_streams_are_as_before_when_a_command_has_ended(monkeypatch):
    before = sys.stdout, sys.stderr
    for work in (print, raises(KeyboardInterrupt()), raises(SettingsError("x"))):
        conduct(work)
        assert (sys.stdout, sys.stderr) == before


BEGINNING = """
import os, sys
from drake_gait.cli._signals import begin
begin()
found = sorted(int(name) for name in os.listdir("/dev/fd") if int(name) < 3)
print(found, file=open(sys.argv[1], "w"))
"""


def test_a_closed_stream_s_place_is_taken_by_no_file(tmp_path):
    def close():
        for descriptor in (0, 1, 2):
            os.close(descriptor)

    subprocess.run(
        [sys.executable, "-c", BEGINNING, str(tmp_path / "a")], check=True, preexec_fn=close
    )
    assert (tmp_path / "a").read_text() == "[0, 1, 2]\n"


def test_the_front_door_lists_all_commands_with_what_they_do(capsys):
    for arguments in ([], ["--help"], ["-h"]):
        assert front_door.main(arguments) == 0
        lines = capsys.readouterr().out.splitlines()
        for name in front_door.COMMANDS:
            (line,) = (line for line in lines if line.split()[:1] == [name])
            assert len(line.split()) > 3
    assert sorted(front_door.COMMANDS) == sorted(commands_of_the_package())


def commands_of_the_package():
    modules = Path(command.__file__).parent.glob("*.py")
    texts = {path.stem: path.read_text(encoding="utf-8") for path in modules}
    return [name for name, text in texts.items() if "\ndef main(" in text]


@pytest.mark.parametrize("name", ["optimise", "Studies", "--json", ""])
def test_the_front_door_refuses_what_is_no_command_with_the_nearest(capsys, name):
    assert front_door.main([name]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"'{name}'" in error
    assert "optimize, sweep" in error


def run(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
        **options,
    )


def test_a_command_runs_as_a_module_and_as_a_program_alike(tmp_path):
    ours = run("drake_gait", "studies", "show", tmp_path)
    program = "from drake_gait.__main__ import script; script()"
    theirs = subprocess.run(
        [sys.executable, "-c", program, "studies", "show", str(tmp_path)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert ours.returncode == theirs.returncode == 2
    assert ours.stderr == theirs.stderr != ""
    assert "--json" in run("drake_gait", "studies", "list", "--help").stdout


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_reader_without_utf_8_gets_what_it_can_read(tmp_path, encoding):
    environment = {**os.environ, **WITHOUT_UTF8, "LC_ALL": "C", "PYTHONIOENCODING": encoding}
    ended = run("drake_gait", "studies", "show", tmp_path / "größe 🤖", env=environment)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: ")
    assert ended.stderr.count("\n") == 1


def test_a_help_that_nobody_reads_to_its_end_is_no_error():
    command_ = f"{sys.executable} -m drake_gait export --help | true; exit ${{PIPESTATUS[0]}}"
    ended = subprocess.run(["bash", "-c", command_], check=False, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize("name", front_door.COMMANDS)
def test_a_help_names_what_an_option_takes(name, capsys):
    main = importlib.import_module(f"drake_gait.cli.{name}").main
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert not re.search(r"--\w+ (OVERRIDES|SAMPLES|SIMULATIONS|SEED|WORKERS|OUT|PORT)\b", shown)
    if name == "optimize":
        for option in ("--samples N", "--simulations N", "--seed N", "--workers N", "--out DIR"):
            assert option in shown


HEAVY = {"torch", "matplotlib", "pydrake", "scipy", "sklearn", "cmaes", "distributed", "rich"}

LIGHT = [
    ["--version"],
    ["--help"],
    ["optimise"],
    *([name, option] for name in front_door.COMMANDS for option in ("--help", "--no-such-option")),
    ["optimize", "none.toml"],
    ["optimize", "--seed", "-1"],
    ["sweep", "none.toml"],
    ["sweep", "none.toml", "--workers", "0"],
    ["report", "none"],
    ["report", "none", "none"],
    ["report", "studies/best", "studies/best", "--out", "none/file"],
    ["replay", "none", "--live"],
    ["replay", "studies/best", "--out", "none/file"],
    ["replay", "studies/best", "--out", "-", "--gallery", "none"],
    ["studies", "show", "none"],
    ["export", "none", "--csv", "-"],
    ["export", "none", "--optuna", "sqlite://"],
    ["identify", "none.csv", "--inertia", "0.004"],
]
"""Command lines that are answered at once: help, and what is wrong with an argument."""

LOADS = """
import sys
from drake_gait.__main__ import main

commands, heavy = eval(sys.argv[1])
for words in commands:
    try:
        status = main(words)
    except SystemExit as ended:
        status = ended.code
    print(words, status, sorted(heavy & set(sys.modules)), sep="|", file=sys.__stderr__)
"""


def test_help_and_wrong_arguments_wait_for_no_heavy_library(tmp_path):
    ended = subprocess.run(
        [sys.executable, "-c", LOADS, repr((LIGHT, HEAVY))],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(drake_gait.__file__).parents[1])},
    )
    told = [line.split("|") for line in ended.stderr.splitlines() if line.startswith("[")]
    answered = {str(words): 0 if {"--version", "--help"} & set(words) else 2 for words in LIGHT}
    assert told == [[words, str(status), "[]"] for words, status in answered.items()]


def test_the_version_is_told_by_the_module_and_by_the_package():
    assert run("drake_gait", "--version").stdout == f"drake_gait {drake_gait.__version__}\n"

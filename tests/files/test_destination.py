"""Where files are written: every kind of place that a path can stand for."""

import errno
import os
import stat
import subprocess
import sys
import threading

import pytest

from drake_gait.errors import GaitError
from drake_gait.files import destination
from drake_gait.files.destination import STANDARD_OUTPUT, check, messages, write

OLD, NEW = "old\n", "new, and longer\n"


@pytest.fixture
def umask():
    before = os.umask(0o027)
    yield
    os.umask(before)


def written_by_a_process(path, content, **options):
    """What another process does that writes to a path, with descriptors of its own."""
    code = "import sys, pathlib; from drake_gait.files.destination import write\n"
    code += "write(pathlib.Path(sys.argv[1]), sys.argv[2])"
    command = [sys.executable, "-c", code, str(path), content]
    return subprocess.run(command, check=False, stderr=subprocess.PIPE, text=True, **options)


@pytest.mark.parametrize("content", ["größe 🤖\n", b"\x00\xff", ""])
def test_a_file_holds_what_was_written_and_nothing_lies_beside_it(tmp_path, content):
    path = tmp_path / "a"
    for _ in range(2):
        write(path, content)
        data = content.encode() if isinstance(content, str) else content
        assert path.read_bytes() == data
    assert list(tmp_path.iterdir()) == [path]


def test_half_a_character_is_replaced(tmp_path):
    write(tmp_path / "a", "x\udcffy")
    assert (tmp_path / "a").read_text() == "x?y"


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "target").write_text(OLD)
    (tmp_path / "link").symlink_to("target")
    (tmp_path / "over").symlink_to(tmp_path / "link")
    write(tmp_path / "over", NEW)
    assert (tmp_path / "over").is_symlink()
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == NEW


def test_a_link_to_nothing_makes_its_target(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("folder/target")
    write(tmp_path / "link", NEW)
    assert (tmp_path / "folder" / "target").read_text() == NEW
    assert (tmp_path / "link").is_symlink()


def test_a_file_with_two_names_keeps_both(tmp_path):
    for old, new in ((OLD, NEW), (NEW, OLD)):
        (tmp_path / "one").write_text(old)
        if not (tmp_path / "two").exists():
            (tmp_path / "two").hardlink_to(tmp_path / "one")
        write(tmp_path / "one", new)
        assert (tmp_path / "two").read_text() == new


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o666, 0o755])
def test_a_file_keeps_its_mode(tmp_path, umask, mode):
    path = tmp_path / "a"
    path.write_text(OLD)
    path.chmod(mode)
    write(path, NEW)
    assert stat.S_IMODE(path.stat().st_mode) == mode


def test_a_new_file_has_the_mode_that_the_umask_leaves(tmp_path, umask):
    write(tmp_path / "a", NEW)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640


def test_a_file_keeps_its_owner(tmp_path):
    if os.geteuid() != 0:
        pytest.skip("only root can give files away")
    path = tmp_path / "a"
    path.write_text(OLD)
    os.chown(path, 12345, 23456)
    write(path, NEW)
    assert (path.stat().st_uid, path.stat().st_gid) == (12345, 23456)


def test_a_pipe_with_a_name_is_written_and_stays(tmp_path):
    path, heard = tmp_path / "pipe", []
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: heard.append(path.read_text()))
    reader.start()
    write(path, NEW)
    reader.join()
    assert heard == [NEW]
    assert stat.S_ISFIFO(path.stat().st_mode)


def test_a_device_is_written_and_stays(tmp_path):
    (tmp_path / "link").symlink_to(os.devnull)
    for path in (tmp_path / "link", destination.Path(os.devnull)):
        write(path, NEW)
        assert stat.S_ISCHR(path.stat().st_mode)


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_the_name_of_standard_output_is_written_where_it_stands(tmp_path, name):
    if not os.path.lexists(name):
        pytest.skip(f"this system has no {name}")
    path = tmp_path / "redirected"
    path.write_text(OLD)
    with path.open("a") as file:
        assert written_by_a_process(name, NEW, stdout=file).stderr == ""
    assert path.read_text() == OLD + NEW
    # A pipe has no name that could be replaced.
    assert written_by_a_process(name, NEW, stdout=subprocess.PIPE).stdout == NEW


def test_a_descriptor_that_a_shell_hands_over_is_written(tmp_path):
    reading, writing = os.pipe()
    ended = written_by_a_process(f"/dev/fd/{writing}", NEW, pass_fds=[writing])
    os.close(writing)
    with os.fdopen(reading) as pipe:
        assert (ended.stderr, pipe.read()) == ("", NEW)


def test_a_file_that_standard_output_goes_to_is_not_replaced(tmp_path):
    path = tmp_path / "a"
    with path.open("w") as file:
        before = os.fstat(file.fileno()).st_ino
        written_by_a_process(path, NEW, stdout=file)
    assert path.stat().st_ino == before
    assert path.read_text() == NEW


@pytest.mark.parametrize("names", [["one"], ["one", "two"]])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, names):
    # A limit on a file's size refuses what a full disk refuses.
    for name in names:
        path = tmp_path / name
        path.write_bytes(b"old" * 1000) if name == "one" else path.hardlink_to(tmp_path / "one")
    limited = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
    code = f"{limited}import sys, pathlib; from drake_gait.files.destination import write\n"
    code += "write(pathlib.Path(sys.argv[1]), b'new' * 10000)"
    ended = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "one")], check=False, capture_output=True
    )
    assert str(tmp_path / "one").encode() in ended.stderr
    assert b"unchanged" in ended.stderr
    assert (tmp_path / "one").read_bytes() == b"old" * 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_an_interruption_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    def interrupted(descriptor):
        raise KeyboardInterrupt

    path = tmp_path / "a"
    path.write_text(OLD)
    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(path, NEW)
    assert path.read_text() == OLD
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("refusal", [errno.EACCES, errno.EROFS, errno.EBUSY])
def test_a_file_that_cannot_be_renamed_onto_is_written_in_place(tmp_path, monkeypatch, refusal):
    def refuse(*arguments):
        raise OSError(refusal, os.strerror(refusal))

    path = tmp_path / "a"
    path.write_text(NEW)
    monkeypatch.setattr(destination.Path, "replace", refuse)
    write(path, OLD)
    assert path.read_text() == OLD
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(GaitError, match="new"):
        write(tmp_path / "new", OLD)


def unwritable(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "folder").mkdir()
    return {
        "folder": tmp_path / "folder",
        "nowhere": tmp_path / "nowhere" / "a",
        "file": tmp_path / "file" / "a",
        "loop": tmp_path / "loop",
        "loop/a": tmp_path / "loop" / "a",
        "xxx": tmp_path / ("x" * 300),
        "y/y": tmp_path / ("y/" * 3000) / "a",
        "null byte": tmp_path / "a\0b",
        "/dev/fd/987": destination.Path("/dev/fd/987"),
    }


@pytest.mark.parametrize(
    "kind",
    ["folder", "nowhere", "file", "loop", "loop/a", "xxx", "y/y", "null byte", "/dev/fd/987"],
)
@pytest.mark.parametrize("does", [write, check])
def test_a_path_that_cannot_be_written_is_named_in_one_line(tmp_path, kind, does):
    path = unwritable(tmp_path)[kind]
    with pytest.raises(GaitError) as caught:
        does(path, "x", what="the page ") if does is write else does(path, what="the page ")
    assert kind in str(caught.value)
    assert "the page" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_path_that_can_be_written_passes_the_check_untouched(tmp_path):
    (tmp_path / "there").write_text(OLD)
    for path in (
        tmp_path / "there",
        tmp_path / "new",
        STANDARD_OUTPUT,
        destination.Path(os.devnull),
    ):
        check(path)
    assert (tmp_path / "there").read_text() == OLD
    assert not (tmp_path / "new").exists()


def test_a_command_does_not_talk_into_its_product(tmp_path):
    assert messages(tmp_path / "a") is sys.stdout
    for path in (STANDARD_OUTPUT, destination.Path("/dev/fd/1"), destination.Path("/dev/stdout")):
        assert messages(path) is sys.stderr


def test_standard_output_takes_text_and_bytes(capsysbinary):
    write(STANDARD_OUTPUT, "größe\n")
    write(STANDARD_OUTPUT, b"\xff\n")
    assert capsysbinary.readouterr().out == "größe\n".encode() + b"\xff\n"

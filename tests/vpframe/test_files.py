"""Files are replaced as a whole, or not at all."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from vpframe.errors import VpframeError
from vpframe.files import replace, replacing


def test_a_file_is_replaced_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    replace(path, "one, grün")
    assert path.read_text(encoding="utf-8") == "one, grün"
    with replacing(path) as file:
        file.write(b"two")
        file.flush()
        assert path.read_text(encoding="utf-8") == "one, grün", "nothing is seen of it before"
    assert path.read_bytes() == b"two"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_an_error_in_the_block_leaves_the_old_file_and_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    replace(path, b"old")
    with pytest.raises(KeyboardInterrupt), replacing(path) as file:
        file.write(b"half of")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_what_cannot_be_written_is_one_line_that_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(VpframeError, match=r"nowhere/a\.txt: cannot be written: No such file or directory"):
        replace(tmp_path / "nowhere" / "a.txt", b"")
    with pytest.raises(VpframeError, match="cannot be written: Is a directory"):
        replace(tmp_path, b"")


def test_a_device_is_written_to_as_it_is() -> None:
    with pytest.raises(VpframeError, match="No space left on device"):
        replace("/dev/full", b"x" * 100_000)
    replace(os.devnull, b"x")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


def test_no_room_leaves_the_old_file(tmp_path: Path) -> None:
    """A limit on file size stands for the full disk: writing stops in the middle of the file."""
    path = tmp_path / "a.txt"
    replace(path, b"old")
    limited = f"""
import resource, signal
from vpframe.files import replace
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
try:
    replace({str(path)!r}, b"x" * 100_000)
except Exception as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", limited], capture_output=True, text=True, timeout=60)
    assert done.stdout == f"{path}: cannot be written: File too large\n"
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_links_and_permissions_stay(tmp_path: Path) -> None:
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    replace(path, b"old")
    path.chmod(0o640)
    link.symlink_to(path)
    replace(link, b"new")
    assert link.is_symlink()
    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640

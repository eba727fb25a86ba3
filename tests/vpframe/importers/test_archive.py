"""Archives of scenes."""

import numpy as np
import pytest

import vpframe as vp
from tests.vpframe.importers.models import model, same
from vpframe.importers import archive, cache


def test_what_was_cached_is_what_is_read_without_a_cache(tmp_path, place, monkeypatch):
    path = model(tmp_path / "a.step")
    vp.load(path)
    cached = vp.load(path)
    monkeypatch.setenv(cache.VARIABLE, "")
    assert same(vp.load(path), cached)


def test_an_entry_holds_nothing_that_runs(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, text=np.array([print], dtype=object))
    with pytest.raises(archive.ArchiveError, match="damaged"):
        archive.read(path)

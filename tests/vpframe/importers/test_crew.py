"""Processes forked for the shapes of a file: one that crashes, hangs or grows costs no other shape."""

import json
import subprocess
import sys

import pytest

SCRIPT = """
import json, os, signal, sys, time
import numpy as np
from vpframe.importers import crew, limits
from vpframe.importers.raw import RawFace, RawScene, RawShape

limits.SHAPE_SECONDS, limits.SHAPE_SECONDS_OF_FACE = 0.3, 0.0

def make(number, mesher, tell):
    tell(0.5)
    if number == {number} and (mesher or not {plain}):
        {fault}
    faces = [RawFace("face")] if number != 4 else []
    return RawShape(np.zeros((3, 3)), np.zeros((1, 3), np.int32), np.zeros(1, np.int32), faces)

def keep(number, raw):
    open(f"{{sys.argv[1]}}/{{number}}", "x").close()

told, ready = [], []
made = crew.Crew(make, keep, lambda number, done: told.append(number), ready.append, 4 << 30)
made.run([3.0, 1.0, 2.0, 5.0, 1.0, 1.0])
print(json.dumps([sorted(ready), sorted(set(told)), sorted(map(int, os.listdir(sys.argv[1]))), made.lost]))
"""


def run(folder, number: int, fault: str, plain: bool = False):
    script = SCRIPT.format(number=number, fault=fault, plain=plain)
    done = subprocess.run([sys.executable, "-c", script, str(folder)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


FAULTS = {
    "while True: pass": "is not meshed within 0.3 s of processor time",
    "sum(iter(int, 1))": "is not meshed within 0.3 s of processor time",  # no bytecode of Python's runs in between
    "os.kill(os.getpid(), signal.SIGSEGV)": "crashes the CAD kernel",
    "os.abort()": "crashes the CAD kernel",
    "raise MemoryError": "takes more than 3.4 GB to mesh",
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("number", [0, 3])
def test_a_shape_that_cannot_be_made_is_named_and_the_others_are_kept(fault, number, tmp_path):
    ready, told, kept, lost = run(tmp_path, number, fault)
    others = sorted({0, 1, 2, 3, 5} - {number})
    assert ready == kept == others
    assert told == [0, 1, 2, 3, 4, 5]
    assert lost == {str(number): FAULTS[fault], "4": "meshes to nothing"}


@pytest.mark.parametrize("fault", list(FAULTS)[:4])
def test_a_shape_that_is_made_in_the_plainer_way_is_kept(fault, tmp_path):
    ready, _, kept, lost = run(tmp_path, 2, fault, plain=True)
    assert ready == kept == [0, 1, 2, 3, 5]
    assert lost == {"4": "meshes to nothing"}


def test_a_fault_of_our_own_is_no_lost_part(tmp_path):
    with pytest.raises(AssertionError, match="ZeroDivisionError"):
        run(tmp_path, 1, "1 / 0")

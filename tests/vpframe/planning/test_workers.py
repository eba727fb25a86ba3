"""A plan with worker processes is the plan without them, whatever becomes of the workers."""

import json

import pytest

import vpframe as vp
from tests.vpframe.planning import cases
from vpframe.planning import plan, workers
from vpframe.planning.assembly import LINEAR
from vpframe.planning.document import document


def planned(jobs, scene=cases.interlocked, **options):
    """The document of a plan."""
    found = vp.planning.disassembly(scene(), budget=600.0, motion="mates", jobs=jobs, **options)
    return json.dumps(document(found, 0, LINEAR, {}))


@pytest.fixture
def started(monkeypatch):
    """The processes of all workers, and how many tasks they have done."""
    processes, answered = [], []
    of_class = workers.Workers

    class Watched(of_class):
        def __init__(self, ways, jobs):
            super().__init__(ways, jobs)
            processes.extend(self._processes)

        def _ask(self, tasks, budget):
            out = super()._ask(tasks, budget)
            answered.append(len(self._ways.assembly._ahead) + len(out))
            return out

    monkeypatch.setattr(plan, "Workers", Watched)
    return processes, answered


@pytest.mark.parametrize(
    ("scene", "options"),
    [
        (cases.interlocked, {}),  # a group, and clearances
        pytest.param(cases.bolted_plate, {}, marks=pytest.mark.slow),
        pytest.param(cases.bolted_plate, {"target": "plate", "clearance": 1e-4}, marks=pytest.mark.slow),
    ],
)
def test_the_plan_is_the_same_bytes_for_any_number_of_jobs(scene, options, started):
    processes, answered = started
    assert planned(1, scene, **options) == planned(2, scene, **options)
    assert len(processes) == 2 and sum(answered) > 0
    assert all(process.poll() is not None for process in processes)


@pytest.mark.slow
def test_a_worker_that_dies_changes_nothing(started, monkeypatch):
    processes, answered = started
    send, one = workers.Workers._send, planned(1)

    def die(self, process, message):
        sent = send(self, process, message)
        if process is processes[0] and isinstance(message[0], bool):  # tasks
            process.kill()
        return sent

    monkeypatch.setattr(workers.Workers, "_send", die)
    assert planned(2) == one
    assert sum(answered) > 0


@pytest.mark.slow
def test_ctrl_c_ends_the_workers_and_keeps_the_steps(started):
    def interrupt(parts, text):
        raise KeyboardInterrupt

    found = vp.planning.disassembly(cases.bolted_plate(), budget=600.0, motion="mates", jobs=2, found=interrupt)
    assert found.interrupted and [step.parts for step in found.steps] == [("nut",)]
    assert len(started[0]) == 2 and all(process.poll() is not None for process in started[0])


def test_no_jobs_are_refused():
    with pytest.raises(vp.VpframeError, match="at least 1"):
        vp.planning.disassembly(cases.bolted_plate(), jobs=0)

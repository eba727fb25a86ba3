"""Kill -9 of the study, of a worker, of the scheduler: what was finished stays, nobody is left, resume works."""

import asyncio
import contextlib
import os
import re
import signal
import subprocess
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import Security
from distributed.comm import connect

from tests.vpframe.studies.scripts import below, children, firsts, slow, start
from tests.vpframe.waiting import wait_until
from vpframe.studies import cluster as studies_cluster
from vpframe.studies.cluster import WorkersGoneError
from vpframe.studies.job import Machines, read_job
from vpframe.studies.results import answer
from vpframe.studies.variants import random_sample


@contextlib.contextmanager
def started(*arguments: object, module: str = "vpframe") -> Iterator[subprocess.Popen[str]]:
    """A program, and no process of its session after it."""
    process = start(*arguments, module=module)
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def finish(script: Path, out: Path, samples: int) -> list[str]:
    """Resume with one job; the answers by index."""
    process = start("study", script, "--samples", samples, "--jobs", 1, "--out", out, "--resume")
    _, error = process.communicate(timeout=250)
    assert process.returncode == 1, error
    records = firsts(out)
    assert [one["index"] for one in records] == list(range(samples)), "each once"
    return [answer(one) for one in records]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> list[str]:
    """The answers of twelve variants that nobody disturbed."""
    folder = tmp_path_factory.mktemp("whole")
    return finish(slow(folder, 0.0), folder / "runs", 12)


@pytest.mark.slow
def test_a_killed_study_loses_what_was_running_and_leaves_nobody(tmp_path: Path, whole: list[str]) -> None:
    script, out = slow(tmp_path, 0.5), tmp_path / "runs"
    with started("study", script, "--samples", 12, "--jobs", 2, "--out", out) as process:
        wait_until(lambda: len(firsts(out)) >= 3)
        relatives = below(process.pid)
        assert len(relatives) >= 4, "two workers, two children"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        before = firsts(out)
        wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in relatives), 20.0)
    assert 3 <= len(before) < 12
    kept = (out / "results.jsonl").read_text()
    assert finish(slow(tmp_path, 0.5), out, 12) == whole
    assert (out / "results.jsonl").read_text().startswith(kept)


@pytest.mark.slow
def test_a_killed_worker_costs_no_variant(tmp_path: Path, whole: list[str]) -> None:
    script, out = slow(tmp_path, 0.5), tmp_path / "runs"
    with started("study", script, "--samples", 12, "--jobs", 2, "--retries", 3, "--out", out) as process:
        wait_until(lambda: len(firsts(out)) >= 2)
        child = next(pid for pid in below(process.pid) if pid in children(script))
        worker = next(pid for pid in below(process.pid) if child in below(pid))
        os.kill(worker, signal.SIGKILL)
        _, error = process.communicate(timeout=250)
        assert (process.returncode, error) == (1, "")
    records = firsts(out)
    assert [answer(one) for one in records] == whole
    assert {one["status"] for one in records} == {"ok", "no"}


@pytest.mark.slow
def test_a_variant_whose_workers_are_all_killed_is_a_crash_and_the_others_finish(tmp_path: Path) -> None:
    text = slow(tmp_path, 0.05).read_text()
    # the child of a worker kills the worker: as if the machine had no memory left
    script = tmp_path / "task.py"
    script.write_text(text.replace("    time.sleep(0.05)", "    if v.index == 3:\n        os.kill(os.getppid(), 9)"))
    out = tmp_path / "runs"
    with started("study", script, "--samples", 8, "--jobs", 2, "--retries", 1, "--out", out) as process:
        _, error = process.communicate(timeout=280)
        assert (process.returncode, error) == (1, "")
    records = firsts(out)
    assert [one["index"] for one in records] == list(range(8))
    assert (records[3]["status"], records[3]["reason"]) == ("crashed", "its worker was killed, 2 times")
    killed = [one["index"] for one in records if one["status"] == "crashed"]
    assert len(killed) <= 2, "of the others, at most one that both workers had while they died"


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A scheduler and two workers, as on other machines: address, and the scheduler."""
    folder.mkdir()
    here = ("--host", "127.0.0.1", "--port", 0, "--no-dashboard")
    with contextlib.ExitStack() as stack:
        file = folder / "scheduler.json"
        given = (*here, "--scheduler-file", file)
        scheduler = stack.enter_context(started(*given, module="distributed.cli.dask_scheduler"))
        wait_until(file.exists)
        address = re.search(r'"address": "(tcp://[\d.:]+)"', file.read_text())
        assert address is not None
        for name in ("one", "two"):
            worker = ("--nthreads", 1, "--no-dashboard", "--name", name, "--local-directory", folder / name)
            stack.enter_context(started(address[1], *worker, module="distributed.cli.dask_worker"))
        yield address[1], scheduler


@pytest.mark.slow
def test_workers_of_a_cluster_need_no_files(tmp_path: Path, whole: list[str]) -> None:
    script, out = slow(tmp_path / "here", 0.0), tmp_path / "runs"
    with cluster(tmp_path / "there") as (address, _):
        process = start("study", script, "--samples", 12, "--cluster", address, "--out", out)
        _, error = process.communicate(timeout=250)
        assert (process.returncode, error) == (1, "")
        folders = list((tmp_path / "there").rglob("vpframe-study-*"))
    assert [answer(one) for one in firsts(out)] == whole
    assert folders == [], "what was unpacked there is removed"
    assert not (tmp_path / "here" / "running").exists(), "it ran there, not here"


@pytest.mark.slow
def test_a_killed_scheduler_ends_the_study_in_one_line_and_resume_does_the_rest(tmp_path: Path, whole) -> None:
    script, out = slow(tmp_path / "here", 0.5), tmp_path / "runs"
    with cluster(tmp_path / "there") as (address, scheduler):
        process = start("study", script, "--samples", 12, "--cluster", address, "--out", out)
        wait_until(lambda: len(firsts(out)) >= 3)
        os.kill(scheduler.pid, signal.SIGKILL)
        _, error = process.communicate(timeout=120)
        assert process.returncode == 2
        assert error == "vpframe: the scheduler is lost; what was finished is kept, --resume runs what is missing\n"
    assert 3 <= len(firsts(out)) < 12
    assert finish(slow(tmp_path / "here", 0.5), out, 12) == whole


@pytest.mark.slow
def test_variants_whose_workers_have_all_gone_are_to_be_run_again(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(studies_cluster, "GONE", 1.0)
    job = read_job(slow(tmp_path, 1.0), 60.0, 2)
    sample = random_sample(job.variables, 6, 0)
    work = deque((variant, "") for variant in sample)
    with studies_cluster.connected(Machines(1), 1, 2) as client:
        done = studies_cluster.on_client(job, work, client, True)
        first = next(done)[0]
        client.cluster.scale(0)
        with pytest.raises(WorkersGoneError, match="all workers are gone; what was finished is kept, --resume runs"):
            list(done)
    assert sorted(variant.index for variant, _ in work) == [v.index for v in sample if v != first][-len(work) :]
    assert len(work) >= 4, "at most one more was finished before its worker went"


def test_nobody_else_on_this_machine_reaches_the_scheduler_or_a_worker(tmp_path: Path) -> None:
    with studies_cluster.connected(Machines(1), 1, 2) as client:
        scheduler, (worker,) = client.scheduler.address, client.nthreads()
        for address in (scheduler, worker):
            assert address.startswith("tls://127.0.0.1:")
            for stranger in (Security(), Security.temporary()):
                with pytest.raises((OSError, RuntimeError, TypeError)):
                    asyncio.run(_hello(address, stranger))
            with pytest.raises(OSError):
                asyncio.run(_hello(address.replace("tls:", "tcp:"), Security()))
            assert asyncio.run(_hello(address, client.security))


async def _hello(address: str, security: Security) -> bool:
    comm = await connect(address, timeout=2.0, **security.get_connection_args("client"))
    comm.abort()
    return True


@pytest.mark.parametrize(
    "address", [pytest.param("tcp://127.0.0.1:9", marks=pytest.mark.slow), "nonsense", "tls://127.0.0.1:9"]
)
def test_no_scheduler_is_one_line(tmp_path: Path, address: str) -> None:
    process = start("study", slow(tmp_path, 0.0), "--cluster", address, "--out", tmp_path / "runs")
    _, error = process.communicate(timeout=100)
    assert process.returncode == 2
    assert error.startswith(f"vpframe: --cluster {address}: no scheduler answers there")
    assert error.count("\n") == 1

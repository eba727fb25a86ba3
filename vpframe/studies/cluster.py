"""A study on Dask workers: of this machine (loopback and TLS), or of a cluster by its scheduler's address.

A plugin brings the script and its models to each worker once; the worker runs variants in child processes. Dask brings
variants to workers and outcomes back, and gives a variant whose worker has died to another one.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing import resource_tracker
from pathlib import Path
from types import ModuleType
from typing import Any

import dask.config
from distributed import (
    Client,
    Future,
    KilledWorker,
    LocalCluster,
    Security,
    Worker,
    WorkerPlugin,
    as_completed,
    get_worker,
)
from distributed.comm import connect

from vpframe import __version__
from vpframe.console import say
from vpframe.errors import VpframeError
from vpframe.processes import ctrl_c_blocked
from vpframe.studies.child import Children, Done, Work, unanswered
from vpframe.studies.job import Job, Machines
from vpframe.studies.variants import Variant

CONNECT = 10.0
"""s that a scheduler may take to answer"""
WAIT = 60.0
"""s to wait for a first worker"""
GONE = 60.0
"""s without any worker after which the study stops waiting for one"""
CHECK = 2.0
"""s between two counts of the workers"""
CLOSE = 5.0
"""s that closing may take"""
_UNWATCHED = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
"""settings without the data of the dashboard, which costs 9 % of a core with two idle workers"""
_LOST = "what was finished is kept, --resume runs what is missing"


class WorkersGoneError(VpframeError):
    """No worker was connected for `GONE` seconds; the variants submitted to workers are back in the work."""


def on_machines(job: Job, work: Work, machines: Machines) -> Done:
    """Run the variants of `work`, and those appended meanwhile, on the workers of `machines`.

    If all workers of this machine have ended, new ones are started, unless none of them has finished a variant.

    Raises
    ------
    WorkersGoneError: all workers have gone.
    VpframeError: no scheduler answers, it is lost, there is no worker, or a worker cannot run the script.
    """
    local = machines.cluster is None
    while work:
        before = len(work)
        with connected(machines, min(machines.jobs, before), job.retries) as client:
            if local and machines.dashboard:
                say(f"dashboard: {client.dashboard_link}")
            try:
                yield from on_client(job, work, client, local)
            except WorkersGoneError:
                if not local or len(work) >= before:
                    raise


@contextlib.contextmanager
def connected(machines: Machines, jobs: int, retries: int) -> Iterator[Client]:
    """A client of the cluster's scheduler, or of `jobs` worker processes on this machine that end with the block.

    Raises
    ------
    VpframeError: no scheduler answers, or no worker has joined.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(_quiet())
        if machines.cluster is None:
            security = _own_certificates()
            settings: dict[str, Any] = {"distributed.scheduler.allowed-failures": retries}
            if not machines.dashboard:
                settings |= _UNWATCHED
            stack.enter_context(dask.config.set(settings))
            stack.enter_context(_main_module_hidden())
            resource_tracker.ensure_running()  # started inside the block, it would unblock Ctrl-C
            with ctrl_c_blocked():
                cluster = LocalCluster(
                    n_workers=jobs, threads_per_worker=1, processes=True, host="127.0.0.1", memory_limit=None,
                    dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": machines.dashboard},
                    silence_logs=logging.CRITICAL, security=security,
                )  # fmt: skip
                stack.callback(cluster.close, timeout=CLOSE)
                client = Client(cluster, set_as_default=False)
        else:
            try:
                asyncio.run(_reach(machines.cluster))
                with ctrl_c_blocked():
                    client = Client(machines.cluster, set_as_default=False, timeout=CONNECT)
            except Exception as error:  # of many types: no such host, no such protocol, no certificates …
                raise VpframeError(f"--cluster {machines.cluster}: no scheduler answers there: {error}") from None
        stack.callback(client.close, timeout=CLOSE)
        try:
            client.wait_for_workers(1, timeout=WAIT)
        except TimeoutError:
            start = f"start some: dask worker {machines.cluster}"
            raise VpframeError(f"no worker joined within {WAIT:g} s; {start}") from None
        yield client


def _own_certificates() -> Security:
    """A certificate of this study alone, which scheduler, workers and client ask each other for: tasks are code, and
    any user of the machine can reach a loopback address.

    Raises
    ------
    VpframeError: the library that makes certificates is missing.
    """
    try:
        return Security.temporary()
    except ImportError:
        need = "several jobs prove themselves to each other with certificates, which need cryptography"
        raise VpframeError(f"{need} (pip install cryptography); or give --jobs 1") from None


async def _reach(address: str) -> None:
    """Raise where no client could connect: one that has failed prints a traceback when it is collected."""
    comm = await connect(address, timeout=CONNECT, **Security().get_connection_args("client"))
    comm.abort()


@contextlib.contextmanager
def _main_module_hidden() -> Iterator[None]:
    """New processes do not import the program that starts them: one without `if __name__ == "__main__":` would start
    its study again in each."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence the logs of Dask and its loop on standard error; its errors are raised or reported here."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client", "tornado.application")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


class StudyPlugin(WorkerPlugin):
    """A study on a worker: the script, unpacked unless the worker is on the same machine, and child processes."""

    def __init__(self, job: Job, local: bool) -> None:
        self.name = f"vpframe-study-{job.token}"
        self._version = __version__
        self._timeout, self._retries = job.timeout, job.retries
        self._script, self._files = (str(job.script.resolve()), {}) if local else job.bundle()
        self._folder = ""

    def setup(self, worker: Worker) -> None:
        """Unpack. Raises VpframeError where another version of vpframe is installed."""
        if self._version != __version__:
            where = worker.address
            raise VpframeError(f"worker {where} has vpframe {__version__}, the study {self._version}: install the same")
        script = Path(self._script)
        if self._files:
            self._folder = tempfile.mkdtemp(prefix=f"{self.name}-", dir=worker.local_directory)
            for name, content in self._files.items():
                path = Path(self._folder) / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            script = Path(self._folder) / script
        self.children = Children(script, self._timeout, self._retries)

    def teardown(self, worker: Worker) -> None:
        """End the children, remove what was unpacked."""
        self.children.close()
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)


def _run(plugin: str, variant: Variant, avoid: str) -> dict[str, Any]:
    """Run one variant on a worker; returns its outcome."""
    worker = get_worker()
    study = worker.plugins[plugin]
    assert isinstance(study, StudyPlugin)
    return study.children.run(variant, avoid) | {"address": worker.address}


def on_client(job: Job, work: Work, client: Client, local: bool) -> Done:
    """Run the variants of `work`, and those appended meanwhile, on a client's workers.

    local: whether they can read this machine's files.

    Raises
    ------
    WorkersGoneError, VpframeError: as `on_machines`.
    """
    plugin = StudyPlugin(job, local)
    try:
        try:
            client.register_plugin(plugin)
        except VpframeError:
            raise
        except Exception as error:  # of any type: what the worker raised
            raise VpframeError(f"a worker cannot load vpframe {__version__}: {error}; install the same there") from None
        yield from _Submitted(client, plugin.name).run(work)
    finally:
        with contextlib.suppress(Exception):  # the scheduler may be gone
            client.unregister_worker_plugin(plugin.name)


class _Submitted:
    """Variants submitted to workers: per thread one that runs and one that waits, so that no worker idles meanwhile.

    Dask blames a worker's death on its waiting variants too. A variant that Dask gives up and that may have waited is
    therefore submitted again, and no variant waits from then on.
    """

    def __init__(self, client: Client, plugin: str) -> None:
        self._client = client
        self._plugin = plugin
        self._variants: dict[Any, tuple[Variant, str]] = {}
        """submitted variants, by key of their futures"""
        self._waited: set[Any] = set()
        """keys of variants that may have waited behind another one"""
        self._ahead = 2
        """variants submitted per thread"""
        self._addresses: dict[str, str] = {}
        """address of a child's worker, by child"""
        self._completed = as_completed([], loop=client.loop, with_results=True, raise_errors=False)
        self._number = 0
        self._threads = 1
        self._counted = self._seen = -math.inf

    def run(self, work: Work) -> Done:
        """Yield outcomes in the order in which they come."""
        try:
            while work or self._variants:
                self._count()
                while work and len(self._variants) < self._ahead * self._threads:
                    self._submit(*work.popleft())
                variant, avoid, outcome = self._next()
                if outcome is None:
                    work.appendleft((variant, avoid))
                else:
                    yield variant, avoid, outcome
        except WorkersGoneError:
            work.extendleft(self._variants.values())
            raise

    def _count(self) -> None:
        """Count the workers' threads, every `CHECK` seconds: workers come and go."""
        now = time.monotonic()
        if now - self._counted < CHECK or self._client.status != "running":
            return
        self._counted = now
        threads = sum(self._client.nthreads().values())
        if threads or self._seen < 0.0:
            self._threads, self._seen = max(threads, 1), now
        elif now - self._seen > GONE:
            raise WorkersGoneError(f"all workers are gone; {_LOST}")

    def _submit(self, variant: Variant, avoid: str) -> None:
        others = None
        if avoid in self._addresses:
            others = [address for address in self._client.nthreads() if address != self._addresses[avoid]] or None
        self._number += 1
        future = self._client.submit(
            _run, self._plugin, variant, avoid, key=f"{self._plugin}-{self._number}", pure=False,
            workers=others, allow_other_workers=others is not None,
        )  # fmt: skip
        self._variants[future.key] = variant, avoid
        if self._ahead > 1:
            self._waited.add(future.key)
        self._completed.add(future)

    def _next(self) -> tuple[Variant, str, dict[str, Any] | None]:
        """Return the next finished variant and its outcome; None if it must be submitted again."""
        while not self._completed.has_ready():
            self._count()
            with self._completed.thread_condition:
                self._completed.thread_condition.wait(0.1)
        future: Future
        future, result = next(self._completed)
        variant, avoid = self._variants.pop(future.key)
        waited = future.key in self._waited
        self._waited.discard(future.key)
        if isinstance(result, dict):  # an outcome, even if its worker has died since
            self._addresses[result["worker"]] = result["address"]
            return variant, avoid, result
        error = result[1] if isinstance(result, tuple) else None
        if isinstance(error, KilledWorker):
            if waited:
                self._ahead = 1
                return variant, avoid, None
            return variant, avoid, _killed(error)
        if isinstance(error, VpframeError):
            raise error
        raise VpframeError(f"a worker failed: {error}" if error else f"the scheduler is lost; {_LOST}")


def _killed(error: KilledWorker) -> dict[str, Any]:
    """Return the outcome of a variant whose workers were all killed from outside."""
    times = error.allowed_failures + 1
    return unanswered("crashed", f"its worker was killed, {times} times", attempts=times, worker="", address="")

"""`drive`: run the verbs of several hands step by step until all have ended."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from vpframe.errors import TaskError
from vpframe.hands.gripper import Gripper
from vpframe.hands.segment import Outcome, Verb


def drive(
    hands: Mapping[str, Gripper], queues: dict[str, deque[Verb]], step: Callable[[], object]
) -> dict[str, Outcome]:
    """Run the verbs of each hand in order, those of different hands in the same steps.

    Returns the outcome of each hand's last verb, by name. An error of `step` ends all verbs.
    """
    outcomes: dict[str, Outcome] = {}
    running: dict[str, Verb] = {}

    def go_on(name: str, last: Outcome | None, failed: TaskError | None = None) -> None:
        """Start a hand's next segment, of the running verb or the next one; raise `failed` inside the running verb."""
        while name in running or queues[name]:
            if name not in running:
                running[name], last = queues[name].popleft(), None
            try:
                if failed is not None:
                    error, failed = failed, None
                    segment = running[name].throw(error)
                else:
                    segment = next(running[name]) if last is None else running[name].send(last)
            except StopIteration as end:
                outcomes[name] = end.value
                del running[name]
                continue
            hands[name].start(segment)
            return

    try:
        for name in queues:
            go_on(name, None)
        while running:
            step()
            for name in [n for n in queues if n in running]:
                try:
                    ended = hands[name].judge()
                except TaskError as error:
                    go_on(name, None, error)
                    continue
                if ended is not None:
                    go_on(name, ended)
    finally:
        for name in queues:
            hands[name].segment = None
            hands[name].doing = ""
    return outcomes

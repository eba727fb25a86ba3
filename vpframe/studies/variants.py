"""Variants: the values of one run's variables, sampled so that variant i is the same in every study of its seed."""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

from vpframe.errors import VpframeError
from vpframe.studies.distributions import Distribution, Value

if TYPE_CHECKING:
    import numpy as np

    from vpframe.scene.scene import Scene

Variables = Mapping[str, Distribution]
MOST = 10**6
"""maximum number of variants of a study"""
SEQUENCES = 16
"""number of independently scrambled Sobol' sequences of a study"""
_OPEN = 2.0**-54
"""keeps uniform numbers off 0 and 1, where quantiles may be infinite"""


@dataclass(frozen=True)
class Variant(Mapping[str, Value]):
    """The values of one variant by variable: `v["bore"]`; `v.rng` for what else is random in it."""

    index: int
    seed: int
    parameters: Mapping[str, Value]

    def __getitem__(self, name: str) -> Any:
        try:
            return self.parameters[name]
        except KeyError:
            known = ", ".join(map(repr, self.parameters))
            raise VpframeError(f"no variable {name!r} in VARIANTS; there are: {known}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def __hash__(self) -> int:
        return hash((self.index, self.seed))

    @cached_property
    def rng(self) -> np.random.Generator:
        """Random generator of the variant, independent of the one that drew its values."""
        import numpy as np

        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(self.index, 1)))


def random_sample(variables: Variables, count: int, seed: int) -> list[Variant]:
    """Return variants with independent values; variant i depends on the seed and i alone."""
    import numpy as np

    _check_count(count)
    made = []
    for i in range(count):
        u = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(i,))).random(len(variables))
        made.append(_at(variables, i, seed, u.tolist()))
    return made


def sobol_sample(variables: Variables, count: int, seed: int) -> list[Variant]:
    """Return variants at points of `SEQUENCES` scrambled Sobol' sequences in turn: means of n converge faster than
    1/sqrt(n), and the means of the sequences, which are independent, give the error (`sequence_of`).

    Source: Owen, "Scrambling Sobol' and Niederreiter-Xing points", J. Complexity 14 (1998), as in `scipy.stats.qmc`.
    """
    import numpy as np
    from scipy.stats import qmc

    _check_count(count)
    size = -(-count // SEQUENCES)
    points = [
        qmc.Sobol(len(variables), scramble=True, seed=np.random.default_rng(own)).random_base2((size - 1).bit_length())
        for own in np.random.SeedSequence(seed, spawn_key=(2,)).spawn(min(count, SEQUENCES))
    ]
    rows = (points[sequence_of(i)][i // SEQUENCES] for i in range(count))
    return [_at(variables, i, seed, row.tolist()) for i, row in enumerate(rows)]


def sequence_of(index: int) -> int:
    """Return the number of the sequence that a variant of `sobol_sample` is a point of."""
    return index % SEQUENCES


def grid(variables: Variables, levels: int, seed: int) -> list[Variant]:
    """Return all combinations of every value of a `Choice` and `levels` equally probable values of other variables."""
    _check_count(math.prod(distribution.count(levels) for distribution in variables.values()))
    values = [distribution.levels(levels) for distribution in variables.values()]
    combinations = itertools.product(*values)
    return [Variant(i, seed, dict(zip(variables, each, strict=True))) for i, each in enumerate(combinations)]


def _check_count(count: int) -> None:
    if not 1 <= count <= MOST:
        raise VpframeError(f"{count:,} variants; a study has at least one, and at most {MOST:,}")


def nominal(variables: Variables) -> Variant:
    """Return the variant of all nominal values."""
    return Variant(0, 0, {name: distribution.nominal for name, distribution in variables.items()})


def _at(variables: Variables, index: int, seed: int, u: list[float]) -> Variant:
    numbers = (min(max(x, _OPEN), 1.0 - _OPEN) for x in u)
    values = {name: d.quantile(x) for (name, d), x in zip(variables.items(), numbers, strict=True)}
    return Variant(index, seed, values)


def variables_of(module: ModuleType, script: Path) -> dict[str, Distribution]:
    """`VARIANTS` of a task script.

    Raises
    ------
    VpframeError: there are none, or what is there is no distribution; the message names the script.
    """
    given = getattr(module, "VARIANTS", None)
    if not isinstance(given, Mapping) or not given:
        example = "VARIANTS = {'bore': Normal(8.02e-3, 5e-6)}"
        raise VpframeError(f"{script}: says not what varies; write {example}, of `from vpframe.studies import Normal`")
    for name, distribution in given.items():
        if not isinstance(name, str) or not isinstance(distribution, Distribution):
            known = "Normal, Uniform, LogNormal, Triangular or Choice"
            raise VpframeError(f"{script}: VARIANTS[{name!r}] is {distribution!r}; give a {known}")
    return dict(given)


def bound(module: ModuleType, script: Path, variant: Variant) -> SimpleNamespace:
    """Return a study's script as a task script of one variant: `scene()`, `task(session)`, `OPTIONS`.

    Raises
    ------
    VpframeError: `scene` or `task` do not take the variant.
    """
    make: Callable[..., Any] | None = getattr(module, "scene", None)
    file = getattr(module, "FILE", None)
    names: dict[str, Any] = {"OPTIONS": dict(getattr(module, "OPTIONS", {}))}
    _takes(module.task, "task(session, v)", 2, script)
    names["task"] = lambda session: module.task(session, variant)
    if callable(make):
        _takes(make, "scene(v)", 1, script)
        names["scene"] = lambda: make(variant)
    elif isinstance(file, str | Path):
        names["scene"] = lambda: load(script.parent / file)
    return SimpleNamespace(**names)


def _takes(function: Callable[..., Any], wanted: str, count: int, script: Path) -> None:
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        name = wanted.partition("(")[0]
        raise VpframeError(f"{script}: `{name}` does not take the variant; write `def {wanted}: …`") from None


def load(path: str | Path, **options: Any) -> Scene:
    """Load like `vpframe.load`, but read a file once per process; each call returns a new scene with shared shapes."""
    import pinocchio as pin

    from vpframe.scene.scene import Scene

    read = _loaded(str(Path(path).resolve()), tuple(sorted(options.items())))
    parts = (part.copy(pose=pin.SE3(part.pose)) for part in read.parts)
    return Scene(parts, source=read.source, notes=read.notes, rules=read.rules)


@cache
def _loaded(path: str, options: tuple[tuple[str, Any], ...]) -> Scene:
    from vpframe.importers import load as read

    return read(path, **dict(options))

"""Packages whose names are imported at their first use."""

from __future__ import annotations

import subprocess
import sys
from types import ModuleType

import pytest

import collision
import constraints
import physics
import vpframe


@pytest.mark.parametrize("package", [collision, constraints, physics, vpframe], ids=lambda package: package.__name__)
def test_every_name_is_found_and_listed(package: ModuleType) -> None:
    assert dir(package) == sorted(package.__all__)
    for name in package.__all__:
        assert getattr(package, name) is getattr(package, name)
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'wheel'"):
        _ = package.wheel


@pytest.mark.parametrize(
    "code",
    [
        "import collision.classify; from collision import classify; assert callable(classify)",
        "from constraints import recognise; import constraints.recognition.recognise; assert callable(recognise)",
        "import vpframe.planning, vpframe as vp; assert vp.planning.__name__ == 'vpframe.planning'",
        "import vpframe as vp; assert vp.rules.__name__ == 'vpframe.session.rules'",
    ],
)
def test_a_name_of_a_module_means_what_the_package_says(code: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr

import pytest


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Each property of a kind is tested on each of its cases."""
    cases = getattr(metafunc.cls, "cases", ())
    if cases and "constraint" in metafunc.fixturenames:
        metafunc.parametrize(("constraint", "freedom"), [case[1:] for case in cases], ids=[case[0] for case in cases])

"""Functions of higher floors that lower floors call by name."""

import importlib

import vpframe
from vpframe import services


def test_every_service_is_a_function_that_there_is() -> None:
    for module, name in vpframe._SERVICES.values():
        assert callable(getattr(importlib.import_module(module), name))


def test_a_service_is_called_with_what_is_given(monkeypatch) -> None:
    monkeypatch.setattr(services, "_provided", {})
    services.provide({"joined": ("posixpath", "join"), "number": ("builtins", "int")})
    assert services.call("joined", "a", "b") == "a/b"
    assert services.call("number", "11", base=2) == 3

"""Options that several commands share."""

import argparse
import json
import os
from pathlib import Path

import pytest

from tests.vpframe.watching import box
from vpframe.app import options
from vpframe.scene.stl import write_stl


def parsed(add, *words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(exit_on_error=False)
    add(parser)
    return parser.parse_args(words)


@pytest.mark.parametrize(
    ("text", "seconds"), [("90", 90.0), ("60s", 60.0), ("5min", 300.0), ("soon", None), ("0s", None), ("-1", None)]
)
def test_a_time_is_more_than_zero(text: str, seconds: float | None) -> None:
    if seconds is None:
        with pytest.raises(argparse.ArgumentTypeError, match="time"):
            options.duration(text)
    else:
        assert options.duration(text) == seconds


def test_only_given_options_of_loading_are_passed_on() -> None:
    assert options.loading(parsed(options.add_model, "a.step")) == {}
    given = parsed(options.add_model, "a.step", "--deflection", "0.1mm", "--bodies", "split")
    assert options.loading(given) == {"deflection": pytest.approx(1e-4), "bodies": "split"}


def test_a_class_of_press_fit_is_a_tolerance() -> None:
    assert options.press_fit(parsed(options.add_press_fit)) is None
    tolerance = options.press_fit(parsed(options.add_press_fit, "--press-fit", "u8"))
    assert tolerance is not None and tolerance.press_fit == "u8"
    with pytest.raises(ValueError, match="z99"):
        options.press_fit(parsed(options.add_press_fit, "--press-fit", "z99"))


def test_several_models_are_one_scene(tmp_path: Path) -> None:
    for name in ("a", "b"):
        mesh = box((0.1, 0.1, 0.1)).mesh
        write_stl(tmp_path / f"{name}.stl", mesh.vertices, mesh.triangles)
    given = parsed(options.add_model, "a.stl", "--unit", "m")
    files = [str(tmp_path / name) for name in ("a.stl", "b.stl")]
    (alone,) = options.scene_of(given, files[0]).names
    assert options.scene_of(given, *files).names == (f"a/{alone}", f"b/{alone.replace('a', 'b')}")


def test_a_document_is_all_that_goes_to_standard_output(capfd: pytest.CaptureFixture[str]) -> None:
    with options.document(True) as emit:
        os.write(1, b"printed by a C++ library\n")
        emit({"answer": 1})
    out, err = capfd.readouterr()
    assert json.loads(out) == {"answer": 1} and "C++" in err
    with options.document(False) as emit:
        print("as it is")
        emit({"answer": 1})
    assert capfd.readouterr().out == "as it is\n"


def test_without_view_there_is_no_viewer() -> None:
    assert options.viewer_of(False, True) is None

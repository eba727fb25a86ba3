import pytest

from constraints.recognition.fastener_names import base_name, name_hint, name_words


@pytest.mark.parametrize(
    ("name", "kind", "sizes"),
    [
        ("M3 Hardware:1/M3x8 BHCS:1/M3x8 BHCS v2:18", "screw", (3e-3, 8e-3)),
        ("M2x10 self tapping:3", "self-tapping screw", (2e-3, 10e-3)),
        ("FHS_M2_5X10:4", "screw", (2.5e-3, 10e-3)),
        ("DIN 912 M5x16", "screw", (5e-3, 16e-3)),
        ("Zylinderschraube M4x12", "screw", (4e-3, 12e-3)),
        ("M3x5x4 heatset", "threaded insert", (3e-3, 5e-3, 4e-3)),
        ("Federring M4", "washer", ()),
        ("Magnet 6x3", "magnet", (6e-3, 3e-3)),
        ("608ZZ", "bearing", ()),
        ("o-ring 20x2", "seal", (20e-3, 2e-3)),
    ],
)
def test_kind_and_sizes_of_a_name(name, kind, sizes):
    hint = name_hint(name_words(name))
    assert hint.kind == kind
    assert hint.sizes == pytest.approx(sizes)


@pytest.mark.parametrize(
    "name", ["screw holder", "bearing_housing", "magnet pocket", "belt guide", "plate", "keyboard"]
)
def test_what_is_made_for_a_fastener_is_none(name):
    assert name_hint(name_words(name)).kind == ""


def test_the_own_name_has_no_path_and_no_number_of_an_instance():
    assert base_name("top:1/M3 Hardware:1/M3x8 BHCS v2:18") == "M3x8 BHCS"
    assert base_name("nut (2)") == "nut"

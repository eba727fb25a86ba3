import pytest

from vpframe.errors import VpframeError
from vpframe.scene.overlap_rules import OverlapRule, parsed, product, read_beside, rule_of


def test_a_pattern_names_a_part_its_product_the_end_of_its_path_or_all_of_a_subassembly():
    (rule,) = parsed(["M2x10*:housing=thread"])
    assert rule.names("kit:1/M2x10 self tapping:3", "frame/housing") and rule.names("housing:2", "M2x10")
    assert not rule.names("M2x10", "lid")
    (one,) = parsed(["gearbox=clash"])
    assert one.names("gearbox/shaft", "anything") and not one.names("shaft", "anything")


def test_the_first_rule_that_names_a_pair_decides():
    rules = parsed(["screw:lid=clash", "screw*=thread"])
    assert [rule_of(rules, "screw", other).means for other in ("lid", "plate")] == ["clash", "thread"]
    assert rule_of(rules, "nut", "plate") is None


def test_the_product_of_a_part_has_no_number():
    assert [product(name) for name in ("a/bolt:3", "bolt_12", "bolt (2)", "M3x8")] == ["bolt", "bolt", "bolt", "M3x8"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[overlaps]]\nmeans = "clash"\n', "unknown key 'overlaps'"),
        ('[[overlap]]\nparts = ["a"]\nmeans = "clash"\nforce = 3\n', "overlap 1: unknown key 'force'; one of parts"),
        ('[[overlap]]\nparts = ["a"]\nmeans = "glued"\n', "means is 'glued'; one of thread"),
        ('[[overlap]]\nparts = ["a", "b", "c"]\nmeans = "clash"\n', "write one or two names"),
        ('[[overlap]]\nmeans = "clash"\n', "write either parts or kind"),
        ('[[overlap]]\nkind = "thread"\nmeans = "soft"\n', "kind is 'thread'"),
        ('[[overlap]]\nparts = ["a"]\nmeans = "soft"\npitch = 1\n', "only a thread has a pitch"),
        ('[[overlap]]\nparts = ["a"]\nmeans = "soft"\ndepth = "1"\n', "depth is '1'; write millimetres"),
        ("[[overlap", "not a rules file"),
        ("[overlap]\n", "write [[overlap]]"),
    ],
)
def test_a_mistake_in_the_rules_is_one_line_that_names_the_place(tmp_path, text, says):
    file = tmp_path / "gearbox.vpframe.toml"
    file.write_text(text)
    with pytest.raises(VpframeError) as error:
        read_beside(tmp_path / "gearbox.step")
    assert says in str(error.value) and str(file) in str(error.value) and "\n" not in str(error.value)


def test_options_of_a_command_are_rules_too():
    assert parsed(["a*:b=thread", "c=clash", "press fit=clash"]) == (
        OverlapRule("thread", ("a*", "b"), source="rule 'a*:b=thread'"),
        OverlapRule("clash", ("c",), source="rule 'c=clash'"),
        OverlapRule("clash", kind="press fit", source="rule 'press fit=clash'"),
    )
    for wrong in ("a:b", "=clash", "a:b:c=clash", "a:b=meant"):
        with pytest.raises(VpframeError):
            parsed([wrong])

"""`--where` expressions: what they select, and one clear line for what they cannot mean."""

from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.data.slots.select import WhereError, parse_where, select_rows
from pipeline.data.spec import EpisodeSpec

SPEC = EpisodeSpec("click_bell", "aloha-agilex", 3, 0.1, "clean", 7, 42)
FIELDS = asdict(SPEC) | {
    "average_speed": 0.08,
    "maximum_speed": 0.15,
    "T_meet": 2.5,
    "split": "validation",
}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("level=3.0 and 4. > level", True),
        ("level in (1.0, 2)", False),
        ("level=3", True),
        ("level==2", False),
        ("level=3 and task=click_bell", True),
        ("level=3 and task=press_stapler", False),
        ("level=1 or level=3 and slot<8", True),
        ("(level=1 or level=3) and slot>8", False),
        ("not level=1", True),
        ("not (level=3 and slot=7)", False),
        ("task in (press_stapler, click_bell)", True),
        ("task not in (click_bell)", False),
        ("task in click_bell", True),
        ("task in ()", False),
        ("task != 'click bell'", True),
        ('embodiment="aloha-agilex"', True),
        ("embodiment = aloha-agilex and alpha>=0.1 and alpha<.2", True),
        ("seed>=43", False),
        ("domain=clean", True),
        ("2 < level <= 3", True),
        ("8 > slot", True),
        ("task='level'", False),
        ("average_speed < 0.1 and maximum_speed>=.15", True),
        ("2 < T_meet < 3 and split=validation", True),
        ("split in (train, test)", False),
    ],
)
def test_selects(text: str, expected: bool):
    assert select_rows([FIELDS], parse_where(text)).tolist() == [expected]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "speed=3",
            r"'speed' is no column \(columns: task, embodiment, level, alpha, domain, slot",
        ),
        ("", "is empty: leave it out"),
        ("  ", "is empty: leave it out"),
        ("task>3", "task is a text, which has no order: use =, != or in"),
        ("a < task", "task is a text"),
        ("task='click_bell", "cannot read"),
        ("level=1.5", "level '1.5' is not a whole number"),
        ("level", "level is no test"),
        ("level=", "cannot be read: join tests"),
        ("level=fast", "level 'fast' is not a whole number"),
        ("level=3 task=x", "did not expect 'task'; join tests with and / or"),
        ("(level=3", "cannot be read"),
        ("level=3 and", "cannot be read: join tests"),
        ("level ~ 3", "cannot read '~ 3'"),
        ("level=and", "cannot be read"),
        ("__class__=3", "'__class__' is no column"),
        ("level not 3", "cannot be read"),
        ("task = click bell", "did not expect 'bell'"),
        ("task = level", "'level' is no value for task; quote it"),
        ("task in (a b)", "did not expect 'b'"),
        ("level in (1, 2", "write values of in as \\(one, another\\)"),
        ("level=3, slot=2", "is no test"),
        ("level(3) = 2", "is no column"),
        ("seed < 99999999999999999999", "seed '99999999999999999999' is not a whole number from"),
        ("level=1 or " * 400 + "level=1", "has 4407 characters, more than 4000"),
    ],
)
def test_errors_are_one_line_and_name_the_fields(text: str, words: str):
    with pytest.raises(WhereError, match=words) as caught:
        parse_where(text)
    assert "\n" not in str(caught.value)
    assert ("columns:" in str(caught.value)) == ("is no column" in str(caught.value))


def test_the_longest_expressions_are_evaluated_or_refused_in_one_line():
    assert select_rows([FIELDS], parse_where(" or ".join(["level=3"] * 350))).all()
    with pytest.raises(WhereError, match="cannot be read"):
        parse_where("not " * 995 + "level=3")


@given(
    st.text(st.sampled_from("level=3 task in(click_bell,)'\"<!x[]{}.:;\n\\#@lambda"), max_size=40)
)
def test_any_text_is_an_expression_or_one_line(text: str):
    try:
        select_rows([FIELDS], parse_where(text))
    except WhereError as error:
        assert "\n" not in str(error)


ATOMS = st.tuples(
    st.sampled_from(["level", "slot", "seed"]),
    st.sampled_from(["==", "!=", "<", "<=", ">", ">="]),
    st.integers(0, 4),
)


@given(
    st.recursive(ATOMS, lambda x: st.tuples(x, st.sampled_from(["and", "or"]), x)),
    st.integers(0, 3),
    st.integers(0, 4),
)
def test_agrees_with_python(tree: tuple, level: int, slot: int):
    def text(node: tuple) -> str:
        return (
            f"({text(node[0])} {node[1]} {text(node[2])})"
            if node[1] in ("and", "or")
            else f"{node[0]} {node[1]} {node[2]}"
        )

    spec = EpisodeSpec("t", "e", level, 0.1, "clean", slot, 2)
    expected = eval(text(tree), {"level": level, "slot": slot, "seed": 2})
    assert select_rows([asdict(spec)], parse_where(text(tree))).tolist() == [expected]

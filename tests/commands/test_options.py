"""Every option of every command refuses what its type cannot be, in one line that names it, before
anything happens."""

import math

import pytest
from typer import TyperException

from pipeline.commands.bounded import check_of, name_of
from tests.commands.hostile import COMMANDS, kind_of, refused, words_of


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_option_refuses_what_its_type_cannot_be(words):
    for its, param, text in refused():
        if its == words:
            with pytest.raises(TyperException) as error:
                COMMANDS[words].main(words_of(words, param, text), standalone_mode=False)
            said = error.value.message
            assert (
                said.startswith(f"{name_of(param)} ") and said.isprintable() and len(said) < 400
            ), said[:300]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_number_has_bounds_and_nothing_escapes_the_check(words):
    for param in COMMANDS[words].params:
        kind, info = kind_of(param), param.type_descriptor.parameter_info
        if kind in (int, float):
            assert math.isfinite(info.min) and math.isfinite(info.max) and info.min < info.max, (
                param.name
            )
        assert (
            check_of(param) is not None
            or kind is bool
            or param.type_descriptor.is_choice
            or param.default == ""
        ), param.name

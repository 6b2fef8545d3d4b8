"""A registry is a mapping that gives a name once and lists its names where one is unknown."""

import pickle

import pytest

from pipeline.registry import Registry, UnknownName


@pytest.fixture
def tools():
    registry = Registry[int]("tool")
    registry.add("saw", 1)
    registry.add("axe", 2)
    return registry


def test_it_is_a_mapping_in_the_order_of_adding(tools):
    assert dict(tools) == {"saw": 1, "axe": 2}
    assert (list(tools), len(tools), "axe" in tools, "pen" in tools) == (
        ["saw", "axe"],
        2,
        True,
        False,
    )
    assert (tools["saw"], tools.get("axe"), tools.get("pen")) == (1, 2, None)
    assert list(tools.items()) == [("saw", 1), ("axe", 2)]


def test_adding_returns_the_object_so_that_a_decorator_can(tools):
    item = object()
    assert Registry[object]("thing").add("it", item) is item


def test_a_taken_name_is_refused_and_keeps_its_object(tools):
    with pytest.raises(ValueError, match="tool 'saw' is registered twice"):
        tools.add("saw", 3)
    assert tools["saw"] == 1


@pytest.mark.parametrize("lookup", [lambda r: r["pen"], lambda r: r.remove("pen")])
def test_an_unknown_name_is_one_line_with_the_known_ones(tools, lookup):
    with pytest.raises(UnknownName) as error:
        lookup(tools)
    assert str(error.value) == "no tool 'pen': choose from saw, axe"
    assert isinstance(error.value, KeyError)
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)
    with pytest.raises(UnknownName, match=r"no pen 'x': choose from \(none\)"):
        Registry[int]("pen")["x"]


def test_what_is_removed_can_be_added_again(tools):
    assert tools.remove("saw") == 1
    assert "saw" not in tools
    tools.add("saw", 5)
    assert dict(tools) == {"axe": 2, "saw": 5}

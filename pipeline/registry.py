"""Objects of one kind by name: tasks, object families, robots, exporters, stages of annotation."""

from abc import ABCMeta
from collections.abc import Iterator, Mapping
from importlib import import_module


class UnknownName(KeyError):
    """A name that a registry does not have; its message is one line that lists those it has."""

    def __str__(self) -> str:
        return str(self.args[0])


def place_in(module: str | None, kind: type) -> None:
    """Set the module of a class that a call of `type` has made to the one that registers it."""
    if module is not None and kind.__module__ == ABCMeta.__module__:
        kind.__module__ = module


class Registry[T](Mapping[str, T]):
    """Objects of one kind by name, in the order in which they were added. `kind` is for errors,
    e.g. "task". `modules` names the module that adds an object when it is asked for."""

    def __init__(self, kind: str, modules: Mapping[str, str] | None = None) -> None:
        self.kind = kind
        self._items: dict[str, T] = {}
        self._modules = dict(modules or {})

    def add(self, name: str, item: T) -> T:
        """Enter an object under a name and return it. Raises ValueError for a name that is
        taken."""
        place = getattr(item, "__module__", None)
        if name in self._items or self._modules.get(name, place) != place:
            raise ValueError(f"{self.kind} {name!r} is registered twice: choose another name")
        self._items[name] = item
        return item

    def remove(self, name: str) -> T:
        """Take an object out again and return it. Raises UnknownName."""
        item = self[name]
        del self._items[name]
        return item

    def __getitem__(self, name: str) -> T:
        """The object of a name. Raises UnknownName."""
        if name not in self._items and name in self._modules:
            import_module(self._modules[name])
        try:
            return self._items[name]
        except KeyError:
            raise UnknownName(
                f"no {self.kind} {name!r}: choose from {', '.join(self) or '(none)'}"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self._items or name in self._modules

    def __iter__(self) -> Iterator[str]:
        return iter({**self._modules, **self._items})

    def __len__(self) -> int:
        return len({**self._modules, **self._items})

"""The robots, a file each. Every module of this package registers one; docs/add_a_robot.md walks through a new one."""

import importlib
import pkgutil


def discover() -> None:
    """Import every module of this package, in the order of their names."""
    for name in sorted(module.name for module in pkgutil.iter_modules(__path__)):
        importlib.import_module(f"{__name__}.{name}")


discover()

"""The tasks, by name. Every module of this package that defines a task is imported here."""

import importlib
import pkgutil

from pipeline.tasks.contract import INTERCEPTION, TASKS, TRACKING, Draw, Placement, Region, Task, middle, place, register, side_of

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["INTERCEPTION", "TASKS", "TRACKING", "Draw", "Placement", "Region", "Task", "middle", "place", "register", "side_of"]

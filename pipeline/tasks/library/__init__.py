"""The tasks by suite and kind, with their sentences in phrases/. One file holds a task and those
that vary it; all are imported here."""

import importlib
import pkgutil

for _module in pkgutil.walk_packages(__path__, f"{__name__}."):
    importlib.import_module(_module.name)

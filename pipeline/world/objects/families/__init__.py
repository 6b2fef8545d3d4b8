"""The object families, a file each (or a few of a kind). Every module of this package is imported here and registers its own."""

import importlib
import pkgutil

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

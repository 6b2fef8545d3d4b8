"""One line on the machine and the date of a figure."""

import json
import os
import re
from datetime import date
from pathlib import Path

from pipeline.run.provenance import machine


def hardware(device: str = "") -> str:
    """Processor, cores, load, rendering device (with Mesa's version where it is Mesa's) where
    given, date."""
    load = os.getloadavg()[0]
    parts = [
        f"{machine()['processor']}, {os.cpu_count()} cores, load {load:.1f}",
        *([device + mesa()] if device else []),
        str(date.today()),
    ]
    return "; ".join(parts)


def mesa() -> str:
    """Version of the Mesa driver that VK_ICD_FILENAMES names, e.g. ", Mesa 25.0.7"; empty where
    there is none."""
    try:
        icd = Path(os.environ.get("VK_ICD_FILENAMES", ""))
        library = Path(json.loads(icd.read_text())["ICD"]["library_path"])
        found = re.search(
            rb"Mesa (\d+\.\d+\.\d+)",
            (library if library.is_absolute() else icd.parent / library).read_bytes(),
        )
    except (OSError, ValueError, KeyError):
        return ""
    return f", Mesa {found[1].decode()}" if found else ""

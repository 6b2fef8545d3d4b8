"""One line that says where and when a figure was measured."""

import os
from datetime import date

from pipeline.build import processor


def hardware(device: str = "") -> str:
    """Processor, cores, load, rendering device where given, date."""
    load = os.getloadavg()[0]
    parts = [f"{processor()}, {os.cpu_count()} cores, load {load:.1f}", *([device] if device else []), str(date.today())]
    return "; ".join(parts)

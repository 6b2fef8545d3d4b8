"""What a task is, and all tasks by name."""

from . import library
from .contract import (
    INTERCEPTION,
    TASKS,
    TRACKING,
    Draw,
    Placement,
    Region,
    Task,
    register,
    side_of,
)
from .layout import lay_out, middle

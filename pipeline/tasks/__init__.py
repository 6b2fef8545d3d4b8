"""What a task is, and all tasks by name."""

from pipeline.tasks import library
from pipeline.tasks.contract import (
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
from pipeline.tasks.layout import lay_out, middle

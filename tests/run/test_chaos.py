"""A build that is killed in the middle of writing every kind of file, finds the disk full and its files damaged, ends as if nothing
had been. The large version, with Ray workers: python -m benchmarks.chaos."""

import os
from random import Random

from benchmarks.chaos.compare import compare
from benchmarks.chaos.harness import Fresh, damage
from benchmarks.chaos.traps import Control
from pipeline.run.names import recipe_from
from pipeline.run.plan import mean_parts
from tests.run.command import temporaries

RECIPE = recipe_from({"tasks": ["click_bell", "stamp_seal"], "embodiments": "aloha", "levels": [1], "episodes": 5, "attempts": 8})
KILLED, FULL, DONE = -9, 2, 0

LIVES = (
    *((("worker", "drawing", 3), KILLED), (("episode", "half", 1), KILLED), (("asset", "whole", 0), KILLED)),
    *((("episode", "renamed", 2), KILLED), (("episode", "full", 0), FULL)),
    *((("attempts", "whole", 0), KILLED),),
)
"""The trap that is set in each life, after so many passes, and how the life must end."""


def test_a_build_that_is_killed_while_it_writes_ends_as_if_nothing_had_been(built, tmp_path):
    root, chance, damaged = tmp_path / "disturbed", Random(1), list[str]()
    fresh = Fresh(RECIPE, Control(tmp_path / "control"), built)
    assert fresh.live(tmp_path / "reference") == DONE
    for number, (trap, end) in enumerate(LIVES):
        assert fresh.live(root, *trap) == end, trap
        assert fresh.control.sprung[number:] == [f"{trap[0]}-{trap[1]}"]
        damaged += [damage(root, chance), damage(root, chance)]
    assert {what.split()[1] for what in damaged} <= {"truncated", "flipped", "removed"}
    assert fresh.live(root) == DONE
    found = compare(tmp_path / "reference", root)
    assert found.identical, found
    assert found.slots == 10 and found.same > 10
    assert not temporaries(root) and not any(root.glob("running/*"))


def test_the_size_of_an_episode_with_a_flipped_bit_is_known_or_left_out(built, tmp_path):
    whole, copy = next(built.glob("episodes/**/*.hdf5")).read_bytes(), tmp_path / "episode.hdf5"
    counted = 0
    for start in range(0, len(whole), len(whole) // 40):
        copy.write_bytes(whole[:start] + bytes([whole[start] ^ 1]) + whole[start + 1 :])
        parts = mean_parts([copy])
        counted += not parts or round(sum(parts.values())) == len(whole)
    assert counted >= 40
    copy.unlink()
    os.mkfifo(copy)
    assert mean_parts([copy]) == {}

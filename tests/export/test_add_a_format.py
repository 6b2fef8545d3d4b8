"""The format that docs/add_a_format.md adds works: it is registered, exports, checks, and is known
to the command line."""

import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.commands.export import format_options
from pipeline.data.episode.file import open_episode
from pipeline.export import EXPORTERS, ExportError, parse_options
from tests.export.running import check_export, run
from tests.synthetic import episode_path, make_episode

PAGE = Path(__file__).parents[2] / "docs" / "add_a_format.md"


@pytest.fixture
def npz():
    """The page's class, registered while the test runs."""
    (code,) = re.findall(
        r"^```python\n(\"\"\"npz:.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL
    )
    names: dict[str, object] = {"__name__": "npz_format"}
    exec(compile(code, str(PAGE), "exec"), names)
    yield code
    EXPORTERS.remove("npz")


def test_the_format_of_the_page(npz, tmp_path):
    episodes = [
        make_episode(episode_path(tmp_path, slot=i), slot=i, seed=i, frames=3 + i) for i in range(2)
    ]
    out = tmp_path / "exports" / "npz"
    assert run("npz", tmp_path, out, episodes, camera="left")["options"] == {"camera": "left"}
    for i, path in enumerate(episodes):
        with open_episode(path) as e, np.load(out / f"episode_{i}.npz") as got:
            np.testing.assert_array_equal(got["action"], e.array("joint_action/vector"))
            np.testing.assert_array_equal(got["images"][2], e.rgb("left_camera", 2))
    assert check_export(tmp_path, out, episodes) == []
    (of_page,) = format_options(["npz"])
    assert of_page.opts == ["--camera"] and not of_page.is_flag
    with pytest.raises(ExportError, match="--camera 'top': choose head or left or right"):
        parse_options("npz", EXPORTERS["npz"].options, {"camera": "top"})
    assert len(npz.splitlines()) < 150

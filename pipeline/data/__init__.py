"""What is stored: recipes, datasets, episodes. Opens anywhere; nothing of the simulator is imported.

from pipeline.data import Dataset, open_episode

dataset = Dataset("out/smoke")
for path in dataset.accepted(dataset.recipe()):
    with open_episode(path) as episode:
        print(episode.spec, len(episode), episode.array("joint_state/vector").shape)
"""

from pipeline.data.dataset import Dataset, DatasetError
from pipeline.data.episode import Episode, EpisodeError, EpisodeFile, open_episode
from pipeline.data.errors import DominoError
from pipeline.data.recipe import Cell, Recipe, RecipeError, Slot, parse_recipe
from pipeline.data.recipe_file import read_recipe
from pipeline.data.spec import EpisodeSpec
from pipeline.data.state_log import Event, StateLog

__all__ = [
    "Cell",
    "Dataset",
    "DatasetError",
    "DominoError",
    "Episode",
    "EpisodeError",
    "EpisodeFile",
    "EpisodeSpec",
    "Event",
    "Recipe",
    "RecipeError",
    "Slot",
    "StateLog",
    "open_episode",
    "parse_recipe",
    "read_recipe",
]

"""Rounds of corrections (DAgger, Ross et al. 2011): a trained network acts, the reactive expert takes over, the next networks learn
from that, too."""

from pathlib import Path

from pipeline.data.recipe.model import Recipe
from pipeline.data.rules import Corrections
from pipeline.evaluate.policy import PolicyName
from pipeline.evaluate.protocol import Runner
from training.ladder.demonstrations import Demonstration, make_demonstrations
from training.ladder.samples import LadderError


def correct(recipe: Recipe, policy: PolicyName, number: int, where: Path, run: Runner) -> list[Demonstration]:
    """The corrections of a policy in round `number`, from 1: as many of each cell as the recipe has demonstrations.

    Their scenes are those of the recipe's seed plus `number`. What is not below `where` yet is made and kept there. Raises
    LadderError if the expert could not take over in any of them.
    """
    corrections = Corrections(policy=policy.text, label=policy.label)
    recipe = recipe.model_copy(update={"seed": recipe.seed + number, "corrections": corrections})
    found = list(make_demonstrations(recipe, where, run))
    if not found:
        failed = f"{', '.join(recipe.tasks)}: the expert finished no episode that {policy.label} began"
        raise LadderError(f"{failed}; name fewer --rounds than {number}, or more --demonstrations")
    return found

"""demo: two episodes made here and shown, the first thing to type."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from pipeline.commands.common import Quiet, has_screen, resumable

TASK, ROBOT, LEVEL, EPISODES = "shake_bottle", "aloha-agilex", 3, 2
NEXT = """next:
  python -c "import domino_data as dd; print(dd.open_dataset('{out}').recipe().tasks)"
  domino-data export {out} --format lerobot
  domino-data build --tasks {task} --levels 1,2,3 --episodes 20 --out domino-more
  domino-data tasks    # the other tasks; every command has --help"""


def demo(
    out: Annotated[Path, typer.Option(help="Directory of the dataset.")] = Path("domino-demo"),
    view: Annotated[
        bool,
        typer.Option("--view/--no-view", help="Open the viewer in a browser, if there is one."),
    ] = True,
    quiet: Quiet = False,
) -> None:
    """Make two episodes of a robot that catches a bottle with abrupt turns, and open them in the
    viewer. Rerun it to see them again."""
    from pipeline.crew.contract import Crew
    from pipeline.data.dataset import Dataset
    from pipeline.data.recipe.model import parse_recipe
    from pipeline.report.viewer import write_viewer
    from pipeline.run.build import build
    from pipeline.run.checks.doctor import DRIVER
    from pipeline.world.drawing.vulkan import NoRenderer, ensure_renderer

    try:
        ensure_renderer()
    except NoRenderer as error:
        raise NoRenderer(f"no Vulkan device to draw with: {DRIVER}") from error
    keys = {"tasks": TASK, "embodiments": ROBOT, "levels": LEVEL, "episodes": EPISODES}
    with resumable(out):
        build(out, parse_recipe(keys), Crew(), shown="none" if quiet else "bar")
    dataset = Dataset(out)
    episodes = sorted(dataset.accepted(dataset.recipe()))
    pages = dataset.report.parent / "view"
    page = write_viewer(dataset.root, episodes, pages, len(episodes)).resolve().as_uri()
    print(f"{len(episodes)} episodes in {out}; watch them: {page}")
    print(NEXT.format(out=out, task=TASK))
    if view and has_screen():
        webbrowser.open(page)

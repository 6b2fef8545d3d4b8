"""show and view: one episode, or a dataset, to look at in a browser."""

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from tqdm import tqdm

from pipeline.commands.common import (
    AsJson,
    Quiet,
    Root,
    UsageError,
    at_terminal,
    check_file,
    has_screen,
    print_result,
)
from pipeline.data.atomic import write_atomic
from pipeline.data.dataset import Dataset
from pipeline.data.intact import check_bytes, kept_failures


def show(
    episode: Annotated[Path, typer.Argument(help="An episode file (.hdf5).", metavar="EPISODE")],
    out: Annotated[
        Path | None,
        typer.Option(help="The page to write.", show_default="DATASET/report/show/...html"),
    ] = None,
    film: Annotated[
        Path | None,
        typer.Option(help="Film (.mp4) to write instead: both arms, the target's path."),
    ] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open it in a browser.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write a page with the film of an episode, its frames, events and sentences, and print its
    path."""
    from pipeline.report.show import show as write

    check_file(out, "--out", "a page", ".html")
    if episode.is_dir():
        raise UsageError(
            f"{episode} is a directory: name one of the .hdf5 files below DATASET/episodes"
        )
    if film is not None and out is not None:
        raise UsageError("--film and --out: each writes a file of its own; give one of them")
    page = (
        write(episode, out or default_page(episode)) if film is None else write_film(episode, film)
    )
    print_result({"page" if film is None else "film": str(page)}, as_json, str(page))
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        raise UsageError(f"no browser could be opened: open {page} by hand")


def write_film(episode: Path, film: Path) -> Path:
    """Draw an episode again and write the film of it. Raises UsageError, EpisodeError."""
    from functools import partial

    from pipeline.report.film_strip import observed
    from pipeline.stages.drawing.redraw import redraw_smooth

    root = dataset_of(episode)
    check_file(film, "--film", "a film", ".mp4")
    if root is None:
        raise UsageError(
            f"{episode} is in no dataset, whose assets/ a film is drawn from: name a file below"
            " DATASET/episodes"
        )
    write_atomic(film, observed(episode, partial(redraw_smooth, bodies=Dataset(root).bodies)))
    return film


def dataset_of(episode: Path) -> Path | None:
    """The root of the dataset that an episode file belongs to, or None."""
    places = episode.resolve().parents
    return next(
        (
            root
            for root in places
            if (root / "manifest.yaml").exists() and root / "episodes" in places
        ),
        None,
    )


def default_page(episode: Path) -> Path:
    """Where the page of an episode goes: in its dataset's report, or here."""
    root = dataset_of(episode)
    if root is None:
        return Path(f"{episode.stem}.html")
    inside = episode.resolve().relative_to(root / "episodes").with_suffix("")
    return root / "report" / "show" / f"{'-'.join(inside.parts)}.html"


PAGES = 12


def view(
    dataset: Root,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write the offline page to this directory.", show_default="DATASET/report/view"
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=100_000,
            help="Episodes on the offline page, and as many failures; levels have equal shares.",
            show_default=str(PAGES),
        ),
    ] = None,
    serve: Annotated[
        bool | None,
        typer.Option(
            "--serve/--write",
            help="Show all episodes from a server on this machine, or write an offline page.",
            show_default="serve in a terminal, write elsewhere",
        ),
    ] = None,
    rerun: Annotated[
        Path | None,
        typer.Option(help="Write recordings for rerun (.rrd) to this directory instead."),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the server; 0 selects a free one.")
    ] = 0,
    open_: Annotated[
        bool | None,
        typer.Option(
            "--open/--no-open",
            help="Open it in a browser.",
            show_default="what a terminal serves, if there is a screen",
        ),
    ] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Show the episodes of a dataset in a browser until Ctrl-C, or write pages that open without a
    network. Cameras are in step with curves and events."""
    from pipeline.report.viewer import choose, viewer_server, write_viewer
    from pipeline.report.viewer.rerun_log import log_episode

    source = Dataset(dataset)
    pages = source.report.parent / "view"
    for place, option in ((out, "--out"), (rerun, "--rerun")):
        if place is not None and place.resolve() != pages.resolve():
            _check_place(place, source.root, option)
    recipe = source.recipe()
    there, failed = (
        sorted(source.accepted(recipe)),
        sorted(path for _, path, _ in kept_failures(source, recipe)),
    )
    if not there and not failed:
        raise UsageError(f"{dataset} has no finished episodes to show")
    watched = at_terminal() and not (out or rerun or episodes or as_json)
    if watched if serve is None else serve:
        with viewer_server(source.root, [*there, *failed], port) as server:
            address = f"http://{server.server_address[0]}:{server.server_address[1]}/"
            print_result({"address": address}, as_json, f"{address}  (Ctrl-C ends it)")
            sys.stdout.flush()
            try:
                if (watched and has_screen()) if open_ is None else open_:
                    webbrowser.open(address)
                server.serve_forever()
            except KeyboardInterrupt:
                return
    chosen = choose(there, episodes or PAGES)
    for path in chosen:
        check_bytes(source, path.relative_to(source.episodes))
    if rerun is not None:
        names = [
            "-".join(path.relative_to(source.episodes).with_suffix("").parts) for path in chosen
        ]
        made = [
            str(log_episode(path, name, rerun / f"{name}.rrd"))
            for path, name in zip(chosen, names, strict=True)
        ]
        return print_result({"recordings": made}, as_json, "\n".join(made))
    shown = [*chosen, *choose(failed, episodes or PAGES)]
    with tqdm(total=len(shown), unit="ep", disable=as_json or quiet or None) as bar:
        page = write_viewer(source.root, shown, out or pages, len(there) + len(failed), bar.update)
    shown_values = {
        "page": str(page),
        "episodes": len(chosen),
        "failures": len(shown) - len(chosen),
    }
    print_result(shown_values, as_json, str(page))
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        raise UsageError(f"no browser could be opened: open {page} by hand")


def _check_place(place: Path, dataset: Path, option: str) -> None:
    """Raise UsageError for a directory that is no place for pages of this command."""
    from pipeline.report.viewer.page import OURS

    inside, outside = place.resolve(), dataset.resolve()
    if inside.is_relative_to(outside) or outside.is_relative_to(inside):
        raise UsageError(
            f"{option} {place}: is inside the dataset or holds it: name another directory"
        )
    if place.is_dir() and (
        foreign := [
            f for f in place.iterdir() if not f.name.startswith(OURS) and f.suffix != ".rrd"
        ]
    ):
        raise UsageError(
            f"{option} {place}: has {foreign[0].name}, which is not a page of the viewer: name"
            " another directory"
        )

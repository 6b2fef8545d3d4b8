"""view: a dataset or episode in a browser."""

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

from tqdm import tqdm

from pipeline.data.dataset import Dataset, check_apart
from pipeline.data.intact import check_bytes, kept_failures, named_slot

from .common import (
    AsJson,
    Quiet,
    Root,
    UsageError,
    at_terminal,
    has_screen,
    number,
    option,
    print_result,
)

PAGES = 12


def view(
    dataset: Root,
    out: Annotated[
        Path | None,
        option("Write the offline page to this directory.", show_default="DATASET/report/view"),
    ] = None,
    episodes: Annotated[
        int | None,
        number(
            1, 100_000, "Episodes on the offline page, and as many failures.", show_default="12"
        ),
    ] = None,
    episode: Annotated[
        str | None, option("Show this one only: its path below DATASET/episodes.")
    ] = None,
    serve: Annotated[
        bool | None,
        option(
            "Show all episodes from a server on this machine, or write an offline page.",
            "--serve/--write",
            show_default="serve in a terminal, write elsewhere",
        ),
    ] = None,
    port: Annotated[int, number(0, 65535, "Port of the server; 0 selects a free one.")] = 0,
    open_: Annotated[
        bool | None,
        option(
            "Open it in a browser.",
            "--open/--no-open",
            show_default="what a terminal serves, if there is a screen",
        ),
    ] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Show the episodes of a dataset in a browser until Ctrl-C, or write pages that open without a
    network. Cameras are in step with curves and events."""
    from pipeline.report.viewer import choose, viewer_server, write_viewer

    source = Dataset(dataset)
    pages = source.report.parent / "view"
    if out is not None and out.resolve() != pages.resolve():
        _check_place(out, source.root)
    recipe = source.recipe()
    there = sorted(source.accepted(recipe))
    failed = sorted(path for _, path, _ in kept_failures(source, recipe))
    if not there and not failed:
        raise UsageError(f"{dataset} has no finished episodes to show")
    if episode is not None:
        one = source.episode(named_slot(source, recipe, episode))
        there, failed = [path for path in there if path == one], []
        if not there:
            raise UsageError(f"--episode {episode}: is not built")
    watched = at_terminal() and not (out or episodes or as_json)
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
    shown = [*chosen, *choose(failed, episodes or PAGES)]
    with tqdm(total=len(shown), unit="ep", disable=as_json or quiet or None) as bar:
        page = write_viewer(source.root, shown, out or pages, len(there) + len(failed), bar.update)
    counts = {"episodes": len(chosen), "failures": len(shown) - len(chosen)}
    print_result({"page": str(page), **counts}, as_json, str(page))
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        raise UsageError(f"no browser could be opened: open {page} by hand")


def _check_place(place: Path, dataset: Path) -> None:
    """Raise DominoError for a directory unfit for this command's pages."""
    from pipeline.report.viewer.page import OURS

    check_apart(place, dataset)
    if place.is_dir() and (foreign := [f for f in place.iterdir() if not f.name.startswith(OURS)]):
        raise UsageError(
            f"--out {place}: has {foreign[0].name}, which is not a page of the viewer: name another"
        )

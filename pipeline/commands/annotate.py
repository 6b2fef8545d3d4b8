"""annotate: flow, masks and features."""

import re
from typing import Annotated, Literal

import typer

from pipeline.annotate.stage import MOST_POINTS, MOST_STRIDE
from pipeline.data.names import HEAD
from pipeline.data.parsing import ParseError, pixels

from . import common
from .common import UsageError, number, option


def annotate(
    dataset: common.Root,
    stages: Annotated[
        str, option("flow, masks, features, world; comma separated.")
    ] = "flow,masks,features",
    where: Annotated[
        str | None, option('Which episodes, e.g. "level=3 and task=click_bell".')
    ] = None,
    cameras: Annotated[str, option("Cameras, comma separated.")] = HEAD,
    flow_source: Annotated[
        Literal["farneback", "sim"], option("From the images, or exact from the simulator.")
    ] = "farneback",
    flow_stride: Annotated[
        int, number(1, MOST_STRIDE, "Frames between the two images of a pair.")
    ] = 4,
    flow_size: Annotated[str, option("Width x height of the flow map.")] = "64x64",
    mask_source: Annotated[
        Literal["model", "sim"], option("GroundingDINO + SAM 2, or exact from the simulator.")
    ] = "model",
    prompt: Annotated[
        Literal["metadata", "description", "instruction"], option("Where its words come from.")
    ] = "metadata",
    detector: Annotated[
        str, option("GroundingDINO: hub id, local directory or short name.")
    ] = "grounding-dino-tiny",
    segmenter: Annotated[
        str, option("SAM 2: hub id, local directory or short name.")
    ] = "sam2.1-hiera-large",
    encoder: Annotated[
        str, option("DINOv2 or DINOv3: hub id, local directory or short name.")
    ] = "dinov2-base",
    track_points: Annotated[
        int, number(1, MOST_POINTS, "world: points tracked on each body.")
    ] = 64,
    dense: Annotated[bool, option("world: also depth, normals and flow of every pixel.")] = True,
    device: Annotated[str, option("cpu, cuda or auto.")] = "auto",
    executor: common.Executor = "inline",
    workers: Annotated[int, number(1, common.MOST_WORKERS, "Worker processes.")] = 1,
    address: common.Address = None,
    gpus_per_worker: common.Gpus = None,
    runtime_env: common.RuntimeEnv = None,
    dry_run: Annotated[
        bool, option("Report what would run and why; write and download nothing.", "--dry-run")
    ] = False,
    quiet: common.Quiet = False,
    as_json: common.AsJson = False,
) -> None:
    """Bring the annotations of a dataset up to date."""
    from functools import partial

    import pipeline.annotate.options as kinds
    from pipeline.annotate.overlays import annotation_sheet
    from pipeline.annotate.stage import Redraw
    from pipeline.data.dataset import Dataset
    from pipeline.data.names import is_name
    from pipeline.report.page import refresh
    from pipeline.run.annotate import annotate as run
    from pipeline.stages.drawing.redraw import redraw
    from pipeline.stages.drawing.truth import truth

    try:
        size = pixels(flow_size)
    except ParseError as error:
        raise UsageError(f"--flow-size {flow_size!r} {error}") from error
    if not re.fullmatch(r"auto|cpu|cuda(:[0-9]{1,3})?", device):
        raise UsageError(f"--device {device!r} is unknown: choose cpu, cuda, cuda:NUMBER or auto")
    names = tuple(common.split_list(cameras) or ())
    if not names or not all(map(is_name, names)):
        raise UsageError(f"--cameras {cameras!r} is not a list like head_camera,left_camera")
    options = kinds.AnnotateOptions(
        names,
        kinds.FlowOptions(flow_source, flow_stride, size),
        kinds.MaskOptions(
            source=mask_source, prompt=prompt, detector=detector, segmenter=segmenter
        ),
        kinds.FeatureOptions(encoder=encoder),
        world=kinds.WorldOptions(track_points, dense),
    )
    source = Dataset(dataset)
    crew = common.crew_of(executor, workers, address, gpus_per_worker, runtime_env)
    drawn = Redraw(partial(redraw, bodies=source.bodies), partial(truth, bodies=source.bodies))
    with common.resumable(dataset):
        values = run(
            dataset,
            tuple(common.split_list(stages) or ()),
            options=options,
            where=where,
            redraw=drawn,
            crew=crew,
            device=device,
            dry_run=dry_run,
            progress=not (as_json or quiet),
        )
    if not dry_run:
        refresh(source, annotation_sheet)
    lines, made = list[str](), "to compute" if dry_run else "computed"
    for s in values["stages"]:
        lines.append(
            f"{s['name']:9} {s['computed']} {made}, {s['reused']} reused, {s['invalid']} invalid,"
            f" {s['failed']} failed, {s['waiting']} waiting; hit rate {100 * s['hit_rate']:.0f} %,"
            f" {s['seconds']:.1f} s"
        )
        lines += [f"  {p}" for p in s["problems"][:5]]
        lines += [f"  {p['episode']}: {p['reason']}" for p in s.get("plan", [])]
    common.print_result(values, as_json, "\n".join(lines))
    if any(s["failed"] for s in values["stages"]):
        raise typer.Exit(1)

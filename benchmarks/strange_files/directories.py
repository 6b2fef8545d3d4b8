"""Cases of object directories, textures and light."""

import os

from benchmarks.strange_files.making import Probe, cone, glb, link, object_directory
from pipeline.intake.objects.add import draft_all
from pipeline.intake.objects.draft import ObjectOptions

DIRECTORY_CASES = (
    # directories, textures, light
    Probe(
        "object.toml of 5,000 levels",
        object_directory(lambda p: p.write_text("a = " + "[" * 5000 + "]" * 5000)),
        "nested too deeply",
    ),
    Probe("object.toml that is /dev/zero", object_directory(link("/dev/zero")), "object.toml"),
    Probe("object.toml that is a pipe", object_directory(os.mkfifo), "object.toml"),
    Probe(
        "model_data of 100,000 levels",
        lambda f: (
            cone(f / "base0.stl"),
            glb()(f / "base0.glb"),
            (f / "model_data0.json").write_text("[" * 100_000 + "]" * 100_000),
            draft_all(f, ObjectOptions("m", "tea_box", f)),
        )[3],
        "model_data0.json",
    ),
)

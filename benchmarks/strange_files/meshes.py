"""Cases of glTF, OBJ, PLY, OFF and COLLADA."""

import os

import numpy as np

from benchmarks.strange_files.making import (
    DRACO,
    HALF,
    MESHOPT,
    PNG,
    SQUARE_OBJ,
    Probe,
    attribute,
    bomb,
    color,
    glb,
    mesh,
    obj,
    texel,
    textured,
    thing,
)
from tests.world.meshes.files import SQUARE, TWO, UV, dae

MESH_CASES = (
    # glTF
    Probe(
        "quantized",
        mesh(
            "a.glb",
            glb(lambda g: attribute(g, "POSITION", (SQUARE * 32767).astype(np.int16), True)),
        ),
        judge=lambda p: np.allclose(p.parts[0].points, SQUARE),
    ),
    Probe("texture, left", mesh("a.glb", glb(textured)), judge=lambda p: texel(p) == [255, 0, 0]),
    Probe(
        "texture transform",
        mesh(
            "a.glb",
            glb(lambda g: textured(g, extensions={"KHR_texture_transform": {"offset": [0.55, 0]}})),
        ),
        judge=lambda p: texel(p) == [0, 0, 255],
    ),
    Probe(
        "texCoord 1",
        mesh(
            "a.glb",
            glb(
                lambda g: (
                    textured(g, texCoord=1),
                    attribute(g, "TEXCOORD_1", (0.9 - UV * 0.3).astype(np.float32)),
                )[0]
            ),
        ),
        judge=lambda p: texel(p) == [0, 0, 255],
    ),
    Probe(
        "factor times texture",
        mesh(
            "a.glb",
            glb(lambda g: (textured(g), g.surface.update(baseColorFactor=[0.5, 1, 1, 1]))[0]),
        ),
        judge=lambda p: abs(texel(p)[0] - 188) < 2,
    ),
    Probe(
        "linear factor",
        mesh("a.glb", glb(lambda g: g.surface.update(baseColorFactor=[0.5, 0.25, 0, 1]))),
        judge=lambda p: color(p, HALF),
    ),
    Probe(
        "colors of vertices",
        mesh(
            "a.glb",
            glb(
                lambda g: attribute(
                    g, "COLOR_0", np.tile(np.array([[0, 255, 0, 255]], np.uint8), (4, 1)), True
                )
            ),
        ),
        judge=lambda p: color(p, (0, 1, 0)),
    ),
    Probe("Draco", mesh("a.glb", glb(**DRACO)), "draco.*gltf-transform"),
    Probe("meshopt", mesh("a.glb", glb(**MESHOPT)), "meshopt"),
    Probe(
        "unknown extension",
        mesh("a.glb", glb(extensionsRequired=["VENDOR_x"])),
        "requires the extension 'VENDOR_x'",
    ),
    Probe("100,000 nodes", thing("a.glb", glb(nodes=[{"mesh": 0}] * 100_000)), "has 100000 nodes"),
    Probe(
        "400,000 triangles in 300 nodes",
        thing(
            "a.glb",
            glb(
                lambda g: g.primitive.update(indices=g.accessor(np.tile(TWO, 200_000))),
                nodes=[{"mesh": 0}] * 300,
                scenes=[{"nodes": list(range(300))}],
            ),
        ),
        "triangles; 500000 at most|values",
    ),
    Probe(
        "nodes in a circle",
        thing("a.glb", glb(nodes=[{"children": [1]}, {"children": [0]}])),
        "circle|no triangles",
    ),
    Probe(
        "gltf with a buffer elsewhere",
        thing(
            "a.gltf",
            lambda p: p.write_text(
                '{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"../../secret.bin"}]}'
            ),
        ),
        "is outside of",
    ),
    Probe(
        "accessor beyond its buffer",
        thing("a.glb", glb(lambda g: g.document["accessors"][0].update(count=10_000))),
        "beyond the end",
    ),
    Probe(
        "accessor of 10^8",
        thing("a.glb", glb(lambda g: g.document["accessors"][0].update(count=10**8))),
        "100000000|triangles",
    ),
    Probe(
        "negative offset",
        thing("a.glb", glb(lambda g: g.document["bufferViews"][0].update(byteOffset=-4))),
        "beyond the end",
    ),
    Probe(
        "JSON of 100,000 levels",
        thing("a.gltf", lambda p: p.write_text('{"asset":' + "[" * 100_000 + "]" * 100_000 + "}")),
        "a.gltf",
    ),
    Probe(
        "texture of 900 million pixels",
        thing(
            "a.obj",
            obj(
                "usemtl a\nf 1/1 2/2 3/3 4/4\n", "newmtl a\nmap_Kd bomb.png\n", bomb_DOT_png=bomb()
            ),
        ),
        "make it smaller",
    ),
    Probe("GLB that is a pipe", thing("a.glb", os.mkfifo), "is no regular file"),
    Probe(
        "zip called GLB",
        thing("a.glb", lambda p: p.write_bytes(b"PK\3\4" + bytes(100))),
        "no header",
    ),
    # OBJ, PLY, OFF, DAE
    Probe(
        "20,000 groups",
        mesh("a.obj", obj("".join(f"g g{k}\nf 1 2 3\n" for k in range(20_000)))),
        judge=lambda p: len(p.parts) == 1,
    ),
    Probe(
        "map_Kd with backslashes",
        mesh(
            "a.obj", obj("usemtl a\nf 1/1 2/2 3/3\n", "newmtl a\nmap_Kd C:\\me\\red.png\n", **PNG)
        ),
        judge=lambda p: "is an absolute path" in p.notes[0],
    ),
    Probe(
        "map_Kd that is missing",
        mesh("a.obj", obj("usemtl a\nf 1/1 2/2 3/3\n", "newmtl a\nKd 1 0 0\nmap_Kd gone.png\n")),
        judge=lambda p: color(p, (1, 0, 0)) and "gone.png" in p.notes[0],
    ),
    Probe(
        "map_Kd elsewhere",
        mesh("a.obj", obj("usemtl a\nf 1/1 2/2 3/3\n", "newmtl a\nmap_Kd ../../secret.png\n")),
        "is outside of",
    ),
    Probe(
        "mtllib elsewhere",
        mesh("a.obj", lambda p: p.write_text(f"mtllib ../../secret.mtl\n{SQUARE_OBJ}f 1 2 3\n")),
        "is outside of",
    ),
    Probe(
        "mtllib without usemtl",
        mesh("a.obj", obj("f 1 2 3\n", "newmtl a\nKd 1 0 0\n")),
        judge=lambda p: "uses none of it" in p.notes[0],
    ),
    Probe(
        "OBJ with colors of vertices",
        mesh(
            "a.obj",
            lambda p: p.write_text("v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n"),
        ),
        judge=lambda p: color(p, (1, 0, 0)),
    ),
    Probe(
        "PLY of 10^10 vertices",
        thing(
            "a.ply",
            lambda p: p.write_text(
                "ply\nformat ascii 1.0\nelement vertex 10000000000\nproperty float x\nend_header\n"
            ),
        ),
        "a.ply",
    ),
    Probe(
        "OFF of 10^9 faces",
        thing(
            "a.off", lambda p: p.write_text("OFF\n3 1000000000 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
        ),
        "a.off",
    ),
    Probe(
        "DAE with an entity",
        mesh(
            "a.dae",
            lambda p: p.write_text(
                '<!DOCTYPE c [<!ENTITY e SYSTEM "file:///etc/passwd">]><COLLADA>&e;</COLLADA>'
            ),
        ),
        "document type",
    ),
    Probe(
        "DAE with nodes in a ring",
        mesh(
            "a.dae",
            lambda p: p.write_text(
                dae(p).read_text().replace("<node>", '<node id="n"><instance_node url="#n"/>')
            ),
        ),
        "Node #n not found",
    ),
)

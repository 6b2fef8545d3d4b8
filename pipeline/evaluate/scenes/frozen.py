"""A scene as data: nothing of it is drawn again."""

from dataclasses import asdict, fields
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from pipeline.data.episode.visuals import Visuals
from pipeline.data.parsing import Strict
from pipeline.data.setup import Setup
from pipeline.data.setup.rules import Rules
from pipeline.data.spec import EpisodeSpec
from pipeline.planning.failure import PlanFailure
from pipeline.stages.drawing.render import visuals_of
from pipeline.stages.scene import Scene, spare
from pipeline.stages.surroundings import Stance, embodiment_of, stance_of
from pipeline.tasks import TASKS
from pipeline.tasks.language.sentences import instructions
from pipeline.tasks.layout import suits
from pipeline.world.objects.contract import FAMILIES, Family, Slide
from pipeline.world.physics.body import Body

MOST, MOST_PARTS = 1e5, 10_000
"""No parameter of a body is greater (its density is in kg/m3), and no whole number but its seed."""

_Number = Annotated[float, Field(ge=-10, le=10)]
_Sentence = Annotated[str, Field(min_length=1, max_length=1000)]


class StrictModel(Strict, strict=True):
    """Data of strangers, strictly read."""


class FrozenBody(StrictModel):
    """A Body; `parameters` are the fields of its family."""

    name: str
    family: str
    parameters: dict[str, float | int | str]
    pose: tuple[_Number, _Number, _Number, _Number, _Number, _Number, _Number]
    fixed: bool = False
    inside: str = ""
    slide: Slide | None = None
    borne: bool = False

    def instance(self) -> Family:
        if self.family not in FAMILIES:
            missing = f"the object {self.family[:80]!r} is not installed"
            raise ValueError(f"{missing}: give --plugins with its directory")
        family: Any = FAMILIES[self.family]
        kinds = {field.name: field.type for field in fields(family)}
        if {name: type(value) for name, value in self.parameters.items()} != kinds:
            raise ValueError(f"{self.name} has other parameters than a {self.family}")
        for name, value in self.parameters.items():
            most = 2**63 if name == "seed" else MOST_PARTS if type(value) is int else MOST
            if not isinstance(value, str) and not -most <= value <= most:
                raise ValueError(f"{name} of {self.name} is out of range")
        return family(**self.parameters)

    def body(self) -> Body:
        if abs(np.linalg.norm(self.pose[3:]) - 1) > 1e-6:
            raise ValueError(f"{self.name} has no rotation")
        placed = np.array(self.pose), self.fixed, self.inside, self.slide, self.borne
        return Body(self.name, self.family, self.instance(), *placed)


class FrozenScene(StrictModel):
    """The last `clutter` bodies are distractors. `looks` are those with unseen textures."""

    bodies: tuple[FrozenBody, ...]
    clutter: Annotated[int, Field(ge=0)] = 0
    stance: Stance | None = None
    looks: Visuals
    seen: _Sentence
    unseen: _Sentence

    def scene(self, spec: EpisodeSpec, rules: Rules) -> Scene:
        task, robot = TASKS[spec.task], embodiment_of(spec, rules.layout, self.stance)
        bodies = {each.name: each.body() for each in self.bodies}
        names = [*bodies]
        if len(names) < len(self.bodies) or not {task.target, task.manipulated} <= {*names}:
            raise ValueError("a body is missing, or there twice")
        for number, body in enumerate(bodies.values()):
            if body.inside and body.inside not in names[:number]:
                raise ValueError(f"{body.name} is in no other body")
        try:
            for body in bodies.values():
                body.instance.shape()
            arms = task.arms(bodies)
        except Exception as error:  # what families and tasks make of numbers of strangers
            raise ValueError(f"its bodies are not those of {spec.task}") from error
        if not suits(task, bodies, robot.sides):
            raise ValueError(f"{spec.embodiment} has not the arms for it")
        clutter = tuple(names[len(names) - self.clutter :])
        try:
            own = {name: body for name, body in bodies.items() if name not in clutter}
            bodies = own | spare(spec, task, own, rules) | bodies
        except PlanFailure as failure:
            raise ValueError(str(failure)) from failure
        said = {"seen": self.seen, "unseen": self.unseen}
        return Scene(
            spec, task, robot, bodies, arms, clutter, rules, looks=self.looks, sentences=said
        )


def freeze(scene: Scene) -> FrozenScene:
    """The scene as it was drawn. Raises ValueError for bodies that are more than their
    parameters."""
    bodies = [
        FrozenBody(
            name=body.name,
            family=body.family,
            parameters=asdict(body.instance),  # pyright: ignore[reportArgumentType]
            pose=tuple(body.pose.tolist()),
            fixed=body.fixed,
            inside=body.inside,
            slide=body.slide,
            borne=body.borne,
        )
        for body in scene.bodies.values()
    ]
    if other := [b.name for b in bodies if b.instance() != scene.bodies[b.name].instance]:
        raise ValueError(f"{other[0]} cannot be frozen: its family has more than its fields")
    said = instructions(scene.wording(), scene.spec.rng("language"), 1)
    return FrozenScene(
        bodies=tuple(bodies),
        clutter=len(scene.clutter),
        stance=stance_of(scene.spec),
        looks=visuals_of(scene.spec, Setup(textures="unseen")),
        seen=said["seen"][0],
        unseen=said["unseen"][0],
    )

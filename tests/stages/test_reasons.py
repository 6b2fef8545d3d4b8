"""docs/add_a_task.md names every reason for which an attempt can fail."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pipeline
from pipeline.crew.contract import Died
from pipeline.motion.models.planar import REASONS
from pipeline.stages.failure import no_success
from pipeline.stages.reasons import reasons_in

ROOT = Path(pipeline.__file__).parent


def strings(node: ast.expr, scope: ast.AST) -> Iterator[str]:
    """The texts that an expression can be: those in it, or those that its name is given in the
    function around it."""
    if isinstance(node, ast.Name):
        for other in ast.walk(scope):
            if isinstance(other, ast.Assign) and any(
                isinstance(t, ast.Name) and t.id == node.id for t in other.targets
            ):
                yield from strings(other.value, scope)
    else:
        branches = (node.body, node.orelse) if isinstance(node, ast.IfExp) else (node,)
        yield from (
            n.value for branch in branches for n in ast.walk(branch) if isinstance(n, ast.Constant)
        )


def raised() -> set[str]:
    """Reasons with which the sources make a PlanFailure or a Failure."""
    found = set()
    for path in [
        p for room in ("planning", "expert", "tasks", "stages") for p in (ROOT / room).rglob("*.py")
    ]:
        tree = ast.parse(path.read_text())
        for scope in [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]:
            for call in [
                n
                for n in ast.walk(scope)
                if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
            ]:
                place = {"PlanFailure": 0, "Failure": 1}.get(call.func.id)
                if place is not None and len(call.args) > place:
                    found |= set(strings(call.args[place], scope))
    return found


def test_the_page_names_every_reason_and_no_other():
    page = (
        (ROOT.parent / "docs" / "add_a_task.md").read_text().partition("## Reasons of failure")[2]
    )
    # for which no attempt is blamed
    lost = {*Died.__annotations__["reason"].__args__} - {"node_lost"}
    reasons = raised() | {no_success("replay", ()).reason} | lost
    assert {"grasp_blocked", "place_unreachable", "missed", "no_motion"} <= reasons
    assert reasons == set(re.findall(r"(?m)^\| `(\w+)` \|", page))
    assert set(re.findall(r"(?m)^\| `no_motion`, mostly `(\w+)` \|", page)) == set(REASONS)


def test_the_motions_that_each_check_refused_are_counted():
    details = (
        "no motion of level 3 at alpha 0.1 m/s over 2 s: workspace 10, blocked 8",
        "blocked 5",
    )
    [reason] = reasons_in(("back_calculate", "no_motion", text, ()) for text in details)
    assert reason.detail == "motions refused: blocked 13, workspace 10"
    [reason] = reasons_in([("back_calculate", "no_motion", "no candidate was allowed", ())])
    assert reason.detail == "no candidate was allowed"

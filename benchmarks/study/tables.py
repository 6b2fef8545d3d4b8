"""The study as markdown."""

from collections.abc import Iterator

from benchmarks.study.plan import CHUNKS, LATE, LATENCY, POLICIES, interceptor, late, latency
from benchmarks.study.rows import StudyRows, at, markdown

ENOUGH = 0.8
"""A task whose success rate keeps this share of itself when the target is half a second late
measures no timing."""

COLUMNS = (
    (0, 0.0),
    (1, 0.05),
    (1, 0.1),
    (1, 0.2),
    (2, 0.05),
    (2, 0.1),
    (2, 0.2),
    (3, 0.05),
    (3, 0.1),
    (3, 0.2),
)


def summary(rows: StudyRows) -> str:
    """Policies down, cells across: per cent solved over all tasks, with Wilson's interval."""
    rows = rows.of(clock="sim", rules="strict")
    head = ("policy", "still", *(f"L{level}, {alpha:g}" for level, alpha in COLUMNS[1:]))
    return markdown(
        head,
        [
            (p, *(at(rows.of(policy=p), level, alpha).rate for level, alpha in COLUMNS))
            for p in POLICIES
        ],
    )


def by_task(rows: StudyRows, alpha: float = 0.1) -> str:
    """Tasks down, policies x levels across: solved of tried at one alpha."""
    rows = rows.of(clock="sim", rules="strict")
    columns = [(p, level) for p in POLICIES[:4] for level in (0, 1, 3)]
    head = ("task", *(f"{p} {level}" for p, level in columns))
    body = []
    for task in rows.values("task"):
        rates = [at(rows.of(policy=p, task=task), level, alpha).rate for p, level in columns]
        body.append((task, *(f"{r.solved}/{r.episodes}" for r in rates)))
    return markdown(head, body)


def timing(rows: StudyRows) -> str:
    """Recorded actions against a target that is late: tasks x contact rules x alpha down, delays
    across, per cent solved."""
    rows = rows.of(policy="replay", level=1)
    head = ("task", "contact", "alpha", *(f"{ms / 1000:g} s" for ms in LATE))
    body = []
    for rules, contact in (("strict", "stop"), ("strict-continue", "continue")):
        for task in (*rows.of(rules=rules).values("task"), "all"):
            group = rows.of(rules=rules) if task == "all" else rows.of(rules=rules, task=task)
            for alpha in group.values("alpha"):
                rates = [group.of(alpha=alpha, clock=late(ms)).rate for ms in LATE]
                body.append(
                    (
                        task,
                        contact,
                        f"{alpha:g}",
                        *(r if task == "all" else f"{r.percent:.0f}" for r in rates),
                    )
                )
    return markdown(head, body)


def untimed(rows: StudyRows, alpha: float = 0.1, ms: int = 400) -> Iterator[tuple[str, str]]:
    """Tasks, with their contact rule, whose success hardly suffers from a target that is `ms`
    late."""
    rows = rows.of(policy="replay", level=1, alpha=alpha)
    for rules, contact in (("strict", "stop"), ("strict-continue", "continue")):
        for task in rows.of(rules=rules).values("task"):
            group = rows.of(rules=rules, task=task)
            if (
                group.of(clock=late(ms)).rate.percent
                >= ENOUGH * group.of(clock="sim").rate.percent
                > 0
            ):
                yield task, contact


def delays(rows: StudyRows) -> str:
    """The interceptor on a slow machine: actions an answer down, latency across."""
    rows = rows.of(rules="strict", level=1, alpha=0.1)
    head = ("answers", *(f"{ms} ms" for ms in LATENCY))
    body = []
    for chunk in CHUNKS:
        rates = [answers(rows, chunk, ms).rate for ms in LATENCY]
        body.append((f"{chunk} action{'s' if chunk > 1 else ''}", *rates))
    return markdown(head, body)


def answers(rows: StudyRows, chunk: int, ms: int) -> StudyRows:
    """Without latency it makes no difference how many actions an answer holds
    (tests/evaluate/test_evaluate.py)."""
    return rows.of(policy=interceptor(chunk if ms else 1), clock=latency(ms))

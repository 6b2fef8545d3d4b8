"""The plot of any results: where its points lie."""

import re

from pipeline.evaluate.scoring.page import HEIGHT, PUBLISHED, WIDTH, page, panels


def mean(policy, level, alpha, rate, **more):
    row = {
        "policy": policy,
        "condition": "",
        "clock": "sim",
        "rules": "strict",
        "embodiment": "aloha-agilex",
        "domain": "clean",
        "category": "all",
    }
    scores = dict.fromkeys(("success_rate", "route_completion", "manipulation_score"), rate)
    intervals = {f"{name}_interval": [rate - 10, rate + 10] for name in scores}
    return (
        row
        | {"level": level, "alpha": alpha, "tasks": 2, "episodes": 4, "sees_truth": True}
        | scores
        | intervals
        | more
    )


MEANS = [
    mean("static", 0, 0.1, 100),
    mean("static", 1, 0.1, 25),
    mean("static", 1, 0.2, 10),
    mean("static", 3, 0.2, 50),
    mean("chaser", 1, 0.2, 80),
    mean("chaser", 1, 0.2, 99, category="tracking"),
]


def test_a_level_has_a_panel_and_a_still_target_is_its_alpha_0():
    first, third = panels(MEANS)
    assert (first.title, third.title) == ("level 1", "level 3")
    assert first.ticks == ((0, "0"), (WIDTH / 2, "0.1"), (WIDTH, "0.2"))
    static, chaser = first.lines
    assert [(p.x, p.y) for p in static.points] == [
        (0, 0),
        (WIDTH / 2, HEIGHT * 0.75),
        (WIDTH, HEIGHT * 0.9),
    ]
    assert [(p.low, p.high) for p in chaser.points] == [(HEIGHT * (1 - 0.7), HEIGHT * (1 - 0.9))]
    assert [line.label for line in third.lines] == ["static"] and third.lines[
        0
    ].color == static.color != chaser.color
    assert [panel.title for panel in panels(MEANS[:1])] == ["still"]
    assert panels([]) == []


def test_what_differs_tells_lines_apart():
    rows = [mean("static", 1, 0.1, 50), mean("static", 1, 0.1, 20, clock="latency:100")]
    assert [line.label for line in panels(rows)[0].lines] == ["static, sim", "static, latency:100"]


def test_the_page_draws_the_points_and_what_others_report_apart():
    text = page([], MEANS)
    assert "<td>static (sees the truth)</td>" in text
    drawn, rest = text.split('aria-label="success rates that others report at level 1"')
    assert re.findall(r'points="([^"]+)"', drawn)[0] == "0.0,0.0 130.0,135.0 260.0,162.0 "
    bars = re.findall(r'<rect x="0" y="\d+" width="([\d.]+)"', rest)
    assert [float(width) for width in bars] == [
        round(2.6 * (p.success_rate or 0), 1) for p in PUBLISHED
    ]
    assert not any(p.model in drawn for p in PUBLISHED)
    assert all(f"{p.model}: {p.success_rate} ({p.source})" in rest for p in PUBLISHED)

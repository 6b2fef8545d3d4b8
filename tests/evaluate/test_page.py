"""Films and the page of an evaluation."""

import io
import json
import re
from dataclasses import replace

import pytest

from pipeline.data.atomic import write_atomic
from pipeline.data.recipe.model import Cell
from pipeline.evaluate.evaluate import Evaluation, evaluate
from pipeline.evaluate.names import policy_name
from pipeline.evaluate.scenes.manifests import Manifest, Manifests, first_seed, inline
from pipeline.evaluate.scoring.clock import parse_clock
from pipeline.evaluate.scoring.page import PUBLISHED
from tests.evaluate.environment.test_env import case_of


def test_an_evaluation_has_a_page_and_films_on_request(tmp_path):
    av = pytest.importorskip("av")
    case = case_of("click_bell")
    cell = Cell("click_bell", "aloha-agilex", 1, 0.1, "clean")
    manifests = Manifests(tmp_path / "manifests")
    write_atomic(
        manifests.path(cell), Manifest(cell, first_seed(0), tried=1, cases=[case]).to_json()
    )
    wanted = Evaluation(
        (cell,), policy_name("replay"), parse_clock("sim"), 1, code="<new>", films=1
    )
    outcome = evaluate(wanted, tmp_path, inline)
    text = outcome.page.read_text()
    assert outcome.page == tmp_path / "index.html"
    assert f"click_bell on aloha-agilex, level 1, clean, seed {case.spec.seed}</h3>" in text
    assert "replay, sim: success, MS 100</figcaption>" in text
    assert all(published.model in text for published in PUBLISHED)
    assert len(re.findall(r'src="data:video/mp4', text)) == 1
    (mp4,) = (tmp_path / "films").glob("*.mp4")
    with av.open(io.BytesIO(mp4.read_bytes())) as film:
        frames = sum(1 for _ in film.decode(video=0))
    (row,) = map(json.loads, outcome.path.read_text().splitlines())
    assert frames == row["periods"] + 1
    # a second call runs and films nothing again; another policy stands beside it on the page
    before = mp4.stat().st_mtime_ns
    assert evaluate(wanted, tmp_path, inline).run == 0
    still = evaluate(replace(wanted, policy=policy_name("still")), tmp_path, inline)
    assert still.run == 1 and mp4.stat().st_mtime_ns == before
    assert still.means[0]["manipulation_score"] < 10
    assert "<td>still</td>" in still.page.read_text()

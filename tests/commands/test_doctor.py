"""`domino-data doctor`: what it prints, and its exit code."""

import json

import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.run.checks.doctor import CheckResult

GOOD = CheckResult("python", "PASS", "Python 3.12.1")
WEAK = CheckResult("torchcodec", "WARN", "finds no FFmpeg", "apt install ffmpeg")
BAD = CheckResult("vulkan", "FAIL", "no device", "make setup")


@pytest.mark.parametrize(
    ("results", "code"), [((GOOD,), 0), ((GOOD, WEAK), 0), ((GOOD, WEAK, BAD), 1)]
)
def test_only_what_keeps_from_building_is_an_exit_code(monkeypatch, results, code):
    monkeypatch.setattr("pipeline.run.checks.doctor.diagnose", lambda place: iter(results))
    text = CliRunner().invoke(app, ["doctor"])
    assert text.exit_code == code and "examining" in text.stderr
    for result in results:
        assert f"{result.verdict}  {result.name}: {result.detail}" in text.stdout
        assert not result.fix or f"fix: {result.fix}" in text.stdout
    program = CliRunner().invoke(app, ["doctor", "--json"])
    values = json.loads(program.stdout)
    assert program.exit_code == code and values["ok"] == (code == 0)
    assert [CheckResult(**check) for check in values["checks"]] == list(results)

"""An export of Parquet loads few modules of ours and no simulator."""

import subprocess
import sys

MODULES = 120
FORBIDDEN = ("stages", "tasks", "expert", "planning", "world", "evaluate", "intake")
SCRIPT = """
import sys
from pipeline.cli import main
try:
    main()
except SystemExit as end:
    assert not end.code, end
print(*(name for name in sys.modules if name.partition(".")[0] in ("pipeline", "sapien")))
"""


def test_an_export_loads_no_simulator(built, tmp_path):
    command = [
        sys.executable,
        "-c",
        SCRIPT,
        "export",
        str(built),
        "--format",
        "parquet",
        "--out",
        str(tmp_path / "out"),
        "--quiet",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    loaded = done.stdout.splitlines()[-1].split()
    ours = [name for name in loaded if name.startswith("pipeline")]
    assert "sapien" not in loaded and not [
        name for name in ours if name.split(".")[1:2] and name.split(".")[1] in FORBIDDEN
    ]
    assert "pipeline.export.formats.parquet" in ours and len(ours) < MODULES

"""RoboTwin's script/eval_policy.py over domino-data: the eval.sh of a policy folder calls it.

    python script/eval_policy.py --config policy/ACT/deploy_policy.yml --overrides --key value ...

Evaluates the folder of the --config on the task `task_name`, with every override in usr_args.
`seed` is also that of the scenes. DOMINO_OPTIONS holds further options of `domino-data evaluate`.
"""

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlencode

CAMERAS = "head,left,right"


def evaluate_arguments(arguments: Sequence[str], more: str = "") -> list[str]:
    """The command line of `domino-data` for one of RoboTwin's; `more` are further options of
    `evaluate`, which come last and win. Ends the program for arguments of another form."""
    if len(arguments) < 3 or arguments[0] != "--config" or arguments[2] != "--overrides":
        sys.exit("usage: eval_policy.py --config FOLDER/deploy_policy.yml --overrides --key value")
    folder, pairs = Path(arguments[1]).resolve().parent, arguments[3:]
    keys, values = pairs[::2], pairs[1::2]
    if len(keys) != len(values) or not all(key.startswith("--") for key in keys):
        sys.exit("eval_policy.py: write overrides as --key value")
    options = {key[2:]: value for key, value in zip(keys, values, strict=True)}
    if "task_name" not in options:
        sys.exit("eval_policy.py: the overrides name no --task_name")
    task, setting = options["task_name"], Path(options.get("ckpt_setting", "0")).name
    given = shlex.split(more)
    out = [] if "--out" in given else ["--out", f"eval_result/{task}/{folder.name}/{setting}"]
    cameras = [] if {"--cameras", "--like"} & {*given} else ["--cameras", CAMERAS]
    policy = f"robotwin:{folder}?{urlencode(options)}"
    seed = [] if "--seed" in given else ["--seed", options.get("seed", "0")]
    return ["evaluate", "--policy", policy, "--tasks", task, *seed, *cameras, *out, *given]


if __name__ == "__main__":
    from domino_data_command import main

    sys.argv = [
        "domino-data",
        *evaluate_arguments(sys.argv[1:], os.environ.get("DOMINO_OPTIONS", "")),
    ]
    main()

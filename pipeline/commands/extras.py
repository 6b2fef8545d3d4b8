"""Which extra of domino-data brings a module that is not installed."""

EXTRAS = {
    "ray": "ray",
    "huggingface_hub": "hub",
    "fsspec": "hub",
    "s3fs": "s3",
    "gcsfs": "gcs",
    "lerobot": "lerobot",
    "transformers": "annotate",
    "torch": "train",
    "accelerate": "train",
    "peft": "train",
    "safetensors": "train",
    "tensorboard": "trackers",
    "zmq": "gr00t",
    "mujoco": "mjcf",
    "coacd": "shapes",
}
"""The extra by module."""


def describe_missing(module: str) -> str:
    """One line on a module that is not installed and how to install it; "" if it is of no extra."""
    name = module.partition(".")[0]
    if name == "sapien":
        return (
            "this needs the simulator (sapien), which has no wheel for this platform: see"
            " docs/installation.md for what works without it"
        )
    if name not in EXTRAS:
        return ""
    return f"this needs {name}: uv pip install 'domino-data[{EXTRAS[name]}]'"

"""Where the files of a dataset are."""

from pathlib import Path

from pipeline.data.names import MANIFEST
from pipeline.data.recipe.cells import Slot
from pipeline.data.rows import file_name


class Paths:
    """The paths of one dataset directory. They are made from the recipe's slots, whose names are
    plain names."""

    def __init__(self, root: Path) -> None:
        self.root = root = Path(root)
        self.manifest = root / MANIFEST
        """The frozen recipe."""
        self.attempts = root / "attempts.parquet"
        """The table of all attempts."""
        self.provenance = root / "provenance.json"
        """What made the dataset: code, packages, renderer, processor."""
        self.report = root / "report" / "index.html"
        """The report's first page."""
        self.assets = root / "assets"
        """Vendor meshes that the recipe names (robots/), and what the images were drawn from
        (bodies/)."""
        self.bodies = self.assets / "bodies"
        """Meshes and materials of every body in the images, each once, by hash."""
        self.episodes = root / "episodes"
        """Directory of the episode files."""
        self.failures = root / "failures"
        """Directory of the failed attempts that are kept: no episodes of the dataset."""
        self.orphans = root / "orphans"
        """Whole episodes that belong to no slot, which `gc` has moved here."""
        self.index = root / "index.sqlite"
        """Which slots are finished: what their files say (data/index.py)."""

    def episode(self, slot: Slot) -> Path:
        """Path of a slot's episode file."""
        return self.episodes / f"{slot.path}.hdf5"

    def file(self, slot: Slot, accepted: bool) -> Path:
        """Path of the file of a slot: its episode, or the note that it was given up."""
        return self.episodes / slot.cell.path / file_name(slot, accepted)

    def failure(self, slot: Slot, attempt: int) -> Path:
        """Path of a failed attempt at a slot."""
        return self.failures / f"{slot.path}_attempt_{attempt:03d}.hdf5"

    def log(self, slot: Slot) -> Path:
        """Where the log of a slot that failed is."""
        return self.root / "logs" / f"{slot.path}.log"

    def exports(self, name: str) -> Path:
        """Default place of an export."""
        return self.root / "exports" / name

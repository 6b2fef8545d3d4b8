"""Finds the target in an image: coarsely in the whole, made small, then in a crop of the full image
around that."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from training.puma.config import Finder
from training.puma.model.tiny import Points
from training.puma.preprocess import resized

HELPERS = 8
"""Filters beside those of the points: what else is to be seen says how exact the points are."""

LEAST, MOST = -1.5, 4.5
"""Logarithms of the smallest and the largest error (px) that can be expected."""

CELL = 4
"""Stride (px) of the responses of `Points`."""

type Images = NDArray[np.uint8]
type Floats = NDArray[np.float32]


class Locator(nn.Module):
    """Images (N,h,w,3) uint8 -> points (N,K,2) px and the errors (N,K) px that are expected of
    them."""

    def __init__(self, points: int, width: int) -> None:
        super().__init__()
        self.points, filters = points, points + HELPERS
        self.body = Points(filters, width)
        self.doubt = nn.Sequential(nn.Linear(3 * filters, 32), nn.GELU(), nn.Linear(32, points))

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        seen = self.body(images.permute(0, 3, 1, 2).float() / 127.5 - 1)
        filters = seen.shape[1] // 3
        found = torch.stack([seen[:, : self.points], seen[:, filters : filters + self.points]], -1)
        # -1 and 1 are the middles of the first and the last cell
        cells = torch.tensor(
            [-(-images.shape[2] // CELL), -(-images.shape[1] // CELL)], device=images.device
        )
        pixels = ((found + 1) / 2 * (cells - 1) + 0.5) * CELL
        return pixels, self.doubt(seen).clamp(LEAST, MOST).exp()


class FinderNet(nn.Module):
    """A locator for whole images, made small, and one for crops."""

    def __init__(self, settings: Finder) -> None:
        super().__init__()
        self.settings = settings
        self.coarse, self.fine = (Locator(settings.points, settings.width) for _ in range(2))

    def shrunk(self, images: Images) -> Images:
        """Images (N,H,W,3) at the size of the first locator."""
        return np.stack([resized(image, self.settings.size) for image in images])

    def find(self, images: Images) -> tuple[Floats, Floats]:
        """Points (N,K,2) px in images (N,H,W,3), and the errors (N,K) px that are expected of
        them."""
        device, size = next(self.parameters()).device, np.array(images.shape[2:0:-1])
        with torch.inference_mode():
            rough, _ = self.coarse(torch.from_numpy(self.shrunk(images)).to(device))
            corners = self.corners(
                rough[:, 0].cpu().numpy() * size / self.settings.size[::-1], size
            )
            crops = np.stack([self.crop(*pair) for pair in zip(images, corners, strict=True)])
            found, errors = self.fine(torch.from_numpy(crops).to(device))
        return found.cpu().numpy() + corners[:, None].astype(np.float32), errors.cpu().numpy()

    def corners(self, middle: NDArray[np.floating], size: NDArray[np.int64]) -> NDArray[np.int64]:
        """Upper left corners (N,2) px of crops around `middle` (N,2) px that lie within images of
        `size` (width, height)."""
        return np.clip(
            np.rint(middle - self.settings.crop / 2), 0, size - self.settings.crop
        ).astype(np.int64)

    def crop(self, image: Images, corner: NDArray[np.int64]) -> Images:
        """The crop (c,c,3) of an image (H,W,3) at a corner (2,) px."""
        left, top = corner
        return image[top : top + self.settings.crop, left : left + self.settings.crop]


def finding_loss(found: Tensor, errors: Tensor, wanted: Tensor) -> Tensor:
    """Negative log-likelihood of points (N,K,2) px plus a tenth of their distance from the found
    ones (px).

    The distances follow a Laplace law of the expected errors (N,K); the second term keeps points
    learning that are expected to be far off."""
    distance = (found - wanted).abs().mean(-1)
    return (distance / errors + errors.log()).mean() + 0.1 * distance.clamp(max=100).mean()

"""When a moving body first comes near others whose poses over time are known."""

from collections.abc import Sequence

import numpy as np

from pipeline.planning.collision_kernels import first_swept_contact, place_pieces
from pipeline.planning.collision_pieces import Floats, bounding_ball, pieces_of, transform_rows
from pipeline.poses import IDENTITY
from pipeline.world.shapes import Collider


class Sweep:
    """Collision pieces of recorded bodies and of one moving body, placed once and tested against
    any number of its motions."""

    def __init__(
        self,
        pieces: Sequence[tuple[int, Collider]],
        poses: Floats,
        own: Sequence[Collider],
        margin: float,
    ) -> None:
        """`pieces` are (body index, collider) of bodies at world `poses` (S,B,7); `own` those of
        the moving body.

        `margin` (m) is the distance that counts as contact.
        """
        others = pieces_of([(index, index, c, IDENTITY) for index, c in pieces])
        mine = pieces_of([(0, 0, c, IDENTITY) for c in own])
        self._pieces, self._count, self._margin, self._ball = (
            others.joined(mine),
            len(pieces),
            margin,
            bounding_ball(mine),
        )
        self._placed = np.empty((len(poses), len(pieces) + len(own), 12))
        place_pieces(transform_rows(poses), others.frame, others.local, self._placed)

    def first_contact(self, poses: Floats) -> int | None:
        """Index of the first pose (S,7) at which the moving body is within the margin of something,
        or None.

        Raises ValueError if the recorded bodies have another number of poses.
        """
        if len(poses) != len(self._placed):
            raise ValueError(
                f"{len(poses)} poses of the moving body for {len(self._placed)} recorded ones"
            )
        at = transform_rows(poses)
        row = first_swept_contact(
            tuple(self._pieces), self._placed, self._count, at, self._ball, self._margin
        )
        return None if row < 0 else row

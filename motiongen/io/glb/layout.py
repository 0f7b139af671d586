"""What a clip from a GLB file needs to be written back into it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GlbLayout:
    """A document with a skeleton in it, whose nodes may be turned and scaled in any way at rest.

    A `Skeleton` has no rest rotations: in its rest pose every joint's axes are the world's. So a joint's frame here is
    the node's, turned by its rest rotation in the world, and lengths are the world's.

    Attributes:
        document: the JSON chunk.
        binary: the binary chunk.
        nodes: (J,) of the joints.
        rest: (J, 4) rotation of each joint's node in the world, at rest.
        parent_rest: (J, 4) likewise of the node that it hangs from.
        parent_scale: (J,) how much larger things under that node are than they say.
        origin: (3,) where the node is that the root hangs from.
        height: of the skeleton in the file, so that a motion in another unit finds its way back.
    """

    document: dict[str, Any]
    binary: bytes
    nodes: tuple[int, ...]
    rest: Array
    parent_rest: Array
    parent_scale: Array
    origin: Array
    height: float = 1.0

    def rotations_from_nodes(self, local: Array) -> Array:
        """(T, J, 4) of the nodes to those of a motion."""
        return rot.multiply(rot.multiply(self.parent_rest, local), rot.inverse(self.rest))

    def rotations_to_nodes(self, rotations: Array) -> Array:
        """The inverse of `rotations_from_nodes`."""
        return rot.multiply(rot.multiply(rot.inverse(self.parent_rest), rotations), self.rest)

    def translations_from_nodes(self, local: Array, joints: tuple[int, ...]) -> Array:
        """(T, M, 3) of the nodes of `joints` to those of a motion."""
        which = list(joints)
        moved = rot.rotate(self.parent_rest[which], local) * self.parent_scale[which, None]
        return moved + self._origins(joints)

    def translations_to_nodes(self, translations: Array, joints: tuple[int, ...]) -> Array:
        """The inverse of `translations_from_nodes`."""
        which = list(joints)
        moved = (translations - self._origins(joints)) / self.parent_scale[which, None]
        return rot.rotate(rot.inverse(self.parent_rest[which]), moved)

    def _origins(self, joints: tuple[int, ...]) -> Array:
        return np.array([self.origin if joint == 0 else np.zeros(3) for joint in joints]).reshape(-1, 3)

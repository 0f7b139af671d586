"""A skeleton as a graph for convolutions: who is a joint's neighbour, and of which kind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

ITSELF, INWARD, OUTWARD = range(3)
"""The parts of a joint's neighbourhood: the joint, its parent, its children."""

PARTS = 3


def partitioned_adjacency(parents: Sequence[int]) -> NDArray[np.float32]:
    """(3, J, J) what joint j reads of joint i at [part, i, j]: the spatial partition of ST-GCN (Yan et al. 2018, 3.3).

    Neighbours are told apart by whether they lie nearer to the body's centre or further out; the root stands for the
    centre. What comes from several neighbours of one part is their mean.

    Args:
        parents: (J,) index of each joint's parent; -1 for the root.
    """
    joints = len(parents)
    adjacency = np.zeros((PARTS, joints, joints), dtype=np.float32)
    adjacency[ITSELF] = np.eye(joints)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            adjacency[INWARD, parent, joint] = adjacency[OUTWARD, joint, parent] = 1.0
    return adjacency / np.maximum(adjacency.sum(axis=1, keepdims=True), 1.0)

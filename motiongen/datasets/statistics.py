"""What is usual in a dataset: where rotations are, and the mean and deviation of every channel."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from motiongen import rotations as rot
from motiongen.datasets.dataset import Dataset
from motiongen.datasets.entities import CHANNELS
from motiongen.datasets.labels import TRAINING
from motiongen.datasets.store import Index

Array = NDArray[np.float64]

STEADY = 1e-4
"""A channel that deviates by less does not vary: it is centred but not scaled, or noise would be blown up."""

_UP = np.array([0.0, 1.0, 0.0])


def with_statistics(dataset: Dataset) -> Index:
    """The index of a dataset with `reference`, `mean` and `deviation` of its training part.

    The reference comes first, for the signs of the windows that are averaged depend on it.
    """
    index = dataclasses.replace(dataset.index, reference=_reference(dataset))
    mean, deviation = _mean_and_deviation(Dataset(index, dataset.frames, dataset.facing))
    return dataclasses.replace(index, mean=mean, deviation=deviation)


def _reference(dataset: Dataset) -> NDArray[np.float32]:
    """(J, 4) the mean rotation of each joint over the training clips, the root's as seen facing +z."""
    joints = len(dataset.skeleton)
    scatter = np.zeros((joints, CHANNELS, CHANNELS))
    for clip in dataset.clips(TRAINING):
        frames = slice(dataset.first[clip], dataset.first[clip] + dataset.index.lengths[clip])
        rotations = dataset.frames[frames, dataset.layout.joints].astype(np.float64)  # (T, J, 4)
        ahead = rot.from_axis_angle(_UP, -dataset.facing[frames].astype(np.float64))
        rotations[:, 0] = rot.multiply(ahead, rotations[:, 0])
        by_joint = rotations.swapaxes(0, 1)  # (J, T, 4)
        scatter += by_joint.swapaxes(1, 2) @ by_joint
    # The mean rotation maximises the sum of squared dot products: the main axis of the quaternions (Markley 2007).
    axes = np.linalg.eigh(scatter)[1][..., -1]  # (J, 4)
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1)
    return (axes * np.sign(largest)).astype(np.float32)


def _mean_and_deviation(dataset: Dataset) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(E, 4) each, over all frames of all training windows."""
    count, total, squares = 0, np.zeros(dataset.mean.shape), np.zeros(dataset.mean.shape)
    # Sums of squares are taken about a value close to the mean, or they would drown what varies little.
    about = dataset.batch(dataset.windows(TRAINING)[:1], standardised=False)[0, 0].astype(np.float64)
    for batch in dataset.batches(TRAINING, standardised=False):
        apart = batch.reshape(-1, *dataset.mean.shape) - about
        count += len(apart)
        total += apart.sum(axis=0)
        squares += np.einsum("nec,nec->ec", apart, apart)
    mean = total / count
    deviation = np.sqrt(np.maximum(squares / count - mean**2, 0.0))
    return (about + mean).astype(np.float32), np.where(deviation > STEADY, deviation, 1.0).astype(np.float32)

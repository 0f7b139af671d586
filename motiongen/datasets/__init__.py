"""Datasets of motion windows: folders and archives of clips made into arrays that training reads from disk."""

from motiongen.datasets.dataset import Dataset
from motiongen.datasets.entities import EntityLayout, from_entities, to_entities
from motiongen.datasets.importing import import_clips
from motiongen.datasets.packing import Loss, pack, unpack
from motiongen.datasets.report import ImportReport
from motiongen.datasets.settings import ImportSettings

__all__ = [
    "Dataset",
    "EntityLayout",
    "ImportReport",
    "ImportSettings",
    "Loss",
    "from_entities",
    "import_clips",
    "pack",
    "to_entities",
    "unpack",
]

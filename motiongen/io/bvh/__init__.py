"""BVH files. The only place that knows Euler angles and the order of channels."""

from motiongen.io.bvh.reader import read_bvh
from motiongen.io.bvh.writer import write_bvh

__all__ = ["read_bvh", "write_bvh"]

"""motiongen: pluggable motion generators for skeletal characters.

    import motiongen as mg
    clip = mg.load("walk.bvh")

Importing this imports NumPy and nothing heavier.
"""

from motiongen.errors import MotionGenError
from motiongen.motion import Motion, concatenate
from motiongen.skeleton import Skeleton

__version__ = "0.1.0"
__all__ = ["Motion", "MotionGenError", "Skeleton", "concatenate"]

"""motiongen: pluggable motion generators for skeletal characters.

    import motiongen as mg

    clip = mg.load("walk.bvh")
    generator = mg.create("genmm").fit([clip])
    generator.sample(frames=600, seed=0)[0].save("new.bvh")

Importing this imports NumPy and nothing heavier; torch comes with the first generator.
"""

from typing import Any

from motiongen.errors import MotionGenError
from motiongen.motion import Motion, concatenate
from motiongen.skeleton import Skeleton

__version__ = "0.1.0"

# Name -> module that holds it; imported when first asked for.
_LATER = {
    "load": "motiongen.io",
    "save": "motiongen.io",
    "create": "motiongen.generators.registry",
    "Generator": "motiongen.generators.base",
    "GeneratorSpec": "motiongen.generators.registry",
    "Capabilities": "motiongen.generators.base",
    "Options": "motiongen.generators.options",
    "attribute": "motiongen.attributes",
    "option": "motiongen.generators.options",
    "Constraint": "motiongen.generators.constraints",
    "Keyframes": "motiongen.generators.constraints",
    "Loop": "motiongen.generators.constraints",
    "FixedJoints": "motiongen.generators.constraints",
    "RootPath": "motiongen.generators.constraints",
    "Segment": "motiongen.generators.constraints",
    "Continuation": "motiongen.generators.constraints",
    "InBetween": "motiongen.generators.constraints",
    "Style": "motiongen.generators.constraints",
    "Parts": "motiongen.generators.constraints",
}

__all__ = ["Motion", "MotionGenError", "Skeleton", "concatenate", *_LATER]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'motiongen' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(_LATER[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)

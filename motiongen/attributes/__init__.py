"""Semantic attributes: small functions of a motion that say how much it has of something (section 4.4 of MoDi's paper).

    from motiongen.attributes import attribute, attribute_of

    @attribute("frames", "how long it is, in frames")
    def frames(motion):
        return len(motion)

    attribute_of("speed").score(motion)

They work on any biped whose joints come in left and right pairs; one that needs a part that a skeleton does not have
raises a `MotionGenError`.
"""

from motiongen.attributes.registry import (
    Attribute,
    attribute,
    attribute_of,
    attributes,
    attributes_for,
)
from motiongen.attributes.roles import Arm, ankles, arm, trunk

__all__ = [
    "Arm",
    "Attribute",
    "ankles",
    "arm",
    "attribute",
    "attribute_of",
    "attributes",
    "attributes_for",
    "trunk",
]
